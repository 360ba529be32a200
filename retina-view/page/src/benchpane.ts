// The bench: what the screen shows, what the camera makes of it with each part switched on, and the image of one point.

import { get, type StartDocument } from "./api";
import { h, put } from "./dom";
import { getNumbers, type Numbers, type Stretch } from "./image";
import { type Over, Picture } from "./picture";
import { checkbox, facts, field, Latest, remember, remembered, select, sequences, Shell } from "./shell";

interface Facts {
  seconds: number;
  built_s: number;
  exposure_s: number;
  saturated_px: number;
  largest_dn: number;
}

interface SpotFacts {
  screen_px: [number, number];
  landed_px: Record<"r" | "g" | "b", [number, number] | null>;
  without_distortion_px: [number, number];
  corner_px: [number, number];
  centroid_px: [number, number];
  rms_px: number;
  rms_um: number;
  brightest_share: number;
  shown_share: number;
}

interface Kept {
  setup: string;
  screen: string;
  frame: number;
  columns: number;
  count: number;
  points: "point" | "diffraction" | "full";
  ghosts: boolean;
  noise: boolean;
  exposure_s: number | null;
  stretch: Stretch;
  mode: "screen" | "camera" | "blink";
}

const BLINK_MS = 900;

export class BenchPane {
  private readonly shell: Shell;
  private readonly kept: Kept;
  private runs: [string, string][] = [];
  /** Frames of the run that the screen shows. */
  private frames: number[] = [];
  private images: { screen: Numbers | null; camera: Numbers | null } = { screen: null, camera: null };
  private exposure: Facts | null = null;
  private spot: SpotFacts | null = null;
  private blinker = 0;
  private second = false;
  private readonly picture = new Picture("picture", "Screen or camera", (x, y, value) => put(this.readout, `${this.showsCamera() ? "Camera" : "Screen"} pixel (${x}, ${y}): ${this.showsCamera() ? "digital number" : "digital count"} ${value}`));
  private readonly spotPicture = new Picture("spot", "The image of one screen pixel", (_x, _y, value) => put(this.spotReadout, `${(100 * value).toFixed(2)} % of the light`));
  private readonly readout = h("p", { class: "readout" }, "Press a place of the screen to see the image of that point.");
  private readonly spotReadout = h("p", { class: "readout" });
  private readonly controls = h("div", { class: "controls" });
  private readonly side = h("div", {});
  private readonly spotSide = h("div", {}, h("p", { class: "dim" }, "Show the screen and press a place in it, or move the cursor by the arrow keys and press Enter."));
  private readonly exposures: Latest<null>;
  private readonly spots: Latest<[number, number]>;

  constructor(page: Element, at: string) {
    this.kept = remembered<Kept>(`bench ${at}`, { setup: at, screen: "grid", frame: 0, columns: 24, count: 255, points: "full", ghosts: true, noise: true, exposure_s: null, stretch: "root", mode: "camera" });
    this.kept.setup = at;
    this.shell = new Shell(page, "Bench", at.replace(/^\d+\/?/, "") || "the given setup", "pane");
    this.exposures = new Latest(
      () => this.expose(),
      (error) => {
        put(this.side);
        this.shell.failed(error);
      },
    );
    this.spots = new Latest((place) => this.showSpot(place), this.shell.failed);
    this.picture.pressed = (x, y) => {
      if (!this.showsCamera()) {
        this.spots.ask([x, y]);
      }
    };
    this.shell.main.append(
      h("section", { class: "look", "aria-label": "Screen and camera" }, h("div", { class: "stage" }, this.picture.canvas), this.readout, this.controls),
      h("section", { class: "beside", "aria-label": "Exposure and point" }, h("h2", {}, "Exposure"), this.side, h("h2", {}, "One point"), this.spotSide),
    );
    void this.start().catch(this.shell.failed);
  }

  close(): void {
    window.clearInterval(this.blinker);
    this.shell.close();
  }

  private showsCamera(): boolean {
    return this.kept.mode === "camera" || (this.kept.mode === "blink" && this.second);
  }

