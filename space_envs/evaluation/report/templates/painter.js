"use strict";
// Draws a scene without WebGL, for browsers that have none: triangles on a plain canvas, the far ones first.

/** A scene on a canvas, with the same methods as WebGLRenderer. */
class Painter {
  constructor(canvas, scene) {
    Object.assign(this, { canvas, scene, context: canvas.getContext("2d"), paths: [] });
    this.world = new Float32Array(3 * scene.vertices);
    this.screen = new Float32Array(3 * scene.vertices);
  }

  setPaths(paths) {
    this.paths = paths;
  }

  draw(view, poses, frame) {
    const { context, canvas } = this;
    const sky = context.createLinearGradient(0, 0, 0, canvas.height);
    sky.addColorStop(0, "#03050a");
    sky.addColorStop(1, "#0c1c36");
    context.fillStyle = sky;
    context.fillRect(0, 0, canvas.width, canvas.height);
    this.place(view, poses);
    for (const [, a, b, c, color] of this.visible(view)) {
      context.fillStyle = context.strokeStyle = color; // the stroke closes the seams between triangles
      context.beginPath();
      for (const at of [a, b, c]) context.lineTo(this.screen[3 * at], this.screen[3 * at + 1]);
      context.closePath();
      context.fill();
      context.stroke();
    }
    for (const path of this.paths) this.line(view, path.slice(0, frame + 1));
  }

  /** Every vertex in the inertial frame and on the screen; the third number there is its distance. */
  place(view, poses) {
    const { scene, world, screen } = this;
    for (let at = 0; at < scene.vertices; at += 1) {
      const m = 16 * scene.body[at];
      const [x, y, z] = [0, 1, 2].map((i) => scene.unit * scene.places[3 * at + i]);
      for (let i = 0; i < 3; i += 1) {
        world[3 * at + i] = poses[m + i] * x + poses[m + 4 + i] * y + poses[m + 8 + i] * z + poses[m + 12 + i];
      }
      screen.set(this.project(view, world.subarray(3 * at, 3 * at + 3)), 3 * at);
    }
  }

  project({ matrix: m }, [x, y, z]) {
    const { width, height } = this.canvas;
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    return [
      (0.5 + (0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12])) / w) * width,
      (0.5 - (0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13])) / w) * height,
      w,
    ];
  }

  /** Triangles that face the camera, with distance, corners and color, from far to near. */
  visible(view) {
    const { scene, screen, world } = this;
    const found = [];
    for (let t = 0; t < 3 * scene.triangles; t += 3) {
      const [a, b, c] = [scene.indices[t], scene.indices[t + 1], scene.indices[t + 2]];
      const [ax, ay, bx, by, cx, cy] = [a, b, c].flatMap((at) => [screen[3 * at], screen[3 * at + 1]]);
      if ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax) >= 0) continue;
      const side = (from, to) => [0, 1, 2].map((i) => world[3 * to + i] - world[3 * from + i]);
      const [u, v] = [side(a, b), side(a, c)];
      const n = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
      const length = Math.hypot(...n) || 1;
      const along = (way) => Math.max(0, n.reduce((sum, each, i) => sum + each * way[i], 0) / length);
      const light = 0.28 + 0.25 * along(view.back) + 0.75 * along(scene.sun.map((each) => -each));
      const rgb = [0, 1, 2].map((i) => Math.min(255, Math.round(scene.colors[4 * a + i] * light)));
      // By the farthest corner: what is large comes before the small things that lie on it.
      const distance = Math.max(screen[3 * a + 2], screen[3 * b + 2], screen[3 * c + 2]);
      found.push([distance, a, b, c, `rgba(${rgb.join(",")},${scene.colors[4 * a + 3] / 255})`]);
    }
    return found.sort((left, right) => right[0] - left[0]);
  }

  line(view, path) {
    const { context } = this;
    context.strokeStyle = "#73edff";
    context.lineWidth = this.canvas.width / 350;
    context.beginPath();
    for (const place of path) context.lineTo(...this.project(view, place).slice(0, 2));
    context.stroke();
    context.lineWidth = 1;
  }

  dispose() {}
}
