// What all panes share: the bar on top, the place of refusals, what is remembered.

import type { StartDocument } from "./api";
import { h, put, tell } from "./dom";
import { problemBox, problemOf } from "./problem";

/** Turns the page from light to dark and back. */
export function turnTheme(): void {
  const root = document.documentElement;
  const dark = root.dataset["theme"] === "dark" || (root.dataset["theme"] === undefined && window.matchMedia("(prefers-color-scheme: dark)").matches);
  root.dataset["theme"] = dark ? "light" : "dark";
  window.localStorage.setItem("theme", root.dataset["theme"]);
  window.dispatchEvent(new Event("theme"));
}

/** A pane's frame. What is asked for in it ends when it is left. */
export class Shell {
  readonly main = h("main", { id: "main" });
  readonly closed = new AbortController();
  private readonly problem = h("div", {});

  constructor(page: Element, kind: string, name: string, klass: string) {
    document.title = `${name} - RETINA ${kind.toLowerCase()}`;
    this.main.className = klass;
    page.replaceChildren(
      h(
        "header",
        {},
        h("a", { class: "home", href: "#", "data-key": "home" }, "RETINA"),
        h("h1", {}, `${kind}: ${name}`),
        h("div", { class: "tools" }, h("button", { type: "button", "data-key": "theme", click: turnTheme }, "Light / dark")),
      ),
      this.problem,
      this.main,
    );
  }

  close(): void {
    this.closed.abort();
  }

  /** Shows what was refused, unless the pane was left. */
  readonly failed = (error: unknown): void => {
    if (this.closed.signal.aborted || (error instanceof DOMException && error.name === "AbortError")) {
      return;
    }
    const problem = problemOf(error);
    put(this.problem, problemBox(problem, () => put(this.problem)));
    tell(problem.problem);
  };

  /** What was refused before is mended. */
  mended(): void {
    put(this.problem);
  }
}

/** What a pane had when it was left, by its name and what it shows. */
export function remembered<T extends object>(key: string, otherwise: T): T {
  try {
    return { ...otherwise, ...(JSON.parse(window.localStorage.getItem(`retina ${key}`) ?? "{}") as Partial<T>) };
  } catch {
    return otherwise;
  }
}

export function remember(key: string, value: object): void {
  try {
    window.localStorage.setItem(`retina ${key}`, JSON.stringify(value));
  } catch {
    // A browser without storage, or a full one: nothing but convenience is lost.
  }
}

export function field(label: string, input: HTMLElement): HTMLElement {
  return h("label", {}, label, input);
}

export function select(key: string, options: [string, string][], value: string, changed: (value: string) => void): HTMLSelectElement {
  const element = h("select", { "data-key": key }, ...options.map(([id, text]) => h("option", { value: id }, text)));
  element.value = options.some(([id]) => id === value) ? value : (options[0]?.[0] ?? "");
  element.addEventListener("change", () => changed(element.value));
  return element;
}

export function checkbox(key: string, label: string, value: boolean, changed: (value: boolean) => void): HTMLElement {
  const input = h("input", { type: "checkbox", "data-key": key, checked: value });
  input.addEventListener("change", () => changed(input.checked));
  return h("label", {}, input, label);
}

/** The rendered sequences of the given paths, for a choice among them. */
export function sequences(start: StartDocument): [string, string][] {
  return start.files.filter((file) => file.kind === "sequence").map(({ path, name }) => [path, name]);
}

/** Rows of a name and a value. */
export function facts(rows: [string, string][]): HTMLElement {
  return h("div", { class: "scroll", tabindex: 0 }, h("table", {}, h("tbody", {}, ...rows.map(([name, value]) => h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, value))))));
}

/** A number with a slider, and its value as text that can be typed. */
export interface Slider {
  element: HTMLElement;
  set: (value: number) => void;
}

export interface Range {
  low: number;
  high: number;
  /** Equal steps are equal ratios. */
  log?: boolean;
  digits?: number;
}

const STEPS = 2000;

export function slider(key: string, label: string, range: Range, value: number, moved: (value: number) => void, let_go: () => void): Slider {
  const { low, high, log } = range;
  const share = (v: number): number => (log ? Math.log(v / low) / Math.log(high / low) : (v - low) / (high - low));
  const at = (s: number): number => (log ? low * (high / low) ** s : low + s * (high - low));
  const text = (v: number): string => v.toFixed(range.digits ?? 1);
  const bar = h("input", { type: "range", min: 0, max: STEPS, step: 1, "data-key": key, "aria-label": label });
  const box = h("input", { type: "number", step: "any", "data-key": `${key}-number`, "aria-label": `${label}, as a number` });
  let now = value;
  const set = (v: number): void => {
    now = v;
    bar.value = String(Math.round(Math.min(1, Math.max(0, share(v))) * STEPS));
    box.value = text(v);
    bar.setAttribute("aria-valuetext", text(v));
  };
  set(value);
  bar.addEventListener("input", () => {
    now = at(Number(bar.value) / STEPS);
    box.value = text(now);
    bar.setAttribute("aria-valuetext", text(now));
    moved(now);
  });
  bar.addEventListener("change", let_go);
  box.addEventListener("change", () => {
    if (box.value.trim() === "") {
      set(now);
      return;
    }
    set(Math.min(high, Math.max(low, Number(box.value))));
    moved(now);
    let_go();
  });
  return { element: h("div", { class: "slider" }, h("span", {}, label), bar, box), set };
}

/** A file of text for the browser to keep. */
export function download(name: string, text: string): void {
  const link = h("a", { href: URL.createObjectURL(new Blob([text])), download: name });
  link.click();
  window.setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

/** Runs the last of what is asked for: one at a time, and what came between is left out. */
export class Latest<T> {
  private waiting: { asked: T } | null = null;
  private busy = false;

  constructor(
    private readonly work: (asked: T) => Promise<void>,
    private readonly failed: (error: unknown) => void,
  ) {}

  ask(asked: T): void {
    this.waiting = { asked };
    if (!this.busy) {
      void this.run();
    }
  }

  private async run(): Promise<void> {
    this.busy = true;
    while (this.waiting !== null) {
      const { asked } = this.waiting;
      this.waiting = null;
      try {
        await this.work(asked);
      } catch (error) {
        this.failed(error);
      }
    }
    this.busy = false;
  }
}
