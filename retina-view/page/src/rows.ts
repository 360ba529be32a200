// Rows in binary, and what is made of them for plots: means of cells and of bins.

export interface Columns {
  rows: number;
  shown: number;
  table: string;
  components: number;
  unit: string;
  half_height: number | null;
  groups: string[];
  columns: { name: string; label: string }[];
  group: Float32Array;
  values: Float32Array[];
}

/** Errors and effects of a model, one array a component. */
export interface ModelRows {
  residual: Float32Array[];
  effect: Float32Array[];
  outlier: Float32Array;
  heldout_rms: number;
}

function parts(buffer: ArrayBuffer): { header: unknown; column: (index: number, shown: number) => Float32Array } {
  const length = new DataView(buffer).getUint32(0, true);
  const header: unknown = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const start = 4 + length;
  return { header, column: (index, shown) => new Float32Array(buffer, start + 4 * index * shown, shown) };
}

export function readColumns(buffer: ArrayBuffer): Columns {
  const { header, column } = parts(buffer);
  const told = header as Omit<Columns, "group" | "values">;
  const values = told.columns.map((_, index) => column(index + 1, told.shown));
  return { ...told, group: column(0, told.shown), values };
}

export function readRows(buffer: ArrayBuffer): ModelRows {
  const { header, column } = parts(buffer);
  const told = header as { components: number; shown: number; heldout_rms: number };
  const n = told.components;
  const all = Array.from({ length: 2 * n + 1 }, (_, index) => column(index, told.shown));
  return {
    residual: all.slice(0, n),
    effect: all.slice(n, 2 * n),
    outlier: all[2 * n] ?? new Float32Array(),
    heldout_rms: told.heldout_rms,
  };
}

/** The column of a name. */
export function columnOf(data: Columns, name: string): Float32Array | null {
  const index = data.columns.findIndex((column) => column.name === name);
  return data.values[index] ?? null;
}

export type Kept = (row: number) => boolean;

export interface Arrow {
  x: number;
  y: number;
  dx: number;
  dy: number;
  rows: number;
}

/** Cells across the field. */
const CELLS_ACROSS = 14;

/** Mean vectors of the cells of a grid over x, y in -1..1. */
export function cellMeans(data: Columns, vectors: Float32Array[], kept: Kept): Arrow[] {
  const [x, y] = [columnOf(data, "x"), columnOf(data, "y")];
  const [vx, vy] = vectors;
  if (!x || !y || !vx || !vy) {
    return [];
  }
  const width = 2 / CELLS_ACROSS;
  const cells = new Map<string, Arrow>();
  for (let row = 0; row < data.shown; row++) {
    if (!kept(row)) {
      continue;
    }
    const key = `${Math.floor((x[row] as number) / width)},${Math.floor((y[row] as number) / width)}`;
    const cell = cells.get(key) ?? { x: 0, y: 0, dx: 0, dy: 0, rows: 0 };
    cell.x += x[row] as number;
    cell.y += y[row] as number;
    cell.dx += vx[row] as number;
    cell.dy += vy[row] as number;
    cell.rows += 1;
    cells.set(key, cell);
  }
  return [...cells.values()].map((c) => ({
    x: c.x / c.rows,
    y: c.y / c.rows,
    dx: c.dx / c.rows,
    dy: c.dy / c.rows,
    rows: c.rows,
  }));
}

/** How a vector becomes one number. */
export type Part = "x" | "y" | "along" | "across" | "value";

/** One number a row: a component, or the one along the radius or across it. */
export function partOf(data: Columns, vectors: Float32Array[], part: Part): Float32Array {
  const [vx, vy] = vectors;
  const [x, y] = [columnOf(data, "x"), columnOf(data, "y")];
  if (!vx) {
    return new Float32Array();
  }
  if (part === "x" || part === "value" || !vy) {
    return vx;
  }
  if (part === "y" || !x || !y) {
    return vy;
  }
  const out = new Float32Array(data.shown);
  for (let row = 0; row < out.length; row++) {
    const [px, py] = [x[row] as number, y[row] as number];
    const r = Math.hypot(px, py) || 1;
    const [ux, uy] = part === "along" ? [px / r, py / r] : [-py / r, px / r];
    out[row] = (vx[row] as number) * ux + (vy[row] as number) * uy;
  }
  return out;
}

export interface Bin {
  at: number;
  mean: number;
  /** One standard deviation of the mean. */
  sigma: number;
}

/** Means in bins of about equal numbers of rows; a column of few values has a bin each. */
export function binMeans(column: Float32Array, values: Float32Array, kept: Kept): Bin[] {
  const rows: number[] = [];
  for (let row = 0; row < column.length; row++) {
    if (kept(row) && Number.isFinite(column[row]) && Number.isFinite(values[row])) {
      rows.push(row);
    }
  }
  rows.sort((a, b) => (column[a] as number) - (column[b] as number));
  const least = Math.max(5, Math.ceil(rows.length / 16));
  const bins: Bin[] = [];
  for (let start = 0; start < rows.length; ) {
    let end = Math.min(rows.length, start + least);
    const last = column[rows[end - 1] as number];
    while (end < rows.length && column[rows[end] as number] === last) {
      end++;
    }
    const own = rows.slice(start, end);
    const mean = own.reduce((sum, row) => sum + (values[row] as number), 0) / own.length;
    const square = own.reduce((sum, row) => sum + ((values[row] as number) - mean) ** 2, 0);
    const at = own.reduce((sum, row) => sum + (column[row] as number), 0) / own.length;
    if (own.length > 1) {
      bins.push({ at, mean, sigma: Math.sqrt(square / (own.length - 1) / own.length) });
    }
    start = end;
  }
  return bins;
}

/** The value that a share of the sizes is below. */
export function quantile(values: ArrayLike<number>, share: number): number {
  const sizes = Array.from(values, Math.abs).filter(Number.isFinite);
  sizes.sort((a, b) => a - b);
  return sizes[Math.min(sizes.length - 1, Math.floor(share * sizes.length))] ?? 0;
}

/** A number as people read it: three digits that count. */
export function told(value: number): string {
  if (value === 0 || !Number.isFinite(value)) {
    return String(value);
  }
  const size = Math.abs(value);
  return size >= 1e5 || size < 1e-3 ? value.toExponential(2) : Number(value.toPrecision(3)).toString();
}

/** Ends of steps of 1, 2 or 5 within a range. */
export function ticks(low: number, high: number, most: number): number[] {
  const rough = (high - low) / Math.max(most, 1);
  if (!(rough > 0) || !Number.isFinite(rough)) {
    return [];
  }
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((factor) => factor * power >= rough) ?? 10);
  const out: number[] = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) {
    out.push(Number((k * step).toPrecision(12)));
  }
  return out;
}
