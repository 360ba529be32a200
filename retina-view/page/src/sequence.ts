// Rendered sequences: frames one after another, the truth over them, a second run beside.

import { get, type StartDocument } from "./api";
import { colour, h, put, s } from "./dom";
import { extent, getCounts, getNumbers, histogram, type Numbers, type Stretch } from "./image";
import { type Look, Picture } from "./picture";
import { told } from "./rows";
import { checkbox, facts, field, Latest, remember, remembered, select, sequences, Shell } from "./shell";
import { drawTruth, type Layers, type Truth } from "./truth";

interface About {
  name: string;
  frames: number[];
  torn: number[];
  frames_of_sequence: number;
  record: { quality: string; compensation: string; backend: string; radiance_scale: number };
  layers: string[];
}

type Mode = "one" | "beside" | "blink" | "difference";

interface Kept extends Layers {
  frame: number;
  layer: string;
  stretch: Stretch;
  other: string;
  mode: Mode;
}

const BLINK_MS = 700;
/** When a folder that may be being rendered is read again, ms; later each time that nothing was new. */
const [SOON_MS, LATE_MS] = [4000, 120_000];
const BINS = 64;

export class Sequence {
  private readonly shell: Shell;
  private about: About | null = null;
  private other: About | null = null;
  private images: [Numbers | null, Numbers | null] = [null, null];
  private truths: [Truth | null, Truth | null] = [null, null];
  private readonly kept: Kept;
  private readonly pictures: [Picture, Picture];
  private readonly slider = h("input", { type: "range", min: 0, step: 1, value: 0, "data-key": "frame", "aria-label": "Frame" });
  private readonly number = h("output", {});
  private readonly cursor = h("p", { class: "readout", "data-key": "readout" }, "Point at the picture to read its values.");
  private readonly side = h("div", {});
  private readonly spread = h("div", {});
  private readonly stage = h("div", { class: "stage" });
  private readonly controls = h("div", { class: "controls" });
  private readonly loads: Latest<number>;
  private player = 0;
  private blinker = 0;
  private growing = 0;
  private second = false;
  private pointed: [number, number] | null = null;

  constructor(
    page: Element,
    private readonly at: string,
  ) {
    this.kept = remembered<Kept>(`sequence ${at}`, { frame: -1, layer: "counts", stretch: "linear", other: "", mode: "one", limb: true, axes: true, terminator: true, stars: true });
    this.shell = new Shell(page, "Sequence", at.replace(/^\d+\/?/, "") || "the given folder", "pane");
    this.pictures = [0, 1].map((k) => new Picture(`picture-${k}`, k === 0 ? "The frame" : "The frame of the other run", (x, y) => this.point(x, y))) as [Picture, Picture];
    this.loads = new Latest(
      (position) => this.load(position),
      (error) => {
        // Back to the frame that is shown.
        this.slider.value = String(Math.max(0, this.about?.frames.indexOf(this.kept.frame) ?? 0));
        this.shell.failed(error);
      },
    );
    this.slider.addEventListener("input", () => this.loads.ask(Number(this.slider.value)));
    document.addEventListener("keydown", (event) => this.key(event), { signal: this.shell.closed.signal });
    this.shell.main.append(
      h("section", { class: "look", "aria-label": "Frame" }, this.stage, h("div", { class: "player" }, h("button", { type: "button", "data-key": "play", click: () => this.play() }, "Play"), this.slider, this.number), this.cursor, this.controls),
      h("section", { class: "beside", "aria-label": "What is known of the frame" }, h("h2", {}, "Truth"), this.side, h("h2", {}, "Values"), this.spread),
    );
    void this.start().catch(this.shell.failed);
  }

  close(): void {
    window.clearInterval(this.player);
    window.clearInterval(this.blinker);
    window.clearTimeout(this.growing);
    this.shell.close();
  }

  private query(at: string): string {
    return `?at=${encodeURIComponent(at)}`;
  }

