// A scene by hand: the camera about a body, the Sun, the photometry. Drafts while one turns, then the full frame.

import { get, post } from "./api";
import { h, put, tell } from "./dom";
import { getNumbers, type Numbers } from "./image";
import { Picture } from "./picture";
import { told } from "./rows";
import { checkbox, download, field, Latest, remember, remembered, select, Shell, slider, type Slider } from "./shell";
import { type Body, drawTruth, type Intrinsics, type Layers } from "./truth";

interface View {
  distance_m: number;
  longitude_deg: number;
  latitude_deg: number;
  north_deg: number;
  offset_px: [number, number];
  phase_deg: number;
  sun_deg: number;
}

interface About {
  name: string;
  bodies: string[];
  body: string;
  radius_m: number;
  frames: number;
  photometry: string | null;
  view: View;
  image_px: { fx: number; width: number; height: number };
}

interface Facts {
  seconds: number;
  radiance_scale: number;
  saturated_px: number;
  renderer: string;
  image_px: Intrinsics;
  bodies: Record<string, Body>;
}

/** How long one holds still before the full frame is asked for, ms. */
const STILL_MS = 350;

/** Photometric laws to begin with; the keys stand in the reference of scenes. */
const LAWS: [string, string][] = [
  ["lambert", '{ model = "lambert", normal_albedo = 0.12 }'],
  ["lommel-seeliger", '{ model = "lommel-seeliger", normal_albedo = 0.12 }'],
  ["lunar-lambert", '{ model = "lunar-lambert", normal_albedo = 0.12 }'],
  ["oren-nayar", '{ model = "oren-nayar", normal_albedo = 0.12, roughness_deg = 20 }'],
  ["hapke", '{ model = "hapke", normal_albedo = 0.12 }'],
  ["minnaert", '{ model = "minnaert", normal_albedo = 0.12, k = 0.7 }'],
  ["akimov", '{ model = "akimov", normal_albedo = 0.12 }'],
];

const wrap = (degrees: number): number => ((((degrees + 180) % 360) + 360) % 360) - 180;

export class LivePane {
  private readonly shell: Shell;
  private about: About | null = null;
  private view: View | null = null;
  private frame = 0;
  private photometry: string | null = null;
  private sliders: Partial<Record<keyof View | "x" | "y", Slider>> = {};
  private still = 0;
  private times: number[] = [];
  private over: Layers = { limb: false, terminator: false, axes: false, stars: false };
  private shown: { image: Numbers; facts: Facts } | null = null;
  private readonly picture = new Picture("picture", "The scene", (x, y, value) => put(this.readout, `Pixel (${x}, ${y}): digital count ${value}`));
  private readonly readout = h("p", { class: "readout" }, "Drag to turn the body, with Shift to turn the Sun; the wheel changes the distance.");
  private readonly state = h("p", { class: "dim", "data-key": "state" });
  private readonly controls = h("div", { class: "sliders" });
  private readonly frames: Latest<boolean>;

  constructor(
    page: Element,
    private readonly at: string,
  ) {
    this.shell = new Shell(page, "Live scene", at.replace(/^\d+\/?/, "") || "the given scene", "pane");
    this.frames = new Latest((full) => this.render(full), this.shell.failed);
    this.picture.dragged = (dx, dy, shift) => this.drag(dx, dy, shift);
    this.picture.dropped = () => this.letGo();
    this.picture.wheeled = (delta) => this.change({ distance_m: (this.view?.distance_m ?? 1) * 1.001 ** delta }, true);
    this.shell.main.append(
      h("section", { class: "look", "aria-label": "Scene" }, h("div", { class: "stage" }, this.picture.canvas), this.readout, this.state),
      h("section", { class: "beside", "aria-label": "Camera, Sun and surface" }, this.controls),
    );
    void this.start(null, null).catch(this.shell.failed);
  }

  close(): void {
    window.clearTimeout(this.still);
    this.shell.close();
  }

