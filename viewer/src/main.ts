// The page: reads the runs, shows them, keeps time.

import "./style.css";
import {
  Color, ColorManagement, LinearSRGBColorSpace, Matrix4, Quaternion, Raycaster, Scene, Vector2, Vector3, WebGLRenderer,
} from "three";
import { Camera, type Preset } from "./camera";
import { extend, readData, type Job, type Rows } from "./data";
import { Floor } from "./floor";
import { setDetail } from "./geometry";
import { ICONS } from "./icons";
import { Labels } from "./labels";
import { endOf, placeAt } from "./motion";
import { Panel } from "./panel";
import { setLight } from "./surface";
import { DARK, GHOSTS_CSS, LIGHT, theme } from "./theme";
import { upOf, World, type Shows } from "./world";

const SPEEDS = [0.01, 0.02, 0.05, 0.1, 0.25, 0.5, 1, 2, 4, 8];
/** Frames per second below which the picture gets coarser, and how coarse it may get. */
const SMOOTH = 34;
/** Below this one shadows are left out in motion. */
const SMOOTH_ENOUGH = 26;
const COARSEST = 0.5;
/** Milliseconds between questions for rows of a run that goes on. */
const POLL = 250;
const byId = <T extends HTMLElement>(name: string) => document.getElementById(name) as T;