  private async start(): Promise<void> {
    const signal = this.shell.closed.signal;
    this.about = await get<About>(`/api/sequence${this.query(this.at)}`, signal);
    const start = await get<StartDocument>("/api/start", signal);
    const runs = sequences(start);
    this.grow();
    if (this.about.frames.length === 0) {
      put(this.stage, h("p", { class: "dim" }, "This folder holds no finished frame yet. The page reads it again by itself."));
      return;
    }
    this.slider.max = String(this.about.frames.length - 1);
    if (this.kept.layer !== "counts" && !this.about.layers.includes(this.kept.layer)) {
      this.kept.layer = "counts";
    }
    if (this.kept.other !== "" && runs.some(([path]) => path === this.kept.other)) {
      this.other = await get<About>(`/api/sequence${this.query(this.kept.other)}`, signal);
    } else {
      [this.kept.other, this.kept.mode] = ["", "one"];
    }
    this.drawControls(runs.filter(([path]) => path.replace(/\/$/, "") !== this.at.replace(/\/$/, "")));
    this.setMode(this.kept.mode);
    this.loads.ask(Math.max(0, this.about.frames.indexOf(this.kept.frame)));
  }

  /** Follows a run that is not finished: its new frames join the slider. */
  private grow(wait = SOON_MS): void {
    const about = this.about;
    if (!about || about.frames.length >= about.frames_of_sequence) {
      return;
    }
    this.growing = window.setTimeout(() => void this.readAgain(about, wait).catch(this.shell.failed), wait);
  }

  private async readAgain(before: About, waited: number): Promise<void> {
    const about = await get<About>(`/api/sequence${this.query(this.at)}`, this.shell.closed.signal);
    if (before.frames.length === 0 && about.frames.length > 0) {
      await this.start();
      return;
    }
    if (about.frames.length === before.frames.length) {
      this.grow(Math.min(LATE_MS, 2 * waited));
      return;
    }
    this.about = about;
    this.slider.max = String(about.frames.length - 1);
    this.slider.value = String(Math.max(0, about.frames.indexOf(this.kept.frame)));
    this.tell();
    this.grow();
  }

  private drawControls(runs: [string, string][]): void {
    const layers: [string, string][] = [["counts", "digital count"], ...(this.about?.layers ?? []).map((name): [string, string] => [name, LAYERS[name] ?? name])];
    const over = (key: keyof Layers, label: string): HTMLElement =>
      checkbox(`over-${key}`, label, this.kept[key], (value) => {
        this.kept[key] = value;
        this.draw();
      });
    const modes: [string, string][] = [["one", "alone"], ["beside", "side by side"], ["blink", "blinking"], ["difference", "difference"]];
    put(
      this.controls,
      field("Show", select("layer", layers, this.kept.layer, (value) => {
        this.kept.layer = value;
        this.loads.ask(Number(this.slider.value));
      })),
      field("Stretch", select("stretch", [["linear", "linear"], ["root", "square root"], ["log", "logarithm"]], this.kept.stretch, (value) => {
        this.kept.stretch = value as Stretch;
        this.draw();
      })),
      over("limb", "limb"),
      over("terminator", "terminator"),
      over("axes", "axes"),
      over("stars", "stars"),
      runs.length === 0
        ? h("span", { class: "dim" }, "Give a second rendered folder to `retina view` to compare two runs.")
        : field("Second run", select("other", [["", "none"], ...runs], this.kept.other, (value) => void this.choose(value).catch(this.shell.failed))),
      runs.length === 0 ? null : field("Together", select("mode", modes, this.kept.mode, (value) => this.setMode(value as Mode))),
    );
  }

  private async choose(other: string): Promise<void> {
    this.kept.other = other;
    this.other = other === "" ? null : await get<About>(`/api/sequence${this.query(other)}`, this.shell.closed.signal);
    if (other === "") {
      this.setMode("one");
    } else if (this.kept.mode === "one") {
      this.setMode("beside");
    }
    const mode = this.controls.querySelector<HTMLSelectElement>('[data-key="mode"]');
    if (mode) mode.value = this.kept.mode;
    this.loads.ask(Number(this.slider.value));
  }

  private setMode(mode: Mode): void {
    this.kept.mode = this.other ? mode : "one";
    window.clearInterval(this.blinker);
    this.second = false;
    if (this.kept.mode === "blink" && !window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      this.blinker = window.setInterval(() => {
        this.second = !this.second;
        this.draw();
      }, BLINK_MS);
    }
    const beside = this.kept.mode === "beside";
    this.stage.classList.toggle("two", beside);
    put(this.stage, this.pictures[0].canvas, beside ? this.pictures[1].canvas : null);
    this.draw();
  }