  private async start(): Promise<void> {
    this.runs = sequences(await get<StartDocument>("/api/start", this.shell.closed.signal));
    await this.show(this.runs.some(([path]) => path === this.kept.screen) ? this.kept.screen : "grid");
    this.setMode(this.kept.mode);
  }

  /** The screen shows the grid, or a frame of a run. */
  private async show(screen: string): Promise<void> {
    if (screen !== "grid") {
      ({ frames: this.frames } = await get<{ frames: number[] }>(`/api/sequence?at=${encodeURIComponent(screen)}`, this.shell.closed.signal));
      this.kept.frame = this.nearest(this.kept.frame);
    }
    this.kept.screen = screen;
    this.drawControls();
    this.set("screen", screen);
  }

  private nearest(wanted: number): number {
    return this.frames.reduce((best, frame) => (Math.abs(frame - wanted) < Math.abs(best - wanted) ? frame : best), this.frames[0] ?? 0);
  }

  private set<K extends keyof Kept>(key: K, value: Kept[K]): void {
    this.kept[key] = value;
    remember(`bench ${this.kept.setup}`, this.kept);
    this.exposures.ask(null);
  }

  private drawControls(): void {
    const { runs } = this;
    const grid = this.kept.screen === "grid";
    const number = (key: "columns" | "count", label: string, low: number, high: number): HTMLElement => {
      const input = h("input", { type: "number", min: low, max: high, step: 1, value: this.kept[key], "data-key": key });
      input.addEventListener("change", () => this.set(key, Math.min(high, Math.max(low, Math.round(Number(input.value) || low)))));
      return field(label, input);
    };
    const frame = h("input", { type: "number", min: this.frames[0] ?? 0, max: this.frames.at(-1) ?? 0, step: 1, value: this.kept.frame, "data-key": "frame" });
    frame.addEventListener("change", () => {
      const nearest = this.nearest(Number(frame.value) || 0);
      frame.value = String(nearest);
      this.set("frame", nearest);
    });
    const some = this.frames.length < 6 ? this.frames.join(", ") : `${this.frames.length} from ${this.frames[0]} to ${this.frames.at(-1)}`;
    const exposure = h("input", { type: "number", min: 0, step: "any", placeholder: "automatic", value: this.kept.exposure_s, "data-key": "exposure" });
    exposure.addEventListener("change", () => this.set("exposure_s", Number(exposure.value) > 0 ? Number(exposure.value) : null));
    put(
      this.controls,
      field("Look at", select("mode", [["camera", "the camera"], ["screen", "the screen"], ["blink", "both, blinking"]], this.kept.mode, (value) => this.setMode(value as Kept["mode"]))),
      field("Screen shows", select("screen", [["grid", "a grid of single pixels"], ...runs], this.kept.screen, (value) => void this.show(value).catch(this.shell.failed))),
      grid ? number("columns", "Points along x", 1, 200) : field(`Frame (${some})`, frame),
      grid ? number("count", "Digital count", 1, 255) : null,
      field("A point's image", select("points", [["point", "a point"], ["diffraction", "diffraction alone"], ["full", "diffraction and aberrations"]], this.kept.points, (value) => {
        this.set("points", value as Kept["points"]);
        if (this.spot) {
          this.spots.ask(this.spot.screen_px);
        }
      })),
      checkbox("ghosts", "ghosts and glare", this.kept.ghosts, (value) => this.set("ghosts", value)),
      checkbox("noise", "noise", this.kept.noise, (value) => this.set("noise", value)),
      field("Exposure, s", exposure),
      field("Stretch", select("stretch", [["linear", "linear"], ["root", "square root"], ["log", "logarithm"]], this.kept.stretch, (value) => {
        this.kept.stretch = value as Stretch;
        this.draw();
      })),
    );
  }

  private setMode(mode: Kept["mode"]): void {
    this.kept.mode = mode;
    remember(`bench ${this.kept.setup}`, this.kept);
    window.clearInterval(this.blinker);
    if (mode === "blink" && !window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.blinker = window.setInterval(() => {
        this.second = !this.second;
        this.draw();
      }, BLINK_MS);
    }
    this.draw();
  }

