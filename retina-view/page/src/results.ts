// Results of navigation: error and bounds over time, why a frame failed, and its image.

import { get, type StartDocument } from "./api";
import { h, put, tell } from "./dom";
import { getCounts } from "./image";
import { above, around, Lines, type Series } from "./lines";
import { Picture } from "./picture";
import { told } from "./rows";
import { facts, field, Latest, remember, remembered, select, sequences, Shell } from "./shell";

type Row = Record<string, unknown>;

interface Document {
  schema: string;
  name?: string;
  rows?: Row[];
  frames?: Row[];
  summary?: Record<string, unknown>;
  filter?: { steps?: Row[]; none?: string } & Record<string, unknown>;
  poses?: Record<string, unknown>;
  transfer?: ({ by_session?: Row[]; imaged?: { by_session?: Row[] } | null } & Record<string, unknown>) | null;
  kinds?: { name: string; summary: Record<string, unknown> }[];
}

interface Results {
  name: string;
  documents: { file: string; document: Document }[];
}

/** What is drawn and stepped through. */
interface Shown {
  title: string;
  rows: Row[];
  summary: Record<string, unknown>;
  /** Of a row, where it is along x. */
  along: (row: Row) => number;
  xLabel: string;
  plots: { label: string; series: Series[]; range: [number, number] }[];
  /** Rows are frames of a rendered sequence; the name of its folder, where it is known. */
  images: boolean;
  sequence: string | null;
}

const numbers = (row: Row, key: string): number[] => (Array.isArray(row[key]) ? (row[key] as number[]) : []);
const number = (row: Row, key: string): number => (typeof row[key] === "number" ? row[key] : NaN);

/** Full-disk navigation: single frames and the filter along the camera's axes. */
function fullDisk(title: string, document: Document, rows: Row[]): Shown {
  const start = number(rows[0] ?? {}, "time_s");
  const hours = (row: Row): number => (number(row, "time_s") - start) / 3600;
  const solved = rows.filter((row) => numbers(row, "error_m").length === 3);
  const refused = rows.filter((row) => numbers(row, "error_m").length !== 3);
  const steps = document.filter?.steps ?? [];
  const plots = ["X", "Y", "Z (range)"].map((axis, k) => {
    const single = solved.map((row) => (numbers(row, "error_m")[k] as number) / 1e3);
    const sigma = solved.map((row) => 3e-3 * Math.sqrt(((row["covariance_m2"] as number[][] | undefined)?.[k]?.[k] ?? NaN) as number));
    const filtered = steps.map((row) => (numbers(row, "error_m")[k] as number) / 1e3);
    const bound = steps.map((row) => (numbers(row, "three_sigma_m")[k] as number) / 1e3);
    const [x, t] = [solved.map(hours), steps.map((row) => number(row, "elapsed_s") / 3600)];
    const series: Series[] = [
      { name: "3 sigma of single frames", colour: "bar", kind: "band", x, y: sigma, low: sigma.map((v) => -v) },
      { name: "single frames", colour: "data", kind: "dots", x, y: single },
    ];
    if (steps.length > 0) {
      series.push({ name: "3 sigma of the filter", colour: "chosen", kind: "dashed", x: t, y: bound }, { name: "", colour: "chosen", kind: "dashed", x: t, y: bound.map((v) => -v) }, { name: "filter", colour: "chosen", kind: "line", x: t, y: filtered });
    }
    if (refused.length > 0) {
      series.push({ name: `refused (${refused.length})`, colour: "bad", kind: "ticks", x: refused.map(hours), y: [] });
    }
    return { label: `${axis} error (km)`, series: series.filter((own) => own.x.length > 0), range: around([...single, ...sigma, ...filtered, ...bound], 0.98) };
  });
  return { title, rows, summary: document.summary ?? {}, along: hours, xLabel: "hours since the first frame", plots, images: true, sequence: document.name ?? null };
}

/** The transfer: position and velocity over days. */
function transfer(title: string, document: Document, rows: Row[]): Shown {
  const days = rows.map((row) => number(row, "day"));
  const imaged = document.transfer?.imaged?.by_session ?? [];
  const plots = ["km", "m_s"].map((unit, k) => {
    // Thousands of km, m/s.
    const scale = k === 0 ? 1e-3 : 1;
    const [bound, rms] = [`three_sigma_${unit}`, `rms_${unit}`].map((key) => rows.map((row) => scale * number(row, key))) as [number[], number[]];
    const series: Series[] = [
      { name: "3 sigma of the filter", colour: "chosen", kind: "dashed", x: days, y: bound },
      { name: "rms error of the samples", colour: "data", kind: "line", x: days, y: rms },
    ];
    if (imaged.length > 0) {
      series.push({ name: "one run on images", colour: "text", kind: "line", x: imaged.map((row) => number(row, "day")), y: imaged.map((row) => scale * (numbers(row, "error")[k] as number)) });
    }
    return { label: k === 0 ? "Position error (1000 km)" : "Velocity error (m/s)", series, range: above(bound.slice(1), 0.9) };
  });
  return { title, rows, summary: document.transfer ?? {}, along: (row) => number(row, "day"), xLabel: "days since the start", plots, images: false, sequence: null };
}

