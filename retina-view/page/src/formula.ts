// One's own effect: a formula whose units are checked as it is typed.

import { post, type Problem, type SessionNews } from "./api";
import { h, put } from "./dom";
import { problemOf } from "./problem";

const TEMPLATES: Record<string, string> = {
  points: `name = "settling"
unit = "arcsec"
dx = "a * x * exp(-time_s / tau)"
dy = "a * y * exp(-time_s / tau)"
[parameters]
a = { start = 1.0, unit = "arcsec" }
tau = { start = 600.0, unit = "s" }
`,
  power: `name = "offset"
unit = "relative"
value = "a * digital_count"
[parameters]
a = { start = 0.001, unit = "relative" }
`,
  phase: `name = "slope"
unit = "mag"
value = "a * phase_deg"
[parameters]
a = { start = 0.001, unit = "mag/deg" }
`,
};

/** How long nothing is typed before the formula is checked, ms. */
const PAUSE_MS = 250;

export class FormulaEditor {
  readonly element: HTMLElement;
  private readonly text: HTMLTextAreaElement;
  private readonly said = h("div", { class: "checked", "aria-live": "polite", id: "formula-said" });
  private readonly add: HTMLButtonElement;
  private timer = 0;
  private asked = 0;

  constructor(
    private readonly session: () => string,
    table: string,
    columns: string[],
    private readonly added: (news: SessionNews) => void,
  ) {
    this.text = h("textarea", { rows: 8, spellcheck: "false", "aria-label": "Formula of your own effect", "aria-describedby": "formula-said", "data-key": "formula" });
    this.text.value = TEMPLATES[table] ?? "";
    this.text.addEventListener("input", () => this.typed());
    this.add = h("button", { type: "button", class: "primary", "data-key": "formula-add", disabled: true, click: () => void this.send() }, "Add to the model");
    this.element = h(
      "details",
      { class: "formula", toggle: () => this.typed() },
      h("summary", { "data-key": "formula-open" }, "Your own formula"),
      this.text,
      this.said,
      this.add,
      h("p", { class: "dim" }, `Columns: ${columns.join(", ")}. Functions: sin cos tan tanh exp ln log10 sqrt abs step; pi.`),
    );
  }

  /** Shows a formula of the model, to be changed. */
  edit(text: string): void {
    this.text.value = text;
    this.element.setAttribute("open", "");
    this.text.focus();
    this.typed();
  }

  private typed(): void {
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => void this.check(), PAUSE_MS);
  }

  private async check(): Promise<void> {
    const own = ++this.asked;
    let problem: Problem | null = null;
    let name = "";
    try {
      const checked = await post<{ name: string | null; problem: Problem | null }>(`/api/sessions/${this.session()}/formula`, { text: this.text.value, add: false });
      problem = checked.problem;
      name = checked.name ?? "";
    } catch (error) {
      problem = problemOf(error);
    }
    if (own !== this.asked) {
      return;
    }
    this.add.disabled = problem !== null;
    this.text.setAttribute("aria-invalid", String(problem !== null));
    put(this.said, ...(problem ? this.pointed(problem) : [h("p", { class: "good" }, `${name}: units and columns fit.`)]));
  }

  /** The line of the error with the place underlined. */
  private pointed(problem: Problem): Node[] {
    const said = [problem.what ?? problem.problem, problem.found ? `found ${problem.found}` : "", problem.expected ? `expected ${problem.expected}` : ""];
    const out: Node[] = [];
    if (problem.snippet) {
      // The server counts bytes.
      const bytes = new TextEncoder().encode(this.text.value);
      const decode = (from: number, to: number): string => new TextDecoder().decode(bytes.slice(from, to));
      const [before, at] = [decode(0, problem.snippet.offset), decode(problem.snippet.offset, problem.snippet.offset + problem.snippet.length)];
      const line = before.slice(before.lastIndexOf("\n") + 1);
      const rest = decode(problem.snippet.offset + problem.snippet.length, bytes.length).split("\n")[0] ?? "";
      out.push(h("pre", {}, line, h("mark", {}, at || " "), rest));
    }
    out.push(h("p", { class: "bad" }, said.filter((part) => part !== "").join("; ")));
    if (problem.help) {
      out.push(h("p", { class: "bad" }, problem.help));
    }
    return out;
  }

  private async send(): Promise<void> {
    try {
      this.added(await post<SessionNews>(`/api/sessions/${this.session()}/formula`, { text: this.text.value, add: true }));
    } catch (error) {
      put(this.said, ...this.pointed(problemOf(error)));
    }
  }
}