  private asked(): unknown {
    const { setup, screen, frame, columns, count, points, ghosts, noise, exposure_s } = this.kept;
    const shown = screen === "grid" ? { grid: { columns, digital_count: count } } : { frame: { at: screen, frame } };
    return { setup, screen: shown, points, ghosts, noise, exposure_s };
  }

  private async expose(): Promise<void> {
    put(this.side, h("p", { class: "dim" }, "Exposing ... (the first exposure traces the optics)"));
    const signal = this.shell.closed.signal;
    const [screen, camera] = await Promise.all([getNumbers("/api/bench/screen", "u8", this.asked(), signal), getNumbers<Facts>("/api/bench/image", "u16", this.asked(), signal)]);
    this.shell.mended();
    this.images = { screen: screen.image, camera: camera.image };
    this.exposure = camera.facts;
    this.draw();
    const found = camera.facts;
    put(
      this.side,
      facts([
        ["Exposure", `${found.exposure_s.toPrecision(4)} s${this.kept.exposure_s === null ? ", by the brightest pixel" : ""}`],
        ["Full pixels", String(found.saturated_px)],
        ["Largest digital number", String(found.largest_dn)],
        ["Time", `${found.seconds.toFixed(2)} s${found.built_s > 0 ? `, and ${found.built_s.toFixed(1)} s to trace the optics` : ""}`],
      ]),
    );
    this.picture.canvas.dataset["exposed"] = String(Number(this.picture.canvas.dataset["exposed"] ?? 0) + 1);
  }

  private draw(): void {
    const { screen, camera } = this.images;
    if (!screen || !camera) {
      return;
    }
    const mark = (at: [number, number] | null): Over | null =>
      at &&
      ((c, to, scale) => {
        const [x, y] = to(...at);
        c.strokeStyle = "#ffb454";
        c.lineWidth = 2;
        c.beginPath();
        c.arc(x, y, Math.max(9, 14 * scale), 0, 2 * Math.PI);
        c.stroke();
      });
    if (this.showsCamera()) {
      this.picture.show(camera, { stretch: this.kept.stretch, range: [0, this.exposure?.largest_dn ?? 4095], signed: false }, mark(this.spot?.centroid_px ?? null));
    } else {
      this.picture.show(screen, { stretch: this.kept.stretch, range: [0, 255], signed: false }, mark(this.spot?.screen_px ?? null));
    }
  }

  private async showSpot(place: [number, number]): Promise<void> {
    const { image, facts: spot } = await getNumbers<SpotFacts>("/api/bench/spot", "f32", { setup: this.kept.setup, points: this.kept.points, screen_px: place }, this.shell.closed.signal);
    this.shell.mended();
    this.spot = spot;
    const pair = (at: [number, number] | null): string => (at ? `(${at[0].toFixed(3)}, ${at[1].toFixed(3)})` : "off the sensor");
    const bent = Math.hypot(spot.landed_px.g ? spot.landed_px.g[0] - spot.without_distortion_px[0] : NaN, spot.landed_px.g ? spot.landed_px.g[1] - spot.without_distortion_px[1] : NaN);
    put(
      this.spotSide,
      this.spotPicture.canvas,
      this.spotReadout,
      facts([
        ["Screen pixel", pair(spot.screen_px)],
        ["Lands at, green", pair(spot.landed_px.g)],
        ["red", pair(spot.landed_px.r)],
        ["blue", pair(spot.landed_px.b)],
        ["Without distortion", pair(spot.without_distortion_px)],
        ["Distortion", `${bent.toFixed(2)} px`],
        ["Centroid", pair(spot.centroid_px)],
        ["RMS radius", `${spot.rms_px.toFixed(2)} px, ${spot.rms_um.toFixed(2)} um`],
        ["Brightest pixel", `${(100 * spot.brightest_share).toFixed(2)} % of the light`],
        ["Within what is shown", `${(100 * spot.shown_share).toFixed(1)} %`],
      ]),
    );
    this.spotPicture.show(image, { stretch: "root", range: [0, spot.brightest_share], signed: false }, null);
    this.draw();
  }
}
