// Errors against a column: rows, and weighted means of bins with their errors.

import { colour } from "./dom";
import { type Box, Plot } from "./plot";
import { binMeans, type Columns, type Kept } from "./rows";

export interface ScatterShown {
  data: Columns;
  column: Float32Array;
  columnLabel: string;
  values: Float32Array;
  valueLabel: string;
  /** What an effect would add. */
  preview: Float32Array | null;
  kept: Kept;
  chosen: Kept | null;
  /** Half the range of the values' axis. */
  half: number;
}

export class Scatter {
  readonly plot: Plot;
  private shown: ScatterShown | null = null;

  constructor(brushed: (box: Box | null) => void) {
    this.plot = new Plot("scatter", () => this.draw(), brushed);
  }

  show(shown: ScatterShown): void {
    this.shown = shown;
    let [low, high] = [Infinity, -Infinity];
    for (const value of shown.column) {
      if (Number.isFinite(value)) {
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
    }
    if (!(high > low)) {
      [low, high] = Number.isFinite(low) ? [low - 0.5, low + 0.5] : [0, 1];
    }
    const margin = 0.04 * (high - low);
    this.plot.axes = {
      x: { low: low - margin, high: high + margin },
      y: { low: -shown.half, high: shown.half },
      xLabel: shown.columnLabel,
      yLabel: shown.valueLabel,
      equal: false,
    };
    this.plot.redraw();
  }

  private draw(): void {
    const shown = this.shown;
    if (!shown) {
      return;
    }
    const c = this.plot.context;
    const { chosen, column, values, kept } = shown;
    c.strokeStyle = colour("line");
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(this.plot.px(this.plot.axes.x.low), Math.round(this.plot.py(0)) + 0.5);
    c.lineTo(this.plot.px(this.plot.axes.x.high), Math.round(this.plot.py(0)) + 0.5);
    c.stroke();
    this.dots(values, kept, colour("data"), chosen ? 0.15 : 0.35);
    if (chosen) {
      this.dots(values, (row) => kept(row) && chosen(row), colour("chosen"), 0.9);
    }
    const preview = shown.preview;
    if (preview) {
      const bins = binMeans(column, preview, kept);
      c.strokeStyle = colour("preview");
      c.lineWidth = 2.5;
      c.setLineDash([6, 3]);
      c.beginPath();
      bins.forEach((bin, at) => {
        const [x, y] = [this.plot.px(bin.at), this.plot.py(bin.mean)];
        if (at === 0) c.moveTo(x, y);
        else c.lineTo(x, y);
      });
      c.stroke();
      c.setLineDash([]);
    }
    c.strokeStyle = colour("text");
    c.fillStyle = colour("text");
    c.lineWidth = 1.5;
    for (const bin of binMeans(column, values, chosen ? (row) => kept(row) && chosen(row) : kept)) {
      const [x, y] = [this.plot.px(bin.at), this.plot.py(bin.mean)];
      c.beginPath();
      c.moveTo(x, this.plot.py(bin.mean - bin.sigma));
      c.lineTo(x, this.plot.py(bin.mean + bin.sigma));
      c.stroke();
      c.beginPath();
      c.arc(x, y, 3.5, 0, 2 * Math.PI);
      c.fill();
    }
  }

  private dots(values: Float32Array, kept: Kept, fill: string, alpha: number): void {
    const shown = this.shown;
    if (!shown) {
      return;
    }
    const c = this.plot.context;
    c.globalAlpha = alpha;
    c.fillStyle = fill;
    for (let row = 0; row < values.length; row++) {
      if (kept(row)) {
        c.fillRect(this.plot.px(shown.column[row] as number) - 1.2, this.plot.py(values[row] as number) - 1.2, 2.4, 2.4);
      }
    }
    c.globalAlpha = 1;
  }
}
