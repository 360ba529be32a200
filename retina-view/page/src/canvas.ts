// Canvases that one can reach by keyboard, as sharp as the screen.

/** A canvas that is drawn anew when its size changes. */
export function drawable(name: string, redraw: () => void): { canvas: HTMLCanvasElement; context: CanvasRenderingContext2D } {
  const canvas = document.createElement("canvas");
  canvas.tabIndex = 0;
  canvas.setAttribute("role", "img");
  canvas.setAttribute("data-key", name);
  const context = canvas.getContext("2d");
  if (!context) {
    throw new Error("this browser has no canvas");
  }
  new ResizeObserver(redraw).observe(canvas);
  return { canvas, context };
}

/** Empties a canvas; what is drawn next is in CSS px, whatever the screen has. */
export function emptied(canvas: HTMLCanvasElement, context: CanvasRenderingContext2D): void {
  const ratio = window.devicePixelRatio || 1;
  canvas.width = Math.round(canvas.clientWidth * ratio);
  canvas.height = Math.round(canvas.clientHeight * ratio);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
}
