// A canvas with axes and a brush: what the field and the scatter share.

import { drawable, emptied } from "./canvas";
import { colour } from "./dom";
import { ticks, told } from "./rows";

/** A range of the plot's own coordinates: left, right, top, bottom. */
export interface Box {
  x0: number;
  x1: number;
  y0: number;
  y1: number;
}

interface Range {
  low: number;
  high: number;
}

export interface Axes {
  x: Range;
  /** From the lower edge to the upper one. */
  y: Range;
  xLabel: string;
  yLabel: string;
  /** One unit is as long across as down. */
  equal: boolean;
}

const MARGIN = { left: 58, right: 12, top: 10, bottom: 44 };
const FONT = "12px system-ui, sans-serif";
/** Shares of the plot by which the arrow keys move the brush. */
const KEY_STEP = 0.05;

export class Plot {
  readonly canvas: HTMLCanvasElement;
  readonly context: CanvasRenderingContext2D;
  axes: Axes = { x: { low: -1, high: 1 }, y: { low: -1, high: 1 }, xLabel: "", yLabel: "", equal: false };
  brush: Box | null = null;
  private drag: { x: number; y: number } | null = null;

  constructor(
    name: string,
    private readonly draw: () => void,
    private readonly brushed: (box: Box | null) => void,
  ) {
    ({ canvas: this.canvas, context: this.context } = drawable(name, () => this.redraw()));
    this.canvas.addEventListener("pointerdown", (event) => this.down(event));
    this.canvas.addEventListener("pointermove", (event) => this.move(event));
    this.canvas.addEventListener("pointerup", (event) => this.up(event));
    this.canvas.addEventListener("keydown", (event) => this.key(event));
  }

  /** Sizes of the plot within its axes, CSS px. */
  private inner(): { left: number; top: number; width: number; height: number } {
    const { clientWidth, clientHeight } = this.canvas;
    let width = Math.max(10, clientWidth - MARGIN.left - MARGIN.right);
    let height = Math.max(10, clientHeight - MARGIN.top - MARGIN.bottom);
    let left = MARGIN.left;
    if (this.axes.equal) {
      const ratio = Math.abs(this.axes.y.high - this.axes.y.low) / (this.axes.x.high - this.axes.x.low);
      const fitting = Math.min(width, height / ratio);
      left += (width - fitting) / 2;
      [width, height] = [fitting, fitting * ratio];
    }
    return { left, top: MARGIN.top, width, height };
  }

  px(x: number): number {
    const { left, width } = this.inner();
    return left + (width * (x - this.axes.x.low)) / (this.axes.x.high - this.axes.x.low);
  }

  py(y: number): number {
    const { top, height } = this.inner();
    return top + height - (height * (y - this.axes.y.low)) / (this.axes.y.high - this.axes.y.low);
  }

  /** CSS px in a unit of x. */
  scale(): number {
    return this.inner().width / (this.axes.x.high - this.axes.x.low);
  }

  redraw(): void {
    const c = this.context;
    emptied(this.canvas, c);
    if (this.canvas.clientWidth < 40) {
      return;
    }
    this.drawAxes();
    const { left, top, width, height } = this.inner();
    c.save();
    c.beginPath();
    c.rect(left, top, width, height);
    c.clip();
    this.draw();
    this.drawBrush();
    c.restore();
  }