/** Whether pictures are made by the processor: then every pixel counts. */
function inSoftware(): boolean {
  const gl = document.createElement("canvas").getContext("webgl2");
  const names = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = gl && names ? String(gl.getParameter(names.UNMASKED_RENDERER_WEBGL)) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

class Page {
  private data = readData();
  private runs = this.data.runs;
  private job = this.data.job;
  private run = this.runs[0];
  private planar = this.run.dimension === "planar";
  private span = [
    Math.min(...this.runs.map((run) => run.start)),
    Math.max(...this.runs.map(endOf)),
  ] as [number, number];
  private canvas = byId<HTMLCanvasElement>("canvas");
  private renderer: WebGLRenderer;
  private scene = new Scene();
  private worlds: World[];
  private floor: Floor;
  private camera: Camera;
  private labels = new Labels();
  private panel: Panel;
  private time = this.span[0];
  private playing = false;
  private looping = true;
  /** Whether the last rows of a run that goes on are shown as they come. */
  private newest = false;
  private speed = 1;
  private shows: Shows & { labels: boolean } = { joints: true, forces: false, trails: false, axes: false, labels: false };
  private picked: string | null = null;
  private hovered: string | null = null;
  private followed: number | null;
  private stale = true;
  /** Pixels per pixel of the page: standing still, and in motion. */
  private sharpest = Math.min(2, window.devicePixelRatio || 1);
  private ratio = this.sharpest;
  private shadowsMove = true;
  private frames: number[] = [];
  /** When clock and plots were last moved, ms. */
  private told = 0;
  /** Frames drawn since the page was opened. */
  drawn = 0;

  constructor() {
    // Colours are shown as they are written: no pixel pays for converting them.
    ColorManagement.enabled = false;
    // A film takes its time.
    const antialias = this.job !== null || !inSoftware();
    this.renderer = new WebGLRenderer({ canvas: this.canvas, antialias, powerPreference: "high-performance" });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    const dark = window.matchMedia("(prefers-color-scheme: dark)");
    theme.now = dark.matches ? DARK : LIGHT;
    dark.addEventListener("change", () => this.setTheme(dark.matches));
    const things = this.run.bodies.length + this.run.elements.length;
    setDetail(this.run.size, (antialias ? 1.5 : 1) * (things > 150 ? 0.75 : 1));
    this.worlds = this.runs.map((run, number) => new World(run, number));
    const world = this.worlds[0];
    const up = upOf(this.run);
    const whole = world.points(true);
    const lowest = Math.min(...whole.map((point) => point.dot(up)), Infinity);
    const level = this.run.roads.length ? -0.004 * this.run.size : this.planar ? -0.3 * this.run.size : lowest - 0.02 * this.run.size;
    this.floor = new Floor(this.planar, up, Number.isFinite(level) ? level : 0, this.run.size);
    this.scene.add(this.floor.grid, world.shadowObject, ...this.worlds.map((one) => one.root));
    if (this.planar) setLight(new Vector3(0.3, 0.5, 1), new Vector3(0, 0, 1));
    else setLight(new Vector3(0.32, -0.42, 0.85).applyQuaternion(new Quaternion().setFromUnitVectors(new Vector3(0, 0, 1), up)), up);
    this.camera = new Camera(this.canvas, this.planar, up, this.run.size);
    this.camera.controls.addEventListener("change", () => (this.stale = true));
    this.followed = this.run.follow;
    const seek = (time: number) => this.seek(time);
    this.panel = new Panel(this.runs, this.span, seek, (name) => this.select(name));
    this.speed = this.startSpeed();
    this.addControls();
    this.setTheme(theme.now.dark);
    this.resize();
    new ResizeObserver(() => this.resize()).observe(byId("stage"));
    this.fit("iso");
    this.worlds.forEach((one) => one.show(this.shows));
    this.setTime(this.time);
    if (this.job) void this.film(this.job);
    else requestAnimationFrame(this.tick);
    if (this.data.live) {
      this.newest = true;
      this.seekNewest();
      void this.attend();
    }
  }

  /** Asks for the rows of a run that goes on, until it ends. */
  private async attend(): Promise<void> {
    const { run } = this;
    let failures = 0;
    for (let running = true; running; ) {
      await new Promise((done) => setTimeout(done, POLL));
      try {
        const answer = await fetch(`rows?since=${run.times.length}&generation=${run.generation}`);
        const rows = (await answer.json()) as Rows;
        failures = 0;
        run.generation = rows.generation;
        running = rows.status === "running";
        if (extend(run, rows)) this.extended();
        run.status = running ? "running" : rows.status;
      } catch {
        running = ++failures < 3;
        run.status = "ended";
      }
      this.tellStatus();
    }
    this.newest = false;
    this.speed = this.startSpeed();
    byId<HTMLSelectElement>("speed").value = String(this.speed);
  }

  private extended(): void {
    this.span[1] = endOf(this.run);
    byId<HTMLInputElement>("scrub").max = String(this.span[1]);
    this.worlds[0].extend();
    this.panel.refresh(this.picked);
    if (this.newest) this.seekNewest();
    else this.setTime(this.time);
  }

  private seekNewest(): void {
    this.setTime(this.span[1]);
  }

  private tellStatus(): void {
    const { run } = this;
    byId("subtitle").textContent = [run.file || run.name, run.method, run.completed ? "" : run.status].filter(Boolean).join(" · ");
  }

  /** Draws the frames of a film, each at its time, and sends them to who asked for it. */
  private async film(job: Job): Promise<void> {
    const send = (path: string, body: Blob | string) => fetch(path, { method: "POST", body });
    try {
      const [width, height] = job.size;
      document.body.classList.add("bare");
      this.setTheme(job.dark);
      this.renderer.setPixelRatio(1);
      this.renderer.setSize(width, height, false);
      this.camera.resize(width, height);
      this.setTime(job.times[0]);
      this.fit(job.camera);
      for (const time of job.times) {
        this.setTime(time);
        this.draw();
        const picture = await new Promise<Blob | null>((done) => this.canvas.toBlob(done, "image/png"));
        if (!picture) throw new Error("the picture is too large");
        if (!(await send("frame", picture)).ok) return;
      }
    } catch (error) {
      await send("failed", error instanceof Error ? error.message : String(error));
    }
  }

  /** A run is shown in 4 to 25 s, unless asked otherwise: a squeezer that takes 30 ms is slowed down. */
  private startSpeed(): number {
    const length = this.span[1] - this.span[0];
    if (length >= 1.5 && length <= 60) return 1;
    return SPEEDS.reduce((best, one) => (Math.abs(Math.log(length / one / 8)) < Math.abs(Math.log(length / best / 8)) ? one : best));
  }

  // --- time

  private tick = (now: number): void => {
    requestAnimationFrame(this.tick);
    const last = this.frames[this.frames.length - 1] ?? now;
    if (this.playing) {
      this.frames.push(now);
      if (this.frames.length > 60) this.frames.shift();
      // A page in the background does not jump when it comes back.
      let time = this.time + Math.min(0.25, (now - last) / 1000) * this.speed;
      if (time > this.span[1]) {
        if (this.looping) time = this.span[0];
        else {
          time = this.span[1];
          this.play(false);
        }
      }
      this.setTime(time);
      this.adapt();
    }
    if (this.stale) this.draw();
  };

  /** Coarser in motion where the machine is slow, as with a renderer in software, and then without shadows. */
  private adapt(): void {
    if (this.frames.length < 24 || !this.shadowsMove) return;
    const mean = (this.frames[this.frames.length - 1] - this.frames[0]) / (this.frames.length - 1);
    if (mean < 1000 / SMOOTH) return;
    if (this.ratio <= COARSEST) this.shadowsMove = mean < 1000 / SMOOTH_ENOUGH;
    this.ratio = Math.max(COARSEST, 0.8 * this.ratio);
    this.frames = [];
    this.resize();
  }

  private setTime(time: number): void {
    this.time = time;
    this.worlds.forEach((world) => world.move(time));
    if (this.followed !== null) this.camera.follow(this.worlds[0].bodies[this.followed].position);
    // In motion the clock and the plots' cursors may take every third frame: laying them out costs.
    const now = performance.now();
    if (!this.playing || now - this.told > 45) {
      this.told = now;
      this.tell(time);
    }
    this.stale = true;
  }

  private tell(time: number): void {
    this.panel.move(time);
    byId<HTMLInputElement>("scrub").value = String(time);
    byId("clock").textContent = `${time.toFixed(this.digits)} / ${this.span[1].toFixed(this.digits)} s`;
  }

  private get digits(): number {
    const length = this.span[1] - this.span[0];
    return length > 0 ? Math.max(2, Math.min(7, 3 - Math.floor(Math.log10(length)))) : 3;
  }

  seek(time: number): void {
    this.newest = this.data.live && time >= this.span[1];
    this.setTime(Math.min(this.span[1], Math.max(this.span[0], time)));
  }

  play(on: boolean): void {
    if (on && this.time >= this.span[1]) this.setTime(this.span[0]);
    if (on) this.newest = false;
    this.playing = on;
    this.frames = [];
    this.tell(this.time);
    if (this.ratio !== this.sharpest) this.resize();
    const button = byId("play");
    button.innerHTML = on ? ICONS.pause : ICONS.play;
    button.setAttribute("aria-label", on ? "pause" : "play");
  }

  private step(frames: number): void {
    this.play(false);
    const run = this.runs.find((one) => endOf(one) === this.span[1]) ?? this.run;
    const { frame, part } = placeAt(run, this.time);
    const to = frame + Math.round(part) + frames;
    this.seek(run.start + run.times[Math.min(run.times.length - 1, Math.max(0, to))]);
  }

  private setSpeed(step: number): void {
    const at = SPEEDS.indexOf(this.speed);
    this.speed = SPEEDS[Math.min(SPEEDS.length - 1, Math.max(0, at + step))];
    byId<HTMLSelectElement>("speed").value = String(this.speed);
  }

  // --- picture

  private draw(): void {
    this.stale = false;
    const { camera, controls } = this.camera;
    this.floor.center(controls.target);
    const ground = this.floor.shadow(camera.position);
    const shadow = this.playing && !this.shadowsMove ? null : ground;
    camera.updateMatrixWorld();
    this.worlds[0].cast(new Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse), shadow);
    this.worlds[0].groundVisible = ground !== null || this.planar;
    this.floor.grid.visible = ground !== null || this.planar;
    this.renderer.render(this.scene, camera);
    this.drawn++;
    const names = this.run.bodies
      .map((body, k) => ({ name: body.name, at: this.worlds[0].bodies[k], center: body.center }))
      .filter(({ name }) => this.shows.labels || name === this.picked || name === this.hovered)
      .map(({ name, at, center }) => ({
        name,
        at: new Vector3(...center).applyQuaternion(at.quaternion).add(at.position),
        strong: name === this.picked || name === this.hovered,
      }));
    for (const element of this.run.elements) {
      if (element.name !== this.picked && element.name !== this.hovered) continue;
      const frame = element.frames[element.frames.length - 1];
      names.push({ name: element.name, at: this.worlds[0].placeOf(frame, new Vector3()), strong: true });
    }
    this.labels.move(names, camera, this.canvas.clientWidth, this.canvas.clientHeight);
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = byId("stage");
    if (!width || !height || this.job) return;
    this.renderer.setPixelRatio(this.playing ? this.ratio : this.sharpest);
    this.renderer.setSize(width, height, false);
    this.camera.resize(width, height);
    this.stale = true;
  }

  private fit(preset?: Preset): void {
    const following = this.followed !== null;
    this.camera.frame(this.worlds[0].points(!following), preset);
    if (following) this.camera.startFollowing(this.worlds[0].bodies[this.followed!].position);
    this.stale = true;
  }

  private setFollow(body: number | null): void {
    this.followed = body;
    if (body !== null) this.camera.startFollowing(this.worlds[0].bodies[body].position);
    byId("follow").setAttribute("aria-pressed", String(body !== null));
    byId("hint").textContent = body === null ? "" : `following ${this.run.bodies[body].name}`;
    this.stale = true;
  }

  private setTheme(dark: boolean): void {
    theme.now = dark ? DARK : LIGHT;
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    this.scene.background = new Color(theme.now.background);
    this.floor.paint();
    this.worlds.forEach((world) => world.paint());
    this.panel.redraw();
    this.stale = true;
  }

  private toggle(name: keyof Page["shows"]): void {
    this.shows[name] = !this.shows[name];
    byId(name).setAttribute("aria-pressed", String(this.shows[name]));
    this.worlds.forEach((world) => world.show(this.shows));
    this.setTime(this.time);
  }

  // --- picking

  select(name: string | null): void {
    this.picked = name;
    this.worlds.forEach((world) => world.pick(name));
    this.panel.show(name);
    if (name !== null) document.body.classList.add("open");
    this.setTime(this.time);
  }

  private hit(x: number, y: number): string | null {
    const bounds = this.canvas.getBoundingClientRect();
    const at = new Vector2(((x - bounds.left) / bounds.width) * 2 - 1, 1 - ((y - bounds.top) / bounds.height) * 2);
    const ray = new Raycaster();
    ray.setFromCamera(at, this.camera.camera);
    return this.worlds[0].hit(ray);
  }

  /** Where an item is in the window, px. */
  project(name: string): [number, number] {
    const world = this.worlds[0];
    const p = new Vector3();
    const body = this.run.bodies.findIndex((one) => one.name === name);
    if (body >= 0) p.set(...this.run.bodies[body].center).applyQuaternion(world.bodies[body].quaternion).add(world.bodies[body].position);
    else {
      const element = this.run.elements.find((one) => one.name === name)!;
      world.placeOf(element.frames[0], p);
    }
    p.project(this.camera.camera);
    const bounds = this.canvas.getBoundingClientRect();
    return [bounds.left + ((p.x + 1) / 2) * bounds.width, bounds.top + ((1 - p.y) / 2) * bounds.height];
  }

  // --- controls

  private addControls(): void {
    const { run } = this;
    byId("title").textContent = run.title;
    this.tellStatus();
    const button = (nav: string, id: string, label: string, content: string, act: () => void, pressed?: boolean) => {
      const one = document.createElement("button");
      one.id = id;
      one.title = label;
      one.setAttribute("aria-label", label);
      one.innerHTML = content;
      if (pressed !== undefined) one.setAttribute("aria-pressed", String(pressed));
      one.addEventListener("click", act);
      byId(nav).append(one);
    };
    if (!this.planar) {
      const presets: Preset[] = ["iso", "front", "side", "top"];
      presets.forEach((preset, k) =>
        button("views", preset, `view: ${preset} (${k + 1})`, preset, () => this.fit(preset)),
      );
    }
    button("views", "fit", "fit into the picture (F)", ICONS.fit, () => this.fit());
    button("views", "follow", "follow the picked body (G)", ICONS.follow, () => this.toggleFollow(), false);
    const shows = ["labels", "joints", "forces", "trails", "axes"] as const;
    const keys = { labels: "L", joints: "J", forces: "A", trails: "T", axes: "X" };
    const words = { labels: "names", joints: "joints", forces: "force arrows", trails: "trails", axes: "body axes" };
    shows.forEach((name) =>
      button("shows", name, `${words[name]} (${keys[name]})`, ICONS[name], () => this.toggle(name), this.shows[name]),
    );
    button("shows", "theme", "light or dark (D)", ICONS.theme, () => this.setTheme(!theme.now.dark));
    button("shows", "panelbutton", "channels (P)", ICONS.panel, () => this.togglePanel());
    button("shows", "helpbutton", "keys (?)", ICONS.help, () => this.help());
    byId("first").innerHTML = ICONS.first;
    byId("loop").innerHTML = ICONS.loop;
    byId("first").addEventListener("click", () => this.seek(this.span[0]));
    byId("play").addEventListener("click", () => this.play(!this.playing));
    byId("loop").addEventListener("click", () => this.toggleLoop());
    this.play(false);
    const scrub = byId<HTMLInputElement>("scrub");
    [scrub.min, scrub.max] = this.span.map(String);
    scrub.addEventListener("input", () => this.seek(Number(scrub.value)));
    const speed = byId<HTMLSelectElement>("speed");
    for (const value of SPEEDS) speed.add(new Option(`${value}×`, String(value), false, value === this.speed));
    speed.addEventListener("change", () => (this.speed = Number(speed.value)));
    this.setFollow(this.followed);
    this.addPointer();
    window.addEventListener("keydown", (event) => this.key(event));
    // What was pressed by the pointer leaves the space bar to the motion.
    window.addEventListener("click", (event) => event.detail && (event.target as HTMLElement).closest<HTMLElement>("button, summary")?.blur());
    if (this.runs.length > 1) {
      byId("legend").replaceChildren(
        ...this.runs.map((one, number) => {
          const line = document.createElement("div");
          const dot = document.createElement("i");
          dot.style.background = number ? GHOSTS_CSS[(number - 1) % 3] : "var(--ink)";
          line.append(dot, [one.file || one.name, one.method].filter(Boolean).join(" · "));
          return line;
        }),
      );
    }
  }

  private addPointer(): void {
    let down: [number, number] | null = null;
    this.canvas.addEventListener("pointerdown", (event) => (down = [event.clientX, event.clientY]));
    this.canvas.addEventListener("pointerup", (event) => {
      const moved = down ? Math.hypot(event.clientX - down[0], event.clientY - down[1]) : 99;
      down = null;
      if (moved < 5 && event.button === 0) this.select(this.hit(event.clientX, event.clientY));
    });
    let waiting = false;
    this.canvas.addEventListener("pointermove", (event) => {
      if (event.buttons || event.pointerType === "touch" || waiting || this.playing) return;
      waiting = true;
      requestAnimationFrame(() => {
        waiting = false;
        const name = this.hit(event.clientX, event.clientY);
        if (name === this.hovered) return;
        this.hovered = name;
        this.canvas.style.cursor = name ? "pointer" : "";
        this.stale = true;
      });
    });
    this.canvas.addEventListener("pointerleave", () => {
      this.hovered = null;
      this.stale = true;
    });
  }

  private toggleFollow(): void {
    const body = this.run.bodies.findIndex((one) => one.name === this.picked);
    if (body >= 0 && body !== this.followed) this.setFollow(body);
    else this.setFollow(this.followed === null ? (this.run.follow ?? 0) : null);
  }

  private toggleLoop(): void {
    this.looping = !this.looping;
    byId("loop").setAttribute("aria-pressed", String(this.looping));
  }

  private togglePanel(): void {
    document.body.classList.toggle(window.innerWidth < 720 ? "open" : "closed");
  }

  private help(): void {
    const dialog = byId<HTMLDialogElement>("help");
    const keys = [
      ["space", "play, pause"], ["← →", "one frame back, on; with shift ten"], ["home, end", "start, end"],
      [", .", "slower, faster"], ["1 2 3 4", "views: iso, front, side, top"], ["F", "fit into the picture"],
      ["G", "follow the picked body"], ["L J A T X", "names, joints, force arrows, trails, axes"],
      ["R", "repeat"], ["D", "light or dark"], ["P", "channels"], ["Esc", "pick nothing"],
    ];
    const rows = keys.map(([key, text]) => `<tr><th><kbd>${key}</kbd></th><td>${text}</td></tr>`).join("");
    dialog.innerHTML = `<form method="dialog"><h2>Keys</h2><table>${rows}</table><p>Drag turns, right drag or two fingers move, wheel or pinch zooms. Click or tap picks. Drag in a plot to move in time.</p>${this.exactness()}<button>close</button></form>`;
    dialog.showModal();
  }

  /** How far bodies are drawn from where the run has them. */
  private exactness(): string {
    const { missed } = this.run;
    if (!missed) return "";
    const [place, turn] = [missed[0] * 1e3, (missed[1] * 180) / Math.PI].map((value) => value.toPrecision(2));
    return `<p>Bodies are drawn to within ${place} mm and ${turn}° of the run.</p>`;
  }

  private key(event: KeyboardEvent): void {
    const at = event.target as HTMLElement;
    const field = at.closest?.("select, dialog") || (event.key === " " && at.closest?.("button, summary, a"));
    if (field || event.ctrlKey || event.metaKey || event.altKey) return;
    const many = event.shiftKey ? 10 : 1;
    const acts: Record<string, () => void> = {
      " ": () => this.play(!this.playing),
      ArrowLeft: () => this.step(-many),
      ArrowRight: () => this.step(many),
      Home: () => this.seek(this.span[0]),
      End: () => this.seek(this.span[1]),
      ",": () => this.setSpeed(-1),
      ".": () => this.setSpeed(1),
      "1": () => this.fit("iso"),
      "2": () => this.fit("front"),
      "3": () => this.fit("side"),
      "4": () => this.fit("top"),
      f: () => this.fit(),
      g: () => this.toggleFollow(),
      l: () => this.toggle("labels"),
      j: () => this.toggle("joints"),
      a: () => this.toggle("forces"),
      t: () => this.toggle("trails"),
      x: () => this.toggle("axes"),
      r: () => this.toggleLoop(),
      d: () => this.setTheme(!theme.now.dark),
      p: () => this.togglePanel(),
      "?": () => this.help(),
      Escape: () => this.select(null),
    };
    const act = acts[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!act) return;
    event.preventDefault();
    act();
  }

  /** What tests and pages around this one may ask. */
  get facts() {
    const page = this;
    return {
      get time() { return page.time; },
      get playing() { return page.playing; },
      get picked() { return page.picked; },
      get drawn() { return page.drawn; },
      /** Calls of the renderer for the last frame. */
      get calls() { return page.renderer.info.render.calls; },
      /** Triangles of the last frame. */
      get triangles() { return page.renderer.info.render.triangles; },
      get status() { return page.run.status; },
      get end() { return page.span[1]; },
      get ratio() { return page.ratio; },
      play: (on: boolean) => page.play(on),
      seek: (time: number) => page.seek(time),
      select: (name: string | null) => page.select(name),
      project: (name: string) => page.project(name),
      /** Position and Euler parameters of a body as it is drawn. */
      where: (name: string) => {
        const body = page.worlds[0].bodies.find((one) => one.name === name)!;
        const { x, y, z, w } = body.quaternion;
        return [...body.position.toArray(), w, x, y, z];
      },
    };
  }
}

function start(): void {
  const message = (text: string) => {
    const box = document.createElement("div");
    box.id = "message";
    box.textContent = text;
    byId("stage").append(box);
  };
  try {
    const page = new Page();
    Object.assign(window, { holonom: page.facts });
  } catch (error) {
    const text = error instanceof Error ? error.message : String(error);
    if (readData().job) void fetch("failed", { method: "POST", body: text });
    message(/webgl/i.test(text) ? "This browser has no WebGL, which the picture needs. Try another one, or switch on hardware acceleration." : `The page could not be shown: ${text}`);
    if (!/webgl/i.test(text)) console.error(error);
  }
  document.documentElement.dataset.ready = "true";
}

if (document.getElementById("holonom-data")!.textContent !== "null") start();
