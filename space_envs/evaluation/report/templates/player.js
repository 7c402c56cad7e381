"use strict";
// Plays recorded episodes: which one, its time, and the camera.

const MOST_LIVE = 4; // players that hold a drawing context; browsers allow about sixteen
const STILL = matchMedia("(prefers-reduced-motion: reduce)");

class Player {
  static live = [];

  constructor(root) {
    this.root = root;
    this.find = (selector) => root.querySelector(selector);
    this.playing = this.visible = this.started = false;
    this.time = 0;
    this.chosen = { policy: 0, episode: 0 };
    this.turn = 0; // of requests, so that a slow one does not undo a later one
    this.listen();
    new IntersectionObserver(([entry]) => this.see(entry.isIntersecting)).observe(this.find(".stage"));
    new ResizeObserver(() => this.request()).observe(this.find(".stage"));
  }

  // What the reader does ---------------------------------------------------------------------------------

  listen() {
    const on = (selector, event, act) => this.find(selector).addEventListener(event, act);
    on(".policy", "change", (event) => this.choose(Number(event.target.value), 0));
    on(".play", "click", () => this.toggle());
    on(".time", "input", (event) => this.seek(Number(event.target.value)));
    on(".nearer", "click", () => this.move((camera) => camera.zoom(0.8)));
    on(".farther", "click", () => this.move((camera) => camera.zoom(1.25)));
    on(".home", "click", () => this.move((camera) => camera.reset()));
    const stage = this.find(".stage");
    stage.addEventListener("keydown", (event) => this.key(event));
    stage.addEventListener("pointerdown", (event) => this.drag(event, stage));
    stage.addEventListener(
      "wheel",
      (event) => {
        if (!event.ctrlKey) return; // the page scrolls; pinching and ctrl zoom
        event.preventDefault();
        this.move((camera) => camera.zoom(Math.exp(0.01 * event.deltaY)));
      },
      { passive: false },
    );
  }

  key(event) {
    if (event.target.closest("button") || event.ctrlKey || event.altKey || event.metaKey) return;
    const step = 0.09;
    const acts = {
      ArrowLeft: (camera) => camera.turn(-step, 0),
      ArrowRight: (camera) => camera.turn(step, 0),
      ArrowUp: (camera) => camera.turn(0, step),
      ArrowDown: (camera) => camera.turn(0, -step),
      "+": (camera) => camera.zoom(0.9),
      "=": (camera) => camera.zoom(0.9),
      "-": (camera) => camera.zoom(1.1),
      Home: (camera) => camera.reset(),
    };
    if (event.key === " ") this.toggle();
    else if (acts[event.key]) this.move(acts[event.key]);
    else return;
    event.preventDefault();
  }

  drag(event, stage) {
    if (event.button !== 0 || event.target.closest("button")) return;
    stage.setPointerCapture(event.pointerId);
    let [x, y] = [event.clientX, event.clientY];
    const scale = 4 / stage.clientWidth;
    const move = (moved) => {
      this.move((camera) => camera.turn(scale * (x - moved.clientX), scale * (moved.clientY - y)));
      [x, y] = [moved.clientX, moved.clientY];
    };
    const end = () => {
      stage.removeEventListener("pointermove", move);
      for (const name of ["pointerup", "pointercancel"]) stage.removeEventListener(name, end);
    };
    stage.addEventListener("pointermove", move);
    for (const name of ["pointerup", "pointercancel"]) stage.addEventListener(name, end);
  }

  move(act) {
    if (this.camera) act(this.camera);
    this.request();
  }

  toggle() {
    if (!this.motion) return;
    if (!this.playing && this.time >= this.motion.end) this.time = 0;
    this.playing = !this.playing;
    this.before = null;
    this.request();
  }

  seek(time) {
    this.playing = false;
    this.time = time;
    this.request();
  }

  // What is shown ----------------------------------------------------------------------------------------

  async see(visible) {
    this.visible = visible;
    if (!visible) return;
    await this.wake();
    if (!this.started && !STILL.matches) this.playing = true;
    this.started = true;
    this.request();
  }

  /** Get data and a drawing context, if they are not there. */
  wake() {
    this.waking ??= this.load();
    return this.waking;
  }

