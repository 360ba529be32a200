// A picture that one can look into: zoom, move, read values under the cursor, draw over it.

import { drawable, emptied } from "./canvas";
import { colour } from "./dom";
import { coloured, extent, type Numbers, type Stretch } from "./image";

export type Over = (context: CanvasRenderingContext2D, to: (x: number, y: number) => [number, number], scale: number) => void;

export interface Look {
  stretch: Stretch;
  /** What is black and what is white; the image's own extent where it is null. */
  range: [number, number] | null;
  signed: boolean;
}

const MOST_ZOOM = 64;

export class Picture {
  readonly canvas: HTMLCanvasElement;
  private readonly context: CanvasRenderingContext2D;
  private image: Numbers | null = null;
  private pixels: OffscreenCanvas | null = null;
  private over: Over | null = null;
  /** The image's point in the middle of the canvas, and CSS px a pixel; null shows all of it. */
  private place: { x: number; y: number; zoom: number } | null = null;
  private cursor: [number, number] | null = null;
  private drag: { x: number; y: number; moved: boolean } | null = null;
  /** Dragging does this instead of moving the picture, in CSS px. */
  dragged: ((dx: number, dy: number, shift: boolean) => void) | null = null;
  dropped: (() => void) | null = null;
  wheeled: ((delta: number) => void) | null = null;
  pressed: ((x: number, y: number) => void) | null = null;

  constructor(
    name: string,
    label: string,
    private readonly read: (x: number, y: number, value: number) => void,
  ) {
    ({ canvas: this.canvas, context: this.context } = drawable(name, () => this.redraw()));
    this.canvas.className = "picture";
    this.canvas.setAttribute("aria-label", label);
    this.canvas.addEventListener("pointerdown", (event) => this.down(event));
    this.canvas.addEventListener("pointermove", (event) => this.move(event));
    this.canvas.addEventListener("pointerup", (event) => this.up(event));
    this.canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.canvas.addEventListener("keydown", (event) => this.key(event));
    this.canvas.addEventListener("dblclick", () => this.whole());
  }

  /** Shows an image. The same part of it is looked at as before, also where a draft has fewer pixels. */
  show(image: Numbers, look: Look, over: Over | null): void {
    if (this.image && (this.image.width !== image.width || this.image.height !== image.height)) {
      const [across, down] = [image.width / this.image.width, image.height / this.image.height];
      const alike = Math.abs(across / down - 1) < 0.02;
      this.place = this.place && alike ? { x: this.place.x * across, y: this.place.y * down, zoom: this.place.zoom / across } : null;
      this.cursor = this.cursor && alike ? [Math.floor(this.cursor[0] * across), Math.floor(this.cursor[1] * down)] : null;
    }
    this.image = image;
    this.over = over;
    this.pixels = new OffscreenCanvas(image.width, image.height);
    this.pixels.getContext("2d")?.putImageData(coloured(image, look.range ?? extent(image), look.stretch, look.signed), 0, 0);
    this.canvas.style.setProperty("aspect-ratio", `${image.width} / ${image.height}`);
    this.canvas.dataset["shown"] = String(Number(this.canvas.dataset["shown"] ?? 0) + 1);
    this.redraw();
    this.tellCursor();
  }

  /** Shows nothing. */
  clear(): void {
    this.image = this.pixels = null;
    this.redraw();
  }

  whole(): void {
    this.place = null;
    this.redraw();
  }

  private at(): { x: number; y: number; zoom: number } {
    const { clientWidth, clientHeight } = this.canvas;
    const { width, height } = this.image ?? { width: 1, height: 1 };
    return this.place ?? { x: width / 2, y: height / 2, zoom: Math.min(clientWidth / width, clientHeight / height) };
  }

  private toCanvas(x: number, y: number): [number, number] {
    const at = this.at();
    return [this.canvas.clientWidth / 2 + (x - at.x) * at.zoom, this.canvas.clientHeight / 2 + (y - at.y) * at.zoom];
  }

  private toImage(event: MouseEvent): [number, number] {
    const box = this.canvas.getBoundingClientRect();
    const at = this.at();
    return [at.x + (event.clientX - box.left - box.width / 2) / at.zoom, at.y + (event.clientY - box.top - box.height / 2) / at.zoom];
  }