  private drawAxes(): void {
    const c = this.context;
    const { left, top, width, height } = this.inner();
    const { x, y } = this.axes;
    c.font = FONT;
    c.lineWidth = 1;
    c.strokeStyle = colour("grid");
    c.fillStyle = colour("dim");
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const tick of ticks(x.low, x.high, Math.max(2, width / 70))) {
      const at = Math.round(this.px(tick)) + 0.5;
      c.beginPath();
      c.moveTo(at, top);
      c.lineTo(at, top + height);
      c.stroke();
      c.fillText(told(tick), at, top + height + 6);
    }
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const tick of ticks(Math.min(y.low, y.high), Math.max(y.low, y.high), Math.max(4, height / 45))) {
      const at = Math.round(this.py(tick)) + 0.5;
      c.beginPath();
      c.moveTo(left, at);
      c.lineTo(left + width, at);
      c.stroke();
      c.fillText(told(tick), left - 6, at);
    }
    c.strokeStyle = colour("line");
    c.strokeRect(left + 0.5, top + 0.5, width - 1, height - 1);
    c.fillStyle = colour("text");
    c.textAlign = "center";
    c.textBaseline = "alphabetic";
    c.fillText(this.axes.xLabel, left + width / 2, top + height + 38, width + MARGIN.left);
    c.save();
    c.translate(left - 44, top + height / 2);
    c.rotate(-Math.PI / 2);
    c.fillText(this.axes.yLabel, 0, 0, height + MARGIN.bottom);
    c.restore();
  }

  private drawBrush(): void {
    if (!this.brush) {
      return;
    }
    const { x0, x1, y0, y1 } = this.brush;
    const c = this.context;
    c.fillStyle = colour("brush");
    c.strokeStyle = colour("accent");
    c.lineWidth = 1.5;
    const [left, top] = [this.px(x0), this.py(y0)];
    const [width, height] = [this.px(x1) - left, this.py(y1) - top];
    c.fillRect(left, top, width, height);
    c.strokeRect(left, top, width, height);
  }

  private at(event: PointerEvent): { x: number; y: number } {
    const box = this.canvas.getBoundingClientRect();
    const { left, top, width, height } = this.inner();
    const share = (value: number): number => Math.min(1, Math.max(0, value));
    const across = share((event.clientX - box.left - left) / width);
    const up = 1 - share((event.clientY - box.top - top) / height);
    const { x, y } = this.axes;
    return { x: x.low + across * (x.high - x.low), y: y.low + up * (y.high - y.low) };
  }

  private set(box: Box | null): void {
    this.brush = box;
    this.brushed(box);
  }

  private down(event: PointerEvent): void {
    if (event.button !== 0) {
      return;
    }
    this.canvas.setPointerCapture(event.pointerId);
    this.drag = this.at(event);
  }

  private move(event: PointerEvent): void {
    if (!this.drag) {
      return;
    }
    const to = this.at(event);
    const [x0, x1] = [Math.min(this.drag.x, to.x), Math.max(this.drag.x, to.x)];
    const [y0, y1] = [Math.min(this.drag.y, to.y), Math.max(this.drag.y, to.y)];
    const moved = Math.abs(this.px(x1) - this.px(x0)) + Math.abs(this.py(y1) - this.py(y0)) > 6;
    if (moved) {
      this.set({ x0, x1, y0, y1 });
    }
  }

  private up(event: PointerEvent): void {
    const start = this.drag;
    this.drag = null;
    if (!start) {
      return;
    }
    const to = this.at(event);
    const still = Math.abs(this.px(to.x) - this.px(start.x)) + Math.abs(this.py(to.y) - this.py(start.y)) <= 6;
    if (still && this.brush) {
      this.set(null);
    }
  }

  /** Arrow keys move a brush, with Shift they widen it, Escape lets it go. */
  private key(event: KeyboardEvent): void {
    if (event.key === "Escape") {
      this.set(null);
      return;
    }
    const across = { ArrowLeft: -1, ArrowRight: 1 }[event.key] ?? 0;
    const up = { ArrowUp: 1, ArrowDown: -1 }[event.key] ?? 0;
    if (across === 0 && up === 0) {
      return;
    }
    event.preventDefault();
    const { x, y } = this.axes;
    const [dx, dy] = [KEY_STEP * across * (x.high - x.low), KEY_STEP * up * (y.high - y.low)];
    const box = this.brush;
    if (!box) {
      const middle = (r: Range, share: number): number => r.low + share * (r.high - r.low);
      const [ya, yb] = [middle(y, 0.375), middle(y, 0.625)];
      this.set({ x0: middle(x, 0.375), x1: middle(x, 0.625), y0: Math.min(ya, yb), y1: Math.max(ya, yb) });
    } else if (event.shiftKey) {
      const [w, t] = [Math.abs(dx) * across, Math.abs(dy) * up];
      this.set({ x0: box.x0 - w, x1: box.x1 + w, y0: box.y0 - t, y1: box.y1 + t });
    } else {
      this.set({ x0: box.x0 + dx, x1: box.x1 + dx, y0: box.y0 + dy, y1: box.y1 + dy });
    }
  }
}