  private async one(at: string, about: About, frame: number): Promise<Numbers | null> {
    const signal = this.shell.closed.signal;
    if (!about.frames.includes(frame)) {
      return null;
    }
    if (this.kept.layer !== "counts" && !about.layers.includes(this.kept.layer)) {
      return null;
    }
    if (this.kept.layer !== "counts") {
      return (await getNumbers(`/api/sequence/layer/${frame}/${encodeURIComponent(this.kept.layer)}${this.query(at)}`, "f32", undefined, signal)).image;
    }
    return getCounts(`/api/sequence/image/${frame}${this.query(at)}`, signal);
  }

  private async load(position: number): Promise<void> {
    const about = this.about;
    const frame = about?.frames[position];
    if (!about || frame === undefined) {
      return;
    }
    this.slider.value = String(position);
    const signal = this.shell.closed.signal;
    const truth = (at: string): Promise<Truth> => get<Truth>(`/api/sequence/truth/${frame}${this.query(at)}`, signal);
    const [image, other, own, theirs] = await Promise.all([
      this.one(this.at, about, frame),
      this.other ? this.one(this.kept.other, this.other, frame) : null,
      truth(this.at),
      this.other?.frames.includes(frame) ? truth(this.kept.other) : null,
    ]);
    this.shell.mended();
    [this.images, this.truths, this.kept.frame] = [[image, other], [own, theirs], frame];
    this.number.textContent = `frame ${frame}`;
    this.slider.setAttribute("aria-valuetext", `frame ${frame}`);
    this.draw();
    this.tell();
  }

  private look(image: Numbers): Look {
    // Counts have one scale for the whole sequence; a layer shows what it holds.
    const counts = this.kept.layer === "counts";
    return { stretch: this.kept.stretch, range: counts ? [0, 255] : extent(image), signed: false };
  }

  private draw(): void {
    remember(`sequence ${this.at}`, this.kept);
    const [image, other] = this.images;
    const [truth, theirs] = this.truths;
    if (!image || !truth) {
      return;
    }
    const over = drawTruth(truth, this.kept);
    const overOther = theirs ? drawTruth(theirs, this.kept) : null;
    const look = this.look(image);
    if (this.kept.mode === "difference" && other && other.values.length === image.values.length) {
      const values = Float32Array.from(image.values, (value, k) => (other.values[k] as number) - value);
      const difference = { ...image, values };
      const most = scaleOf(values);
      this.pictures[0].show(difference, { stretch: "linear", range: [-most, most], signed: true }, over);
      put(this.spread, drawHistogram(difference, [-most, most]), h("p", { class: "dim" }, `Other run less this one. Blue is ${told(-most)} and below, orange ${told(most)} and above.`));
    } else {
      const second = this.second && other !== null;
      this.pictures[0].show(second ? other : image, look, second ? overOther : over);
      put(this.spread, drawHistogram(image, look.range ?? extent(image)));
    }
    if (this.kept.mode === "beside" && other) {
      this.pictures[1].show(other, look, overOther);
    } else {
      this.pictures[1].clear();
    }
  }

  private point(x: number, y: number): void {
    this.pointed = [x, y];
    this.tellPoint();
  }

  private tellPoint(): void {
    if (!this.pointed) {
      return;
    }
    const [x, y] = this.pointed;
    const read = (image: Numbers | null): string => {
      const value = image && x < image.width && y < image.height ? image.values[y * image.width + x] : undefined;
      return value === undefined || !Number.isFinite(value) ? "none" : image?.values instanceof Float32Array ? String(Number(value.toPrecision(6))) : String(value);
    };
    const name = this.kept.layer === "counts" ? "digital count" : (LAYERS[this.kept.layer] ?? this.kept.layer);
    const other = this.other ? `, other run ${read(this.images[1])}` : "";
    const second = this.kept.mode === "blink" && this.second ? " (shown: the other run)" : "";
    put(this.cursor, `Pixel (${x}, ${y}): ${name} ${read(this.images[0])}${other}${second}`);
  }

