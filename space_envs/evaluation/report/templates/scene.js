"use strict";
// Scenes and motions as the page carries them, and a camera that turns about them.

/** The bytes of deflated base64. */
async function unpack(text) {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Response(stream).arrayBuffer();
}

/** A scene's arrays in the order in which they were packed. */
class Scene {
  static cache = new Map();

  /** The scene in the element of that id, read once. */
  static read(id) {
    if (!Scene.cache.has(id)) {
      const values = JSON.parse(document.getElementById(id).textContent);
      Scene.cache.set(id, unpack(values.data).then((buffer) => new Scene(values, buffer)));
    }
    return Scene.cache.get(id);
  }

  constructor(values, buffer) {
    Object.assign(this, values, { data: null });
    let start = 0;
    const take = (Kind, count) => {
      const array = new Kind(buffer, start, count);
      start += array.byteLength;
      return array;
    };
    this.indices = take(Uint32Array, 3 * values.triangles);
    this.places = take(Int16Array, 3 * values.vertices);
    this.normals = take(Int8Array, 4 * values.vertices);
    this.colors = take(Uint8Array, 4 * values.vertices);
    this.body = take(Uint8Array, values.vertices);
  }
}

/** The poses of a scene's bodies in time. */
class Motion {
  static async read(values, bodies) {
    return new Motion(values, bodies, await unpack(values.data));
  }

  constructor(values, bodies, buffer) {
    Object.assign(this, values, { data: null, bodies });
    const frames = values.time.length;
    const count = 3 * frames * bodies;
    this.positions = Motion.summed(new Int16Array(buffer, 0, count), 3 * bodies);
    this.turns = Motion.summed(new Int16Array(buffer, 2 * count, 4 * frames * bodies), 4 * bodies);
    this.end = values.time[frames - 1];
  }

  /** Frames from their differences, modulo 2^16 as they were made. */
  static summed(steps, width) {
    for (let i = width; i < steps.length; i += 1) steps[i] += steps[i - width];
    return steps;
  }

  /** Frame before a time, and how far the time lies on the way to the next, in 0..1. */
  frame(time) {
    const last = this.time.length - 1;
    if (last === 0 || time >= this.end) return [last, 0];
    let low = 0;
    let high = last;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.time[middle] <= time) low = middle;
      else high = middle;
    }
    return [low, (time - this.time[low]) / (this.time[high] - this.time[low])];
  }

  /** A course such as attitude at a time. */
  value(course, time) {
    const [frame, part] = this.frame(time);
    return part ? course[frame] + part * (course[frame + 1] - course[frame]) : course[frame];
  }

  /** Column-major 4 x 4 matrices of all bodies at a time, one after the other. */
  poses(time, out = new Float32Array(16 * this.bodies)) {
    const [frame, part] = this.frame(time);
    for (let body = 0; body < this.bodies; body += 1) this.pose(frame, part, body, out, 16 * body);
    return out;
  }

  pose(frame, part, body, out, at) {
    const p = 3 * (frame * this.bodies + body);
    const q = 4 * (frame * this.bodies + body);
    const [nextP, nextQ] = part ? [p + 3 * this.bodies, q + 4 * this.bodies] : [p, q];
    let along = 0;
    for (let i = 0; i < 4; i += 1) along += this.turns[q + i] * this.turns[nextQ + i];
    const sign = along < 0 ? -1 : 1; // q and -q are the same turn; take the shorter way
    const turn = [0, 1, 2, 3].map((i) => (1 - part) * this.turns[q + i] + part * sign * this.turns[nextQ + i]);
    const length = Math.hypot(...turn);
    const [w, x, y, z] = turn.map((each) => each / length);
    const s = this.size[body];
    out.set([s * (1 - 2 * (y * y + z * z)), s * 2 * (x * y + w * z), s * 2 * (x * z - w * y), 0], at);
    out.set([s * 2 * (x * y - w * z), s * (1 - 2 * (x * x + z * z)), s * 2 * (y * z + w * x), 0], at + 4);
    out.set([s * 2 * (x * z + w * y), s * 2 * (y * z - w * x), s * (1 - 2 * (x * x + y * y)), 0], at + 8);
    for (let i = 0; i < 3; i += 1) {
      out[at + 12 + i] = this.unit * ((1 - part) * this.positions[p + i] + part * this.positions[nextP + i]);
    }
    out[at + 15] = 1;
  }

  /** The path of a point of a body: one place for each frame. */
  path({ body, place: [x, y, z] }) {
    const m = new Float32Array(16);
    return this.time.map((_, frame) => {
      this.pose(frame, 0, body, m, 0);
      return [0, 1, 2].map((i) => m[i] * x + m[4 + i] * y + m[8 + i] * z + m[12 + i]);
    });
  }
}

/** A camera on a sphere about a centre, z up. */
class Camera {
  constructor(scene) {
    this.centre = scene.centre;
    this.scale = 1 / Math.tan((scene.fovy * Math.PI) / 360);
    const offset = scene.eye.map((each, i) => each - this.centre[i]);
    this.first = {
      distance: Math.hypot(...offset),
      azimuth: Math.atan2(offset[1], offset[0]),
      elevation: Math.asin(offset[2] / Math.hypot(...offset)),
    };
    this.reset();
  }

  reset() {
    Object.assign(this, this.first);
  }

  turn(azimuth, elevation) {
    this.azimuth += azimuth;
    this.elevation = Math.min(1.5, Math.max(-1.5, this.elevation + elevation));
  }

  zoom(factor) {
    const { distance } = this.first;
    this.distance = Math.min(3 * distance, Math.max(0.25 * distance, this.distance * factor));
  }

  /** Where it stands, its axes (right, up, back) and the matrix from the inertial frame to the screen. */
  view(aspect) {
    const [ca, sa, ce, se] = [
      Math.cos(this.azimuth),
      Math.sin(this.azimuth),
      Math.cos(this.elevation),
      Math.sin(this.elevation),
    ];
    const back = [ca * ce, sa * ce, se];
    const right = [-sa, ca, 0];
    const up = [-ca * se, -sa * se, ce];
    // A narrow screen sees as much across as one of 4:3 does.
    const scale = this.scale * Math.min(1, aspect / 1.33);
    const eye = this.centre.map((each, i) => each + this.distance * back[i]);
    const [near, far] = [0.05 * this.distance, 20 * this.distance];
    const rows = [
      right.map((each) => (each * scale) / aspect),
      up.map((each) => each * scale),
      back.map((each) => (each * (near + far)) / (near - far)),
      back.map((each) => -each),
    ];
    const shift = rows.map((row) => -row.reduce((sum, each, i) => sum + each * eye[i], 0));
    shift[2] += (2 * near * far) / (near - far);
    const matrix = new Float32Array(16);
    for (let row = 0; row < 4; row += 1) {
      for (let column = 0; column < 3; column += 1) matrix[4 * column + row] = rows[row][column];
      matrix[12 + row] = shift[row];
    }
    return { eye, right, up, back, scale, aspect, matrix };
  }
}
