// Error arrows over the field.

import { colour } from "./dom";
import { type Box, Plot } from "./plot";
import { type Arrow, cellMeans, type Columns, columnOf, type Kept, quantile, told } from "./rows";

export interface FieldShown {
  data: Columns;
  vectors: Float32Array[];
  /** What an effect would add, drawn over the errors. */
  preview: Float32Array[] | null;
  /** Rows of the chosen exposure that are no outliers. */
  kept: Kept;
  /** Those of them that are brushed; `null` where none is. */
  chosen: Kept | null;
  /** Every row by itself, without means. */
  single: boolean;
  /** Length that is drawn as one cell's width, in the data's unit. */
  reference: number;
}

/** A length by which most arrows of some vectors are as long as a cell is wide. */
export function referenceOf(data: Columns, vectors: Float32Array[], kept: Kept): number {
  const lengths = cellMeans(data, vectors, kept).map((arrow) => Math.hypot(arrow.dx, arrow.dy));
  return quantile(lengths, 0.9) || 1;
}

/** 1, 2 or 5 times a power of ten that is at most this. */
function rounded(length: number): number {
  const power = 10 ** Math.floor(Math.log10(length));
  const factor = [5, 2, 1].find((f) => f * power <= length) ?? 1;
  return factor * power;
}

/** A cell's width in units of x, as `cellMeans` has it. */
const CELL = 2 / 14;

export class Field {
  readonly plot: Plot;
  private shown: FieldShown | null = null;

  constructor(brushed: (box: Box | null) => void) {
    this.plot = new Plot("field", () => this.draw(), brushed);
  }

  show(shown: FieldShown): void {
    this.shown = shown;
    const height = shown.data.half_height ?? 1;
    // As high as the plot with its labels needs.
    this.plot.canvas.style.aspectRatio = `1 / ${(0.88 * height + 0.09).toFixed(3)}`;
    this.plot.axes = {
      x: { low: -1.08, high: 1.08 },
      // Downwards, as the camera's pixels are counted.
      y: { low: 1.08 * height, high: -1.08 * height },
      xLabel: "x / half width",
      yLabel: "y / half width",
      equal: true,
    };
    this.plot.redraw();
  }

  /** What the arrows mean, for the line above the plot. */
  key(): string {
    return this.shown ? `${told(rounded(this.shown.reference))} ${this.shown.data.unit}` : "";
  }

  /** The key's length on the screen, CSS px. */
  keyLength(): number {
    const shown = this.shown;
    return shown ? (rounded(shown.reference) / shown.reference) * CELL * this.plot.scale() : 0;
  }

  private draw(): void {
    const shown = this.shown;
    if (!shown) {
      return;
    }
    const arrows = (vectors: Float32Array[], kept: Kept): Arrow[] =>
      shown.single ? singleArrows(shown.data, vectors, kept) : cellMeans(shown.data, vectors, kept);
    const c = this.plot.context;
    const { chosen } = shown;
    if (chosen) {
      c.globalAlpha = 0.25;
      this.arrows(arrows(shown.vectors, shown.kept), colour("data"), 1.5);
      c.globalAlpha = 1;
      this.arrows(arrows(shown.vectors, (row) => shown.kept(row) && chosen(row)), colour("chosen"), 2);
    } else {
      this.arrows(arrows(shown.vectors, shown.kept), colour("data"), 1.8);
    }
    if (shown.preview) {
      this.arrows(arrows(shown.preview, shown.kept), colour("preview"), 1.8, 4);
    }
  }

  private arrows(arrows: Arrow[], stroke: string, width: number, dash = 0): void {
    const shown = this.shown;
    if (!shown) {
      return;
    }
    const c = this.plot.context;
    const unit = (CELL * this.plot.scale()) / shown.reference;
    c.strokeStyle = stroke;
    c.fillStyle = stroke;
    c.lineWidth = width;
    for (const arrow of arrows) {
      const [x, y] = [this.plot.px(arrow.x), this.plot.py(arrow.y)];
      const [dx, dy] = [arrow.dx * unit, arrow.dy * unit];
      const length = Math.hypot(dx, dy);
      c.beginPath();
      c.arc(x, y, 1.4, 0, 2 * Math.PI);
      c.fill();
      if (length < 1.5) {
        continue;
      }
      c.setLineDash(dash > 0 ? [dash, 2] : []);
      c.beginPath();
      c.moveTo(x, y);
      c.lineTo(x + dx, y + dy);
      c.stroke();
      c.setLineDash([]);
      const head = Math.min(6, 0.45 * length);
      const [ux, uy] = [dx / length, dy / length];
      c.beginPath();
      c.moveTo(x + dx, y + dy);
      c.lineTo(x + dx - head * (ux + 0.5 * uy), y + dy - head * (uy - 0.5 * ux));
      c.lineTo(x + dx - head * (ux - 0.5 * uy), y + dy - head * (uy + 0.5 * ux));
      c.closePath();
      c.fill();
    }
  }
}

function singleArrows(data: Columns, vectors: Float32Array[], kept: Kept): Arrow[] {
  const [x, y] = [columnOf(data, "x"), columnOf(data, "y")];
  const [vx, vy] = vectors;
  const out: Arrow[] = [];
  if (!x || !y || !vx || !vy) {
    return out;
  }
  for (let row = 0; row < data.shown; row++) {
    if (kept(row)) {
      const [px, py, dx, dy] = [x[row], y[row], vx[row], vy[row]] as [number, number, number, number];
      out.push({ x: px, y: py, dx, dy, rows: 1 });
    }
  }
  return out;
}