  private tell(): void {
    const [truth, about] = [this.truths[0], this.about];
    if (!truth || !about) {
      return;
    }
    this.tellPoint();
    const rows: [string, string][] = [["Epoch", truth.epoch_tdb], ["Time", `${truth.time_s.toFixed(3)} s TDB since J2000`]];
    for (const [name, body] of Object.entries(truth.bodies)) {
      rows.push([`${name}: distance`, `${told(body.distance_m / 1e3)} km`], ["phase angle", `${body.phase_deg.toFixed(3)} deg`]);
      if (body.limb_ellipse_px) {
        rows.push(["limb, semi-axes", `${body.limb_ellipse_px.semi_axes_px.map((v) => v.toFixed(2)).join(" x ")} px`]);
      }
    }
    rows.push(["Stars and planets", String(truth.stars.length)], ["Radiance scale", truth.radiance_scale.toExponential(4)], ["Compensation", truth.compensation], ["Quality, renderer", `${about.record.quality}, ${about.record.backend}`], ["Frames here", `${about.frames.length} of ${about.frames_of_sequence}`]);
    if (about.torn.length > 0) {
      rows.push(["Torn frames", about.torn.slice(0, 8).join(", ")]);
    }
    const distorted = truth.compensation !== "none" ? h("p", { class: "dim" }, "The frame is compensated for the facility's distortion; the truth is drawn in the undistorted image, as the camera sees it.") : null;
    put(this.side, facts(rows), distorted);
  }

  private play(): void {
    const button = this.shell.main.querySelector('[data-key="play"]');
    if (this.player !== 0) {
      window.clearInterval(this.player);
      this.player = 0;
    } else {
      this.player = window.setInterval(() => this.go(1, true), 200);
    }
    if (button) {
      button.textContent = this.player === 0 ? "Play" : "Pause";
    }
  }

  private go(by: number, around: boolean): void {
    const count = this.about?.frames.length ?? 0;
    const next = Number(this.slider.value) + by;
    if (next >= 0 && next < count) {
      this.slider.value = String(next);
      this.loads.ask(next);
    } else if (around) {
      this.slider.value = "0";
      this.loads.ask(0);
    }
  }

  /** Page up and down go through the frames, the space bar plays, `b` changes what blinks, wherever one is. */
  private key(event: KeyboardEvent): void {
    const here = event.target instanceof HTMLElement ? event.target.tagName : "";
    if (event.key === "PageDown" || event.key === "PageUp") {
      event.preventDefault();
      this.go(event.key === "PageDown" ? 1 : -1, false);
    } else if (event.key === "b" && this.kept.mode === "blink") {
      this.second = !this.second;
      this.draw();
      this.tellPoint();
    } else if (event.key === " " && !["BUTTON", "SELECT", "INPUT", "SUMMARY"].includes(here)) {
      event.preventDefault();
      this.play();
    }
  }
}

const LAYERS: Record<string, string> = { Y: "radiance (W m^-2 sr^-1 nm^-1)", IF: "radiance factor", depth: "depth (m)", mask: "mask", incidence_deg: "incidence (deg)", emission_deg: "emission (deg)", phase_deg: "phase angle (deg)", shadow: "shadow" };

/** What few of the differences exceed: those of shadows' edges would hide the rest. */
function scaleOf(values: Float32Array): number {
  const sizes = values.filter((value) => Number.isFinite(value) && value !== 0).map(Math.abs).sort();
  return sizes[Math.floor(0.99 * (sizes.length - 1))] ?? 1;
}

/** How often each value comes, on a logarithmic scale. */
function drawHistogram(image: Numbers, range: [number, number]): HTMLElement {
  const counts = histogram(image, range, BINS);
  const most = Math.log1p(counts.reduce((a, b) => Math.max(a, b), 1));
  const bars = [...counts].map((count, k) => {
    const height = (100 * Math.log1p(count)) / most;
    return s("rect", { x: (300 * k) / BINS, y: 100 - height, width: 300 / BINS - 0.6, height, fill: colour("bar") });
  });
  return h("figure", { class: "histogram" }, s("svg", { viewBox: "0 0 300 100", preserveAspectRatio: "none", role: "img", "aria-label": "Histogram of the values" }, ...bars) as unknown as HTMLElement, h("figcaption", { class: "dim" }, `${told(range[0])} to ${told(range[1])}; pixels a bin on a logarithmic scale`));
}
