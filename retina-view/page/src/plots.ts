// The middle of the page: the field and the scatter, brushed together.

import { h, put } from "./dom";
import { Field, referenceOf } from "./field";
import type { Box } from "./plot";
import { type Columns, columnOf, type Kept, type ModelRows, type Part, partOf, quantile } from "./rows";
import { Scatter } from "./scatter";

const PARTS: [Part, string][] = [
  ["along", "along the radius"],
  ["across", "across the radius"],
  ["x", "along x"],
  ["y", "along y"],
];

export class Plots {
  readonly element: HTMLElement;
  private data: Columns | null = null;
  private first: ModelRows | null = null;
  private model: ModelRows | null = null;
  private name = "";
  private blink: ModelRows | null = null;
  private blinkName = "";
  private preview: Float32Array[] | null = null;
  private boxes: { field: Box | null; scatter: Box | null } = { field: null, scatter: null };
  private reference = 1;
  private half = 1;
  private readonly field = new Field((box) => this.brushed("field", box));
  private readonly scatter = new Scatter((box) => this.brushed("scatter", box));
  private readonly column = h("select", { "data-key": "column", change: () => this.unbrush("scatter") });
  private readonly part = h("select", { "data-key": "part", change: () => this.unbrush("scatter") });
  private readonly exposure = h("input", { type: "range", min: 0, max: 0, value: 0, step: 1, "data-key": "exposure", input: () => this.redraw() });
  private readonly exposureName = h("output", {});
  private readonly rescale = h("input", { type: "checkbox", "data-key": "rescale", change: () => this.redraw() });
  private readonly keyLine = h("span", { class: "keyline" });
  private readonly keyText = h("span", {});
  private readonly shownName = h("p", { class: "shown" });
  private readonly selection = h("p", { class: "selection", "aria-live": "polite" });
  private readonly fieldFigure: HTMLElement;

  constructor() {
    this.fieldFigure = h("figure", { class: "field" }, this.field.plot.canvas);
    this.element = h(
      "div",
      { class: "plots" },
      this.shownName,
      h(
        "div",
        { class: "controls" },
        h("label", {}, "Exposure ", this.exposure, this.exposureName),
        h("label", {}, this.rescale, " scale to what is left"),
        h("span", { class: "key" }, this.keyLine, this.keyText),
      ),
      this.fieldFigure,
      this.selection,
      h("div", { class: "controls" }, h("label", {}, "Errors ", this.part), h("label", {}, "against ", this.column)),
      h("figure", { class: "scatter" }, this.scatter.plot.canvas),
      h("p", { class: "dim" }, "Drag in a plot to choose rows; they are marked in both. With the keyboard: arrow keys move the choice, with Shift they widen it, Escape lets it go."),
    );
  }

  setData(data: Columns, first: ModelRows): void {
    this.data = data;
    this.first = first;
    this.boxes = { field: null, scatter: null };
    this.exposure.max = String(data.groups.length);
    this.exposure.value = "0";
    const parts = data.components === 2 ? PARTS : ([["value", `(${data.unit})`]] as [Part, string][]);
    put(this.part, ...parts.map(([value, label]) => h("option", { value }, label)));
    put(this.column, ...data.columns.map((column) => h("option", { value: column.name }, column.label)));
    const light = ["log10_irradiance", "L", "digital_count", "phase_deg"].find((name) => columnOf(data, name));
    if (light) {
      this.column.value = light;
    }
    this.fieldFigure.hidden = data.components !== 2;
  }

  setModel(rows: ModelRows, name: string): void {
    [this.model, this.name, this.preview] = [rows, name, null];
    this.redraw();
  }

  setPreview(effect: Float32Array[] | null, covariates: string[]): void {
    this.preview = effect;
    const data = this.data;
    const column = covariates.find((name) => name !== "x" && name !== "y" && data && columnOf(data, name));
    if (column) {
      this.column.value = column;
    }
    this.redraw();
  }

  setBlink(rows: ModelRows | null, name: string): void {
    [this.blink, this.blinkName] = [rows, name];
    this.redraw();
  }