/** Any list: its numbers over the row's own number. */
function list(title: string, rows: Row[], summary: Record<string, unknown>): Shown {
  const along = (row: Row): number => Object.values(row).find((value): value is number => typeof value === "number") ?? 0;
  const first = Object.entries(rows[0] ?? {}).find(([, value]) => typeof value === "number")?.[0] ?? "row";
  const bad = rows.filter((row) => typeof row["outcome"] === "string" && row["outcome"] !== "solved");
  const wanted = ["cross_arcsec", "about_arcsec", "planet_arcsec"].filter((key) => rows.some((row) => Number.isFinite(number(row, key))));
  const others = Object.keys(rows[0] ?? {}).filter((key) => key !== first && rows.some((row) => Number.isFinite(number(row, key))));
  const plots = (wanted.length > 0 ? wanted : others.slice(0, 3)).map((key) => {
    const own = rows.filter((row) => Number.isFinite(number(row, key)));
    const y = own.map((row) => number(row, key));
    const series: Series[] = [{ name: key, colour: "data", kind: "dots", x: own.map(along), y }];
    if (bad.length > 0) {
      series.push({ name: `not solved (${bad.length})`, colour: "bad", kind: "ticks", x: bad.map(along), y: [] });
    }
    return { label: key, series, range: y.some((v) => v < 0) ? around(y) : above(y) };
  });
  return { title, rows, summary, along, xLabel: first, plots, images: false, sequence: null };
}

function shownOf({ documents }: Results): Shown[] {
  const out: Shown[] = [];
  const whole = documents.some(({ document }) => document.frames);
  for (const { file, document } of documents) {
    if (Array.isArray(document.frames)) {
      out.push(fullDisk(file, document, document.frames));
    } else if (Array.isArray(document.rows) && document.schema === "retina.navigation-full-disk/1") {
      // The document has the same frames, and the filter beside them.
      if (!whole) {
        out.push(fullDisk(file, document, document.rows));
      }
    } else if (document.transfer?.by_session) {
      out.push(transfer(`${file}: transfer`, document, document.transfer.by_session));
    } else if (document.rows && document.rows.length > 0) {
      const poses = documents.find((own) => own.document.poses)?.document.poses;
      out.push(list(file, document.rows, document.schema === "retina.far-range-poses/1" ? (poses ?? {}) : {}));
    }
  }
  return out;
}

/** A value of a document, as a person reads it; null where it is too much for one line. */
function text(value: unknown): string | null {
  if (typeof value === "number") {
    return Number.isInteger(value) ? String(value) : told(value);
  }
  if (Array.isArray(value) && value.length <= 6 && value.every((own) => typeof own === "number")) {
    return value.map((own) => told(own as number)).join(", ");
  }
  if (value !== null && typeof value === "object" && !Array.isArray(value)) {
    const parts = Object.entries(value).map(([key, own]) => [key, text(own)] as const);
    return parts.length > 0 && parts.length <= 6 && parts.every(([, own]) => own !== null) ? parts.map(([key, own]) => `${key} ${own}`).join(", ") : null;
  }
  return typeof value === "string" ? value : typeof value === "boolean" ? String(value) : null;
}

const listed = (row: Record<string, unknown>): [string, string][] =>
  Object.entries(row).flatMap(([key, value]) => {
    const own = text(value);
    return own === null || key === "inputs" ? [] : [[key.replaceAll("_", " "), own] as [string, string]];
  });

interface Kept {
  list: number;
  row: number;
  sequence: string;
}

export class ResultsPane {
  private readonly shell: Shell;
  private readonly kept: Kept;
  private shown: Shown[] = [];
  private lines: Lines[] = [];
  private runs: [string, string][] = [];
  private readonly picture = new Picture("picture", "The image of the instant", () => undefined);
  private readonly plots = h("div", { class: "plots-of-time" });
  private readonly slider = h("input", { type: "range", min: 0, step: 1, "data-key": "instant", "aria-label": "Instant" });
  private readonly instant = h("output", {});
  private readonly row = h("div", {});
  private readonly summary = h("div", {});
  private readonly image = h("div", {});
  private readonly controls = h("div", { class: "controls" });
  private readonly images: Latest<{ at: string; frame: number }>;

