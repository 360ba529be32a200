// Curves over time: errors, their bounds, and where in time one looks.

import { colour, h } from "./dom";
import { Plot } from "./plot";

export interface Series {
  name: string;
  /** A colour of the style sheet. */
  colour: string;
  kind: "dots" | "line" | "dashed" | "band" | "ticks";
  x: number[];
  y: number[];
  /** Of a band, its lower edge. */
  low?: number[];
}

export class Lines {
  readonly element: HTMLElement;
  private readonly plot: Plot;
  private series: Series[] = [];
  private marker: number | null = null;

  constructor(name: string, label: string, picked: (x: number) => void) {
    this.plot = new Plot(
      name,
      () => this.draw(),
      (box) => {
        if (box) {
          picked((box.x0 + box.x1) / 2);
        }
      },
    );
    this.plot.canvas.setAttribute("aria-label", label);
    this.plot.canvas.addEventListener("click", (event) => {
      const { x } = this.plot.axes;
      const [left, right] = [this.plot.px(x.low), this.plot.px(x.high)];
      const share = (event.clientX - this.plot.canvas.getBoundingClientRect().left - left) / (right - left);
      if (share >= 0 && share <= 1) {
        picked(x.low + share * (x.high - x.low));
      }
    });
    this.key = h("p", { class: "keys dim" });
    this.element = h("figure", { class: "lines" }, this.plot.canvas, this.key);
  }

  private readonly key: HTMLElement;

  set(xLabel: string, yLabel: string, series: Series[], y: [number, number]): void {
    this.series = series;
    const all = series.flatMap((own) => own.x);
    const low = all.reduce((a, b) => Math.min(a, b), Infinity);
    const high = all.reduce((a, b) => Math.max(a, b), -Infinity);
    const x = low < high ? { low, high } : { low: (Number.isFinite(low) ? low : 0) - 0.5, high: (Number.isFinite(high) ? high : 0) + 0.5 };
    this.plot.axes = { x, y: { low: y[0], high: y[1] }, xLabel, yLabel, equal: false };
    this.key.replaceChildren(...series.filter((own) => own.name !== "").map((own) => h("span", {}, h("i", { class: `mark ${own.kind} ${own.colour}` }), own.name)));
    this.plot.redraw();
  }

  mark(x: number): void {
    this.marker = x;
    this.plot.redraw();
  }

  redraw(): void {
    this.plot.redraw();
  }

  private draw(): void {
    const { plot } = this;
    const c = plot.context;
    const { y } = plot.axes;
    if (y.low < 0 && y.high > 0) {
      c.strokeStyle = colour("line");
      c.beginPath();
      c.moveTo(plot.px(plot.axes.x.low), plot.py(0));
      c.lineTo(plot.px(plot.axes.x.high), plot.py(0));
      c.stroke();
    }
    for (const own of this.series) {
      this.drawOne(own);
    }
    if (this.marker !== null) {
      c.strokeStyle = colour("accent");
      c.lineWidth = 2;
      c.beginPath();
      c.moveTo(plot.px(this.marker), plot.py(y.low));
      c.lineTo(plot.px(this.marker), plot.py(y.high));
      c.stroke();
    }
  }

  private drawOne(own: Series): void {
    const { plot } = this;
    const c = plot.context;
    const at = (k: number, values: number[]): [number, number] => [plot.px(own.x[k] as number), plot.py(values[k] as number)];
    c.strokeStyle = c.fillStyle = colour(own.colour);
    c.lineWidth = 1.6;
    c.setLineDash(own.kind === "dashed" ? [6, 4] : []);
    c.beginPath();
    if (own.kind === "dots") {
      for (let k = 0; k < own.x.length; k++) {
        const [x, y] = at(k, own.y);
        c.moveTo(x + 2, y);
        c.arc(x, y, 2, 0, 2 * Math.PI);
      }
      c.fill();
    } else if (own.kind === "ticks") {
      const foot = plot.py(plot.axes.y.low);
      for (const value of own.x) {
        c.moveTo(plot.px(value), foot);
        c.lineTo(plot.px(value), foot - 10);
      }
      c.stroke();
    } else if (own.kind === "band" && own.low) {
      own.x.forEach((_, k) => c.lineTo(...at(k, own.y)));
      for (let k = own.x.length - 1; k >= 0; k--) {
        c.lineTo(...at(k, own.low));
      }
      c.closePath();
      c.globalAlpha = 0.22;
      c.fill();
      c.globalAlpha = 1;
    } else {
      own.x.forEach((_, k) => c.lineTo(...at(k, own.y)));
      c.stroke();
    }
    c.setLineDash([]);
  }
}

/** Symmetric about 0, so that most of the values show. */
export function around(values: number[], share = 0.99): [number, number] {
  const sorted = values.map(Math.abs).filter(Number.isFinite).sort((a, b) => a - b);
  const most = 1.15 * (sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))] ?? 1) || 1;
  return [-most, most];
}

/** From 0 up, so that most of the values show. */
export function above(values: number[], share = 0.99): [number, number] {
  return [0, around(values, share)[1]];
}
