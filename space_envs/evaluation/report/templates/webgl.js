"use strict";
// Draws a scene with WebGL 2: the robot and its target, the end-effectors' paths, and space behind them.

const BODY_VERTEX = `
layout(location = 0) in vec3 place;
layout(location = 1) in vec4 normal;
layout(location = 2) in vec4 color;
layout(location = 3) in float body;
uniform mat4 poses[BODIES];
uniform mat4 screen;
uniform float unit;
out vec3 at;
out vec3 facing;
out vec4 paint;
out float gloss;
void main() {
  mat4 pose = poses[int(body)];
  vec4 world = pose * vec4(place * unit, 1.0);
  at = world.xyz;
  facing = mat3(pose) * normal.xyz;
  paint = color;
  gloss = normal.w;
  gl_Position = screen * world;
}`;

const BODY_FRAGMENT = `
in vec3 at;
in vec3 facing;
in vec4 paint;
in float gloss;
uniform vec3 eye;
uniform vec3 sun;
out vec4 seen;
void main() {
  vec3 toward = normalize(eye - at);
  vec3 n = normalize(facing);
  if (dot(n, toward) < 0.0) n = -n;
  float light = max(dot(n, -sun), 0.0);
  float headlight = max(dot(n, toward), 0.0);
  float shine = gloss * pow(max(dot(n, normalize(toward - sun)), 0.0), 10.0 + 60.0 * gloss);
  vec3 earthshine = mix(vec3(0.16, 0.21, 0.30), vec3(0.10, 0.11, 0.13), 0.5 + 0.5 * n.z);
  vec3 linear = pow(paint.rgb, vec3(1.6)) * (earthshine + 0.22 * headlight + 1.15 * light * vec3(1.0, 0.97, 0.91));
  seen = vec4(pow(linear + 0.8 * shine * vec3(1.0, 0.96, 0.88), vec3(1.0 / 1.6)), 1.0) * paint.a;
}`;

const PATH_VERTEX = `
layout(location = 0) in vec3 place;
uniform mat4 screen;
void main() {
  gl_Position = screen * vec4(place, 1.0);
}`;

const PATH_FRAGMENT = `
uniform vec4 paint;
out vec4 seen;
void main() {
  seen = vec4(paint.rgb * paint.a, paint.a);
}`;