  private async start(body: string | null, frame: number | null): Promise<void> {
    put(this.state, "Opening the scene ...");
    const kept = remembered<{ body: string; frame: number; view: View | null; photometry: string | null }>(`scene ${this.at}`, { body: "", frame: 0, view: null, photometry: null });
    const begun = body === null && frame === null;
    const ask = (wanted: string, at: number): Promise<About> =>
      get<About>(`/api/scene?at=${encodeURIComponent(this.at)}&frame=${at}&anew=${begun}${wanted === "" ? "" : `&body=${encodeURIComponent(wanted)}`}`, this.shell.closed.signal);
    const before = this.about?.body;
    this.frame = frame ?? kept.frame;
    let again = begun;
    try {
      this.about = await ask(body ?? kept.body, this.frame);
    } catch (error) {
      // What is remembered may be of another file of this name.
      if (!begun || (kept.body === "" && kept.frame === 0)) {
        throw error;
      }
      [this.frame, again] = [0, false];
      this.about = await ask("", 0);
    }
    this.view = (again ? kept.view : null) ?? this.about.view;
    if (again) {
      this.photometry = kept.photometry;
    } else if (begun || this.about.body !== before) {
      // A law belongs to its body.
      this.photometry = null;
    }
    this.drawControls();
    this.frames.ask(false);
    this.letGo();
  }

  private drawControls(): void {
    const [about, view] = [this.about, this.view];
    if (!about || !view) {
      return;
    }
    const angle = (key: "longitude_deg" | "latitude_deg" | "north_deg" | "phase_deg" | "sun_deg", label: string, low: number, high: number): HTMLElement => {
      const own = slider(key, label, { low, high, digits: 2 }, view[key], (value) => this.change({ [key]: value }, false), () => this.letGo());
      this.sliders[key] = own;
      return own.element;
    };
    const offset = (k: 0 | 1, label: string, size: number): HTMLElement => {
      const own = slider(k === 0 ? "offset-x" : "offset-y", label, { low: -size, high: size, digits: 1 }, view.offset_px[k], (value) => this.change({ offset_px: k === 0 ? [value, this.view?.offset_px[1] ?? 0] : [this.view?.offset_px[0] ?? 0, value] }, false), () => this.letGo());
      this.sliders[k === 0 ? "x" : "y"] = own;
      return own.element;
    };
    // From where the body nearly fills the image to where it is a few pixels.
    const fills = (2 * about.radius_m * about.image_px.fx) / about.image_px.height;
    const [low, high] = [Math.max(1.05 * about.radius_m, 0.3 * fills), 100 * fills].map((m) => m / 1e3) as [number, number];
    const distance = slider("distance", "Distance, km", { low: Math.min(low, view.distance_m / 2e3), high: Math.max(high, view.distance_m / 500), log: true, digits: 3 }, view.distance_m / 1e3, (value) => this.change({ distance_m: 1e3 * value }, false), () => this.letGo());
    this.sliders.distance_m = distance;
    const surface = h("textarea", { rows: 3, spellcheck: "false", "data-key": "photometry", "aria-label": "Photometry, a TOML table" });
    surface.value = this.photometry ?? about.photometry ?? "";
    const apply = (): void => {
      this.photometry = surface.value.trim() === "" ? null : surface.value;
      this.letGo(0);
    };
    const last = about.frames - 1;
    const frame = h("input", { type: "number", min: 0, max: last, step: 1, "data-key": "scene-frame", value: this.frame });
    frame.addEventListener("change", () => void this.start(about.body, Math.min(last, Math.max(0, Math.round(Number(frame.value) || 0)))).catch(this.shell.failed));
    const over = (key: "limb" | "terminator" | "axes"): HTMLElement =>
      checkbox(`over-${key}`, key, this.over[key], (value) => {
        this.over[key] = value;
        this.draw();
      });
    put(
      this.controls,
      h("p", { class: "buttons" }, over("limb"), over("terminator"), over("axes")),
      h("h2", {}, "Camera"),
      about.bodies.length > 1 ? field("About", select("body", about.bodies.map((name): [string, string] => [name, name]), about.body, (name) => void this.start(name, this.frame).catch(this.shell.failed))) : null,
      distance.element,
      angle("longitude_deg", "Longitude below, deg", -180, 180),
      angle("latitude_deg", "Latitude below, deg", -90, 90),
      angle("north_deg", "North in the image, deg", -180, 180),
      offset(0, "Off the middle, x, px", about.image_px.width / 2),
      offset(1, "Off the middle, y, px", about.image_px.height / 2),
      h("h2", {}, "Sun"),
      angle("phase_deg", "Phase angle, deg", 0, 180),
      angle("sun_deg", "Sun in the image, deg", -180, 180),
      h("h2", {}, "Surface"),
      field("Begin with", select("law", [["", "the scene's own"], ...LAWS.map(([name]): [string, string] => [name, name])], "", (name) => {
        surface.value = LAWS.find(([own]) => own === name)?.[1] ?? about.photometry ?? "";
        apply();
      })),
      surface,
      h("button", { type: "button", "data-key": "apply", click: apply }, "Apply"),
      h("h2", {}, "The pose"),
      field(`As in frame, 0 to ${last}`, frame),
      h(
        "p",
        { class: "buttons" },
        h("button", { type: "button", "data-key": "again", click: () => void this.start(about.body, this.frame).catch(this.shell.failed) }, "Back to the frame"),
        h("button", { type: "button", class: "primary", "data-key": "save", click: () => void this.save().catch(this.shell.failed) }, "Save pose.csv and scene.toml"),
      ),
      h("p", { class: "dim" }, "Put both files into the folder of the scene's own, under names that are free there; then `retina render` shows this view."),
    );
  }