  blinking(): boolean {
    return this.blink !== null;
  }

  private unbrush(plot: "field" | "scatter"): void {
    this.boxes[plot] = null;
    this[plot].plot.brush = null;
    this.redraw();
  }

  private brushed(plot: "field" | "scatter", box: Box | null): void {
    const other = plot === "field" ? "scatter" : "field";
    this.boxes = { field: null, scatter: null, [plot]: box };
    this[other].plot.brush = null;
    this.redraw();
  }

  /** The rows within the brush. */
  private chosen(values: Float32Array, column: Float32Array): Kept | null {
    const data = this.data;
    const { field, scatter } = this.boxes;
    const [x, y] = data ? [columnOf(data, "x"), columnOf(data, "y")] : [null, null];
    const within = (box: Box, a: Float32Array, b: Float32Array): Kept => {
      const [y0, y1] = [Math.min(box.y0, box.y1), Math.max(box.y0, box.y1)];
      return (row) => (a[row] as number) >= box.x0 && (a[row] as number) <= box.x1 && (b[row] as number) >= y0 && (b[row] as number) <= y1;
    };
    if (field && x && y) {
      return within(field, x, y);
    }
    return scatter ? within(scatter, column, values) : null;
  }

  redraw(): void {
    const { data, first, model } = this;
    if (!data || !first || !model) {
      return;
    }
    const rows = this.blink ?? model;
    const exposure = Number(this.exposure.value);
    this.exposureName.textContent = exposure === 0 ? `all ${data.groups.length}` : (data.groups[exposure - 1] ?? "");
    this.exposure.setAttribute("aria-valuetext", this.exposureName.textContent);
    const kept: Kept = (row) => rows.outlier[row] === 0 && (exposure === 0 || data.group[row] === exposure - 1);
    const column = columnOf(data, this.column.value) ?? data.group;
    const part = this.part.value as Part;
    const values = partOf(data, rows.residual, part);
    const chosen = this.chosen(values, column);
    const counted = this.rescale.checked ? rows : first;
    const inliers: Kept = (row) => counted.outlier[row] === 0;
    this.reference = data.components === 2 ? referenceOf(data, counted.residual, inliers) : 1;
    if (exposure !== 0) {
      // Rows by themselves have their noise.
      this.reference *= 2;
    }
    this.half = 1.15 * quantile(partOf(data, counted.residual, part).filter((_, row) => inliers(row)), 0.99) || 1;
    const label = PARTS.find(([own]) => own === part)?.[1] ?? "";
    this.shownName.textContent = `Errors that are left with: ${this.blink ? this.blinkName : this.name}`;
    this.element.classList.toggle("blinked", this.blink !== null);
    if (data.components === 2) {
      this.field.show({ data, vectors: rows.residual, preview: this.preview, kept, chosen, single: exposure !== 0, reference: this.reference });
      this.keyText.textContent = this.field.key();
      this.keyLine.style.width = `${this.field.keyLength()}px`;
      this.field.plot.canvas.setAttribute("aria-label", `Arrows of the errors over the field. An arrow of one cell's width is ${this.reference.toPrecision(3)} ${data.unit}.`);
    }
    const columnLabel = data.columns.find((own) => own.name === this.column.value)?.label ?? "";
    this.scatter.show({
      data,
      column,
      columnLabel,
      values,
      valueLabel: `error ${label} (${data.unit})`,
      preview: this.preview ? partOf(data, this.preview, part) : null,
      kept,
      chosen,
      half: this.half,
    });
    this.scatter.plot.canvas.setAttribute("aria-label", `Errors ${label} against ${columnLabel}, with means of bins.`);
    this.told(rows, kept, chosen);
  }

  private told(rows: ModelRows, kept: Kept, chosen: Kept | null): void {
    let [count, all] = [0, 0];
    for (let row = 0; row < rows.outlier.length; row++) {
      if (kept(row)) {
        all++;
        count += chosen?.(row) ? 1 : 0;
      }
    }
    this.selection.textContent = chosen ? `${count} of ${all} rows chosen` : `${all} rows`;
  }
}