const SKY_VERTEX = `
uniform mat3 axes;
uniform vec2 slope;
out vec3 way;
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  way = axes * vec3(corner * slope, -1.0);
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

const SKY_FRAGMENT = `
in vec3 way;
uniform vec3 eye;
uniform vec3 sun;
uniform vec4 planet;
out vec4 seen;
float random(vec3 cell) {
  return fract(sin(dot(cell, vec3(12.9898, 78.233, 37.719))) * 43758.5453);
}
float noise(vec3 p) {
  vec3 cell = floor(p), part = fract(p);
  part = part * part * (3.0 - 2.0 * part);
  vec4 low = vec4(random(cell), random(cell + vec3(1, 0, 0)), random(cell + vec3(0, 1, 0)), random(cell + vec3(1, 1, 0)));
  vec4 high = vec4(random(cell + vec3(0, 0, 1)), random(cell + vec3(1, 0, 1)), random(cell + vec3(0, 1, 1)), random(cell + vec3(1, 1, 1)));
  vec4 flat4 = mix(low, high, part.z);
  vec2 line = mix(flat4.xz, flat4.yw, part.x);
  return mix(line.x, line.y, part.y);
}
void main() {
  vec3 d = normalize(way);
  vec3 cell = floor(d * 90.0);
  float rarity = random(cell);
  float apart = 90.0 * length(cross(d, normalize(cell + 0.5)));
  float star = rarity > 0.985 ? smoothstep(0.05 + 8.0 * (rarity - 0.985), 0.0, apart) : 0.0;
  vec3 color = vec3(0.010, 0.014, 0.028) + star * mix(vec3(1.0, 0.85, 0.7), vec3(0.75, 0.85, 1.0), random(cell + 7.0));
  if (planet.w > 0.0) {
    vec3 from = eye - planet.xyz;
    float along = dot(from, d);
    float height = sqrt(max(dot(from, from) - along * along, 0.0)) / planet.w;
    if (along < 0.0) {
      if (height < 1.0) {
        vec3 n = normalize(from + (-along - planet.w * sqrt(1.0 - height * height)) * d);
        float cover = 0.55 * noise(9.0 * n + 2.0 * noise(16.0 * n)) + 0.28 * noise(30.0 * n) + 0.17 * noise(75.0 * n);
        vec3 ground = mix(vec3(0.02, 0.10, 0.26), vec3(0.80, 0.86, 0.93), smoothstep(0.45, 0.75, cover));
        float day = 0.12 + 0.88 * smoothstep(-0.1, 0.9, dot(n, -sun));
        color = ground * day + vec3(0.25, 0.5, 0.9) * pow(height, 14.0) * 0.55 * day;
      } else {
        color += vec3(0.30, 0.58, 1.0) * exp(-(height - 1.0) * 95.0) * 0.9;
      }
    }
  }
  seen = vec4(color, 1.0);
}`;

const TUBE_SIDES = 6;
const TUBE_RADIUS = 0.0016; // of the camera's first distance
const TRAIL = [0.45, 0.93, 1.0];

/** Triangles of tubes around paths; `ends` holds how many indices lead to each place of each path. */
function tubes(paths, radius) {
  const places = [];
  const indices = [];
  const spans = paths.map((path) => {
    const start = indices.length;
    const ends = path.map((place, k) => {
      const [before, after] = [path[Math.max(k - 1, 0)], path[Math.min(k + 1, path.length - 1)]];
      const along = after.map((each, i) => each - before[i]);
      const length = Math.hypot(...along) || 1;
      const [x, y, z] = along.map((each) => each / length);
      // Two directions across, without a jump where the path is nearly upright.
      const a = Math.abs(z) < 0.9 ? [y, -x, 0] : [0, z, -y];
      const norm = Math.hypot(...a) || 1;
      const u = a.map((each) => each / norm);
      const v = [y * u[2] - z * u[1], z * u[0] - x * u[2], x * u[1] - y * u[0]];
      const first = places.length / 3;
      for (let side = 0; side < TUBE_SIDES; side += 1) {
        const [c, s] = [Math.cos((2 * Math.PI * side) / TUBE_SIDES), Math.sin((2 * Math.PI * side) / TUBE_SIDES)];
        for (let i = 0; i < 3; i += 1) places.push(place[i] + radius * (c * u[i] + s * v[i]));
        if (k > 0) {
          const [here, next] = [first + side, first + ((side + 1) % TUBE_SIDES)];
          indices.push(here - TUBE_SIDES, next - TUBE_SIDES, next, here - TUBE_SIDES, next, here);
        }
      }
      return indices.length - start;
    });
    return { start, ends };
  });
  return { places: new Float32Array(places), indices: new Uint32Array(indices), spans };
}

/** A scene on a canvas. Throws where the browser has no WebGL 2. */
class WebGLRenderer {
  constructor(canvas, scene) {
    const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
    if (!gl) throw new Error("this browser has no WebGL 2");
    Object.assign(this, { canvas, scene, gl });
    this.body = this.program(BODY_VERTEX.replace("BODIES", scene.bodies), BODY_FRAGMENT);
    this.path = this.program(PATH_VERTEX, PATH_FRAGMENT);
    this.sky = this.program(SKY_VERTEX, SKY_FRAGMENT);
    this.empty = gl.createVertexArray();
    this.surfaces = gl.createVertexArray();
    gl.bindVertexArray(this.surfaces);
    this.attribute(0, scene.places, 3, gl.SHORT, false);
    this.attribute(1, scene.normals, 4, gl.BYTE, true);
    this.attribute(2, scene.colors, 4, gl.UNSIGNED_BYTE, true);
    this.attribute(3, scene.body, 1, gl.UNSIGNED_BYTE, false);
    this.elements(scene.indices);
    this.trails = null;
    gl.enable(gl.DEPTH_TEST);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  /** A program and its uniforms' places by name. */
  program(vertex, fragment) {
    const { gl } = this;
    const program = gl.createProgram();
    for (const [kind, source] of [
      [gl.VERTEX_SHADER, vertex],
      [gl.FRAGMENT_SHADER, fragment],
    ]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, `#version 300 es\nprecision highp float;\n${source}`);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
    const at = {};
    for (let i = 0; i < gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS); i += 1) {
      const name = gl.getActiveUniform(program, i).name.replace("[0]", "");
      at[name] = gl.getUniformLocation(program, name);
    }
    return { program, at };
  }

  attribute(index, data, size, kind, normalised) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(index);
    gl.vertexAttribPointer(index, size, kind, normalised, 0, 0);
  }

  elements(indices) {
    const { gl } = this;
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
  }

  /** The paths to draw from now on. */
  setPaths(paths, distance) {
    const { gl } = this;
    const made = tubes(paths, TUBE_RADIUS * distance);
    const array = gl.createVertexArray();
    gl.bindVertexArray(array);
    this.attribute(0, made.places, 3, gl.FLOAT, false);
    this.elements(made.indices);
    this.trails = { array, spans: made.spans };
  }

  /** Draw bodies at their poses, and the paths, bright up to a frame. */
  draw(view, poses, frame) {
    const { gl, scene, canvas } = this;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.disable(gl.BLEND);
    gl.depthMask(false);
    gl.useProgram(this.sky.program);
    gl.bindVertexArray(this.empty);
    gl.uniformMatrix3fv(this.sky.at.axes, false, [...view.right, ...view.up, ...view.back]);
    gl.uniform2f(this.sky.at.slope, view.aspect / view.scale, 1 / view.scale);
    gl.uniform3fv(this.sky.at.eye, view.eye);
    gl.uniform3fv(this.sky.at.sun, scene.sun);
    gl.uniform4fv(this.sky.at.planet, scene.planet ?? [0, 0, 0, 0]);
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
    gl.depthMask(true);

    gl.useProgram(this.body.program);
    gl.bindVertexArray(this.surfaces);
    gl.uniformMatrix4fv(this.body.at.poses, false, poses);
    gl.uniformMatrix4fv(this.body.at.screen, false, view.matrix);
    gl.uniform1f(this.body.at.unit, scene.unit);
    gl.uniform3fv(this.body.at.eye, view.eye);
    gl.uniform3fv(this.body.at.sun, scene.sun);
    gl.drawElements(gl.TRIANGLES, 3 * scene.opaque, gl.UNSIGNED_INT, 0);

    gl.enable(gl.BLEND);
    if (this.trails) this.drawPaths(view, frame);
    if (scene.triangles > scene.opaque) {
      gl.useProgram(this.body.program);
      gl.bindVertexArray(this.surfaces);
      gl.enable(gl.CULL_FACE);
      const first = 12 * scene.opaque;
      gl.drawElements(gl.TRIANGLES, 3 * (scene.triangles - scene.opaque), gl.UNSIGNED_INT, first);
      gl.disable(gl.CULL_FACE);
    }
  }

  drawPaths(view, frame) {
    const { gl } = this;
    gl.useProgram(this.path.program);
    gl.bindVertexArray(this.trails.array);
    gl.uniformMatrix4fv(this.path.at.screen, false, view.matrix);
    for (const { start, ends } of this.trails.spans) {
      const count = ends[frame];
      const draw = (alpha, from, to) => {
        gl.uniform4f(this.path.at.paint, ...TRAIL, alpha);
        gl.drawElements(gl.TRIANGLES, to - from, gl.UNSIGNED_INT, 4 * (start + from));
      };
      draw(0.18, count, ends.at(-1)); // what is still to come
      draw(0.95, 0, count);
      gl.disable(gl.DEPTH_TEST); // what the robot hides shines through
      draw(0.25, 0, count);
      gl.enable(gl.DEPTH_TEST);
    }
  }

  /** Give the graphics memory back. */
  dispose() {
    this.gl.getExtension("WEBGL_lose_context")?.loseContext();
  }
}