  async load() {
    this.data ??= JSON.parse(document.getElementById(this.root.dataset.motions).textContent);
    this.scene = await Scene.read(this.root.dataset.scene);
    this.camera ??= new Camera(this.scene);
    const canvas = this.find("canvas");
    try {
      this.renderer = new WebGLRenderer(canvas, this.scene);
    } catch {
      this.renderer = new Painter(canvas, this.scene);
    }
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.sleep();
    });
    Player.live.push(this);
    while (Player.live.length > MOST_LIVE) Player.live[0].sleep();
    await this.choose(this.chosen.policy, this.chosen.episode, this.time);
  }

  /** Give the drawing context back; a canvas that had one cannot get another. */
  sleep() {
    Player.live = Player.live.filter((each) => each !== this);
    if (!this.renderer) return;
    const old = this.find("canvas");
    old.replaceWith(old.cloneNode());
    this.renderer.dispose();
    this.renderer = this.waking = null;
  }

  /** Show an episode of a policy, both by number. */
  async choose(policy, episode, time = 0) {
    this.turn += 1;
    const { turn } = this;
    this.chosen = { policy, episode };
    this.find(".policy").value = policy;
    const { episodes, color } = this.data.policies[policy];
    this.buttons(episodes, episode);
    const motion = await Motion.read(episodes[episode], this.scene.bodies);
    if (turn !== this.turn || !this.renderer) return;
    this.motion = motion;
    this.time = time;
    this.before = null;
    this.renderer.setPaths(
      this.scene.endEffectors.map((point) => motion.path(point)),
      this.camera.first.distance,
    );
    const slider = this.find(".time");
    slider.max = motion.end;
    this.chart(motion, color);
    const captured = motion.outcome === "captured";
    const message = this.find(".message");
    const outcome = motion.outcome[0].toUpperCase() + motion.outcome.slice(1).replace("_", " ");
    message.textContent = `${outcome} after ${motion.end.toFixed(1)} s${motion.reason ? `: ${motion.reason}` : ""}`;
    message.classList.toggle("failed", !captured);
    this.request();
  }

  buttons(episodes, chosen) {
    const group = this.find(".episodes");
    group.replaceChildren(
      ...episodes.map((each, number) => {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = each.label;
        button.title = `episode ${each.episode} of seed ${each.seed}, goal ${each.index}: ${each.outcome.replace("_", " ")}`;
        button.setAttribute("aria-pressed", number === chosen);
        button.addEventListener("click", async () => {
          await this.choose(this.chosen.policy, number);
          group.children[number].focus();
          if (!STILL.matches) this.playing = true;
          this.request();
        });
        return button;
      }),
    );
  }

  /** Draw the base's attitude against time, 600 by 90. */
  chart(motion, color) {
    this.top = Math.max(...motion.attitude) * 1.1 || 1;
    const x = (time) => (600 * time) / (motion.end || 1);
    const y = (angle) => 88 - (86 * angle) / this.top;
    const line = motion.time.map((time, k) => `${x(time).toFixed(1)},${y(motion.attitude[k]).toFixed(1)}`).join("L");
    this.find(".chart .line").setAttribute("d", `M${line}`);
    this.find(".chart .area").setAttribute("d", `M0,88L${line}L600,88Z`);
    this.find(".chart").style.setProperty("--looks", color);
    this.find(".scale").textContent = `base attitude, 0 to ${this.top.toPrecision(2)}\u00b0`;
  }

  // Time -------------------------------------------------------------------------------------------------

  request() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame((now) => {
      this.asked = false;
      this.tick(now);
    });
  }

  tick(now) {
    if (!this.renderer || !this.motion || !this.visible) {
      this.before = null;
      return;
    }
    if (this.playing) {
      const speed = Number(this.find(".speed select").value);
      if (this.before) this.time += (speed * Math.min(now - this.before, 200)) / 1000;
      this.before = now;
      if (this.time >= this.motion.end) {
        this.time = this.motion.end;
        this.playing = false;
      }
    }
    this.draw();
    if (this.playing) this.request();
  }

  draw() {
    const { motion, time, renderer } = this;
    const { canvas } = renderer;
    const ratio = Math.min(devicePixelRatio, 2);
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((each) => Math.max(1, Math.round(each * ratio)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.matrices = motion.poses(time, this.matrices);
    renderer.draw(this.camera.view(width / height), this.matrices, motion.frame(time)[0]);
    const slider = this.find(".time");
    slider.value = time;
    slider.setAttribute("aria-valuetext", `${time.toFixed(1)} seconds`);
    const cursor = this.find(".chart .cursor");
    for (const end of ["x1", "x2"]) cursor.setAttribute(end, (600 * time) / (motion.end || 1));
    const play = this.find(".play");
    play.textContent = this.playing ? "\u275a\u275a" : "\u25b6";
    play.setAttribute("aria-label", this.playing ? "Pause" : "Play");
    const attitude = motion.value(motion.attitude, time);
    const distance = 1000 * motion.value(motion.distance, time);
    this.find(".readout").textContent =
      `${time.toFixed(1)} of ${motion.end.toFixed(1)} s \u00b7 base rotated ${attitude.toFixed(2)}\u00b0 \u00b7 ` +
      `${distance < 100 ? distance.toFixed(1) : distance.toFixed(0)} mm to go`;
  }
}

const players = new Map([...document.querySelectorAll(".player")].map((root) => [root.id, new Player(root)]));
for (const link of document.querySelectorAll("a.watch")) {
  link.addEventListener("click", async (event) => {
    event.preventDefault();
    const player = players.get(link.hash.slice(1));
    player.root.scrollIntoView({ behavior: STILL.matches ? "auto" : "smooth" });
    player.started = true;
    await player.wake();
    await player.choose(Number(link.dataset.policy), 0);
    player.find("canvas").focus({ preventScroll: true });
    player.playing = !STILL.matches;
    player.request();
  });
}