  redraw(): void {
    const c = this.context;
    emptied(this.canvas, c);
    const { image, pixels } = this;
    if (!image || !pixels || this.canvas.clientWidth < 20) {
      return;
    }
    const { zoom } = this.at();
    const [left, top] = this.toCanvas(0, 0);
    c.imageSmoothingEnabled = zoom < 1.5;
    c.imageSmoothingQuality = "high";
    c.drawImage(pixels, left, top, image.width * zoom, image.height * zoom);
    this.over?.(c, (x, y) => this.toCanvas(x, y), zoom);
    if (this.cursor) {
      const [x, y] = this.toCanvas(this.cursor[0] + 0.5, this.cursor[1] + 0.5);
      c.strokeStyle = colour("mark");
      c.lineWidth = 1;
      c.beginPath();
      for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]] as const) {
        c.moveTo(x + 5 * dx, y + 5 * dy);
        c.lineTo(x + 13 * dx, y + 13 * dy);
      }
      c.stroke();
    }
  }

  private tellCursor(): void {
    const image = this.image;
    if (this.cursor && image) {
      const [x, y] = this.cursor;
      this.read(x, y, image.values[y * image.width + x] as number);
    }
  }

  private setCursor(x: number, y: number): void {
    const image = this.image;
    if (!image) {
      return;
    }
    this.cursor = [Math.min(image.width - 1, Math.max(0, Math.floor(x))), Math.min(image.height - 1, Math.max(0, Math.floor(y)))];
    this.tellCursor();
    this.redraw();
  }

  /** Moves a zoomed picture until the cursor is well inside. */
  private follow(): void {
    if (!this.place || !this.cursor) {
      return;
    }
    const room = (size: number): number => (0.45 * size) / (this.place?.zoom ?? 1);
    const kept = (middle: number, at: number, most: number): number => Math.min(at + most, Math.max(at - most, middle));
    this.place.x = kept(this.place.x, this.cursor[0], room(this.canvas.clientWidth));
    this.place.y = kept(this.place.y, this.cursor[1], room(this.canvas.clientHeight));
    this.redraw();
  }

  private zoomBy(factor: number, [x, y]: [number, number]): void {
    const at = this.at();
    const { width, height } = this.image ?? { width: 1, height: 1 };
    const least = Math.min(this.canvas.clientWidth / width, this.canvas.clientHeight / height);
    const zoom = Math.min(MOST_ZOOM, at.zoom * factor);
    this.place = zoom <= least ? null : { x: x + ((at.x - x) * at.zoom) / zoom, y: y + ((at.y - y) * at.zoom) / zoom, zoom };
    this.redraw();
  }

  private down(event: PointerEvent): void {
    if (event.button === 0) {
      this.canvas.setPointerCapture(event.pointerId);
      this.drag = { x: event.clientX, y: event.clientY, moved: false };
    }
  }

  private move(event: PointerEvent): void {
    if (!this.drag) {
      this.setCursor(...this.toImage(event));
      return;
    }
    const [dx, dy] = [event.clientX - this.drag.x, event.clientY - this.drag.y];
    if (!this.drag.moved && Math.hypot(dx, dy) < 4) {
      return;
    }
    this.drag = { x: event.clientX, y: event.clientY, moved: true };
    if (this.dragged) {
      this.dragged(dx, dy, event.shiftKey);
    } else {
      const at = this.at();
      this.place = { x: at.x - dx / at.zoom, y: at.y - dy / at.zoom, zoom: at.zoom };
      this.redraw();
    }
  }

  private up(event: PointerEvent): void {
    const moved = this.drag?.moved;
    this.drag = null;
    if (moved) {
      this.dropped?.();
    } else if (moved === false) {
      this.setCursor(...this.toImage(event));
      this.press();
    }
  }

  private press(): void {
    if (this.cursor) {
      this.pressed?.(this.cursor[0] + 0.5, this.cursor[1] + 0.5);
    }
  }

  private wheel(event: WheelEvent): void {
    event.preventDefault();
    if (this.wheeled) {
      this.wheeled(event.deltaY);
    } else {
      this.zoomBy(1.0015 ** -event.deltaY, this.toImage(event));
    }
  }

  /** Arrows move the cursor, with Shift by ten; + and - zoom at it, 0 shows all, Enter presses. */
  private key(event: KeyboardEvent): void {
    const image = this.image;
    if (!image || event.ctrlKey || event.metaKey || event.altKey) {
      return;
    }
    const [x, y] = this.cursor ?? [Math.floor(image.width / 2), Math.floor(image.height / 2)];
    const step = event.shiftKey ? 10 : 1;
    const moves: Record<string, [number, number]> = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] };
    const by = moves[event.key];
    if (by) {
      this.setCursor(x + by[0], y + by[1]);
      this.follow();
    } else if (event.key === "+" || event.key === "=" || event.key === "-") {
      this.zoomBy(event.key === "-" ? 1 / 1.5 : 1.5, [x, y]);
    } else if (event.key === "0") {
      this.whole();
    } else if (event.key === "Enter") {
      this.setCursor(x, y);
      this.press();
    } else {
      return;
    }
    event.preventDefault();
  }
}