  private asked(full: boolean): unknown {
    return { at: this.at, body: this.about?.body ?? "", frame: this.frame, view: this.view, photometry: this.photometry, full };
  }

  private async save(): Promise<void> {
    const files = await post<Record<string, string>>("/api/scene/pose", this.asked(false));
    for (const [name, text] of Object.entries(files)) {
      download(name, text);
    }
    tell("pose.csv and scene.toml were saved");
  }

  /** Goes on from this view; its sliders follow what was changed elsewhere. */
  private change(part: Partial<View>, everywhere: boolean): void {
    if (!this.view) {
      return;
    }
    this.view = { ...this.view, ...part };
    if (everywhere) {
      for (const key of ["longitude_deg", "latitude_deg", "north_deg", "phase_deg", "sun_deg"] as const) {
        this.sliders[key]?.set(this.view[key]);
      }
      this.sliders.distance_m?.set(this.view.distance_m / 1e3);
    }
    this.frames.ask(false);
    this.letGo();
  }

  private drag(dx: number, dy: number, shift: boolean): void {
    const view = this.view;
    if (!view) {
      return;
    }
    if (shift) {
      this.change({ sun_deg: wrap(view.sun_deg + 0.4 * dx), phase_deg: Math.min(180, Math.max(0, view.phase_deg + 0.4 * dy)) }, true);
      return;
    }
    // The surface follows the hand, whatever is up.
    const north = (view.north_deg * Math.PI) / 180;
    const [along, across] = [dx * Math.cos(north) + dy * Math.sin(north), -dx * Math.sin(north) + dy * Math.cos(north)];
    this.change({ latitude_deg: Math.min(90, Math.max(-90, view.latitude_deg - 0.3 * along)), longitude_deg: wrap(view.longitude_deg - 0.3 * across) }, true);
  }

  private letGo(after = STILL_MS): void {
    window.clearTimeout(this.still);
    remember(`scene ${this.at}`, { body: this.about?.body ?? "", frame: this.frame, view: this.view, photometry: this.photometry });
    this.still = window.setTimeout(() => this.frames.ask(true), after);
  }

  private draw(): void {
    if (this.shown) {
      const { image, facts } = this.shown;
      this.picture.show(image, { stretch: "linear", range: [0, 255], signed: false }, drawTruth({ ...facts, stars: [] }, this.over));
    }
  }

  private async render(full: boolean): Promise<void> {
    const begun = performance.now();
    const { image, facts: found } = await getNumbers<Facts>("/api/scene/image", "u8", this.asked(full), this.shell.closed.signal);
    this.shell.mended();
    this.shown = { image, facts: found };
    this.draw();
    this.picture.canvas.dataset["full"] = String(full);
    const now = performance.now();
    this.times = [...this.times.filter((time) => now - time < 2000), now];
    const rate = !full && this.times.length > 2 ? `, ${((this.times.length - 1) / ((now - (this.times[0] as number)) / 1000)).toFixed(1)} a second` : "";
    put(
      this.state,
      full
        ? `Full frame: ${image.width} x ${image.height}, ${found.renderer}, ${((now - begun) / 1000).toFixed(2)} s; the brightest pixel is just below saturation (radiance scale ${told(found.radiance_scale)})`
        : `Draft: ${image.width} x ${image.height}${rate}`,
    );
  }
}