  constructor(
    page: Element,
    private readonly at: string,
  ) {
    this.kept = remembered<Kept>(`results ${at}`, { list: 0, row: 0, sequence: "" });
    this.shell = new Shell(page, "Results", at.replace(/^\d+\/?/, "") || "the given path", "pane");
    this.images = new Latest(async ({ at, frame }) => {
      const path = `/api/sequence/image/${frame}?at=${encodeURIComponent(at)}`;
      this.picture.show(await getCounts(path, this.shell.closed.signal), { stretch: "root", range: null, signed: false }, null);
      this.shell.mended();
    }, this.shell.failed);
    this.slider.addEventListener("input", () => this.goTo(Number(this.slider.value)));
    this.shell.main.append(
      h("section", { class: "look", "aria-label": "Over time" }, this.controls, this.plots, h("div", { class: "player" }, h("span", {}, "Instant"), this.slider, this.instant)),
      h("section", { class: "beside", "aria-label": "This instant and all" }, h("h2", {}, "This instant"), this.row, this.image, h("h2", {}, "All together"), this.summary),
    );
    window.addEventListener("theme", () => this.lines.forEach((own) => own.redraw()), { signal: this.shell.closed.signal });
    void this.start().catch(this.shell.failed);
  }

  close(): void {
    this.shell.close();
  }

  private async start(): Promise<void> {
    const signal = this.shell.closed.signal;
    const [results, start] = await Promise.all([get<Results>(`/api/results?at=${encodeURIComponent(this.at)}`, signal), get<StartDocument>("/api/start", signal)]);
    this.runs = sequences(start);
    this.shown = shownOf(results);
    if (this.shown.length === 0) {
      put(this.plots, h("p", { class: "dim" }, "These results have no list of frames, poses or sessions yet."));
      return;
    }
    this.choose(Math.min(this.kept.list, this.shown.length - 1), this.kept.row);
  }

  private choose(list: number, row: number): void {
    this.kept.list = list;
    const shown = this.shown[list] as Shown;
    if (!this.runs.some(([path]) => path === this.kept.sequence)) {
      const own = this.runs.find(([, name]) => shown.sequence !== null && name.split("/").pop() === shown.sequence);
      this.kept.sequence = (own ?? this.runs[0])?.[0] ?? "";
    }
    put(
      this.controls,
      field("Results", select("list", this.shown.map((own, k): [string, string] => [String(k), own.title]), String(list), (value) => this.choose(Number(value), 0))),
      shown.images && this.runs.length > 0
        ? field("Images", select("sequence", this.runs, this.kept.sequence, (value) => {
            this.kept.sequence = value;
            this.goTo(this.kept.row);
          }))
        : null,
    );
    this.lines = shown.plots.map(({ label, series, range }, k) => {
      const lines = new Lines(`lines-${k}`, label, (x) => this.nearest(x));
      lines.set(shown.xLabel, label, series, range);
      return lines;
    });
    put(this.plots, ...this.lines.map((lines) => lines.element));
    this.lines.forEach((lines) => lines.redraw());
    this.slider.max = String(shown.rows.length - 1);
    put(this.summary, facts(listed(shown.summary)));
    this.goTo(Math.min(row, shown.rows.length - 1));
  }

  private nearest(x: number): void {
    const shown = this.shown[this.kept.list];
    if (shown) {
      const off = shown.rows.map((row) => Math.abs(shown.along(row) - x));
      this.goTo(off.indexOf(Math.min(...off)));
    }
  }

  private goTo(at: number): void {
    const shown = this.shown[this.kept.list];
    const row = shown?.rows[at];
    if (!shown || !row) {
      return;
    }
    this.kept.row = at;
    remember(`results ${this.at}`, this.kept);
    this.slider.value = String(at);
    const place = shown.along(row);
    this.lines.forEach((lines) => lines.mark(place));
    const frame = number(row, "frame");
    this.instant.textContent = Number.isFinite(frame) ? `frame ${frame}` : told(place);
    this.slider.setAttribute("aria-valuetext", this.instant.textContent);
    const why = typeof row["message"] === "string" ? row["message"] : null;
    const outcome = typeof row["outcome"] === "string" ? row["outcome"] : null;
    put(this.row, outcome ? h("p", { class: outcome === "solved" ? "verdict good" : "verdict bad" }, outcome.replaceAll("_", " ")) : null, why ? h("p", {}, why) : null, facts(listed({ ...row, message: undefined, outcome: undefined })));
    if (why) {
      tell(why);
    }
    if (shown.images && Number.isFinite(frame) && this.kept.sequence !== "") {
      put(this.image, this.picture.canvas);
      this.images.ask({ at: this.kept.sequence, frame });
    } else {
      put(this.image, h("p", { class: "dim" }, shown.images ? "Give the rendered folder to `retina view` as well, to see the image of each instant." : "These results keep no images."));
    }
  }
}
