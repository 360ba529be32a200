// Images as numbers: from the server, and onto pixels.

import { answer, Refused } from "./api";

/** An image row by row. */
export interface Numbers {
  width: number;
  height: number;
  values: Uint8Array | Uint8ClampedArray | Uint16Array | Float32Array;
}

export type Stretch = "linear" | "root" | "log";

/** An image of the server with what it says of it; without a body it is asked for by GET. */
export async function getNumbers<F>(path: string, type: "u8" | "u16" | "f32", body: unknown, signal: AbortSignal): Promise<{ image: Numbers; facts: F }> {
  const init: RequestInit = body === undefined ? { signal } : { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), signal };
  const response = await answer(path, init);
  const bytes = await response.arrayBuffer();
  const [width, height] = new Uint32Array(bytes.slice(0, 8));
  if (width === undefined || height === undefined) {
    throw new Refused(0, { problem: "The program sent an image without a size." });
  }
  const values = { u8: () => new Uint8Array(bytes, 8), u16: () => new Uint16Array(bytes.slice(8)), f32: () => new Float32Array(bytes.slice(8)) }[type]();
  return { image: { width, height, values }, facts: JSON.parse(response.headers.get("x-retina") ?? "{}") as F };
}

/** The counts of a grey PNG. */
export async function getCounts(path: string, signal: AbortSignal): Promise<Numbers> {
  const response = await answer(path, { signal });
  const bytes = await response.blob();
  const bitmap = await createImageBitmap(bytes, { colorSpaceConversion: "none", premultiplyAlpha: "none" }).catch(() => {
    throw new Refused(0, { problem: "The frame's PNG is damaged: it does not decode." });
  });
  const { width, height } = bitmap;
  const canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d", { willReadFrequently: true });
  if (!context) {
    throw new Error("this browser has no canvas");
  }
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  const rgba = context.getImageData(0, 0, width, height).data;
  const values = new Uint8Array(width * height);
  for (let k = 0; k < values.length; k++) {
    values[k] = rgba[4 * k + 1] as number;
  }
  return { width, height, values };
}

/** Lowest and highest of what is a number. */
export function extent(image: Numbers): [number, number] {
  let [low, high] = [Infinity, -Infinity];
  for (const value of image.values) {
    if (Number.isFinite(value)) {
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  return low <= high ? [low, high] : [0, 1];
}

/** Blue, white, vermilion: for differences. */
function diverging(t: number): [number, number, number] {
  const [from, to] = t < 0.5 ? [[0, 89, 140], [245, 245, 245]] : [[245, 245, 245], [182, 69, 0]];
  const s = t < 0.5 ? 2 * t : 2 * t - 1;
  return [0, 1, 2].map((k) => (from?.[k] ?? 0) * (1 - s) + (to?.[k] ?? 0) * s) as [number, number, number];
}

const LEVELS = 1024;

/** The colours of the numbers between two values. */
export function coloured(image: Numbers, [low, high]: [number, number], stretch: Stretch, signed = false): ImageData {
  const out = new ImageData(image.width, image.height);
  const table = new Uint8ClampedArray(3 * (LEVELS + 1));
  for (let k = 0; k <= LEVELS; k++) {
    const t = k / LEVELS;
    const s = stretch === "log" ? Math.log1p(999 * t) / Math.log(1000) : stretch === "root" ? Math.sqrt(t) : t;
    table.set(signed ? diverging(t) : [255 * s, 255 * s, 255 * s], 3 * k);
  }
  const scale = LEVELS / (high > low ? high - low : 1);
  const { values } = image;
  for (let k = 0; k < values.length; k++) {
    const value = values[k] as number;
    // What is no number is transparent: the page shows through.
    const level = Number.isFinite(value) ? Math.min(LEVELS, Math.max(0, Math.round((value - low) * scale))) : -1;
    if (level >= 0) {
      out.data[4 * k] = table[3 * level] as number;
      out.data[4 * k + 1] = table[3 * level + 1] as number;
      out.data[4 * k + 2] = table[3 * level + 2] as number;
      out.data[4 * k + 3] = 255;
    }
  }
  return out;
}

/** How often each value comes, in bins from the lowest to the highest. */
export function histogram(image: Numbers, [low, high]: [number, number], bins: number): Float64Array {
  const counts = new Float64Array(bins);
  const scale = bins / (high > low ? high - low : 1);
  for (const value of image.values) {
    if (Number.isFinite(value)) {
      const bin = Math.min(bins - 1, Math.max(0, Math.floor((value - low) * scale)));
      counts[bin] = (counts[bin] as number) + 1;
    }
  }
  return counts;
}
