// A session on the page: what is explained, where the model fails, what the missing effect may be.

import { type CatalogueEffect, type FitDocument, get, getBytes, getText, post, Refused, type SessionNews } from "./api";
import { candidates } from "./candidates";
import { h, put, tell } from "./dom";
import { chooser, takeDrops } from "./drop";
import { FormulaEditor } from "./formula";
import { ladder } from "./ladder";
import { dataPanel, modelName, modelPanel } from "./model";
import { Plots } from "./plots";
import { problemBox, problemOf } from "./problem";
import { turnTheme } from "./shell";
import { type Columns, type ModelRows, readColumns, readRows, told } from "./rows";

/** Between two models that blink: slower than what may hurt, ms. */
const BLINK_MS = 700;

interface Known {
  fit: FitDocument;
  rows: ModelRows;
}

const JOBS = { bench: "Measuring on the bench", read: "Reading the tables", diagnose: "Looking for candidates", investigate: "Looking for a formula" };

export class Workbench {
  private news: SessionNews | null = null;
  private data: Columns | null = null;
  private tables = "";
  private known = new Map<string, Known>();
  private shownFit: FitDocument | null = null;
  private lastHeldOut: number | null = null;
  private previewed: string | null = null;
  private mayBeShows = "";
  private formula: FormulaEditor | null = null;
  private catalogue: CatalogueEffect[] = [];
  private blinker = 0;
  private blinkWith: number | null = null;
  private closed = new AbortController();
  private turn: Promise<void> = Promise.resolve();
  private busy = false;
  private readonly plots = new Plots();
  private readonly header = h("header", {});
  private readonly problem = h("div", {});
  private readonly explained = h("div", {});
  private readonly ladderBox = h("div", {});
  private readonly modelBox = h("div", {});
  private readonly dataBox = h("div", {});
  private readonly formulaBox = h("div", {});
  private readonly triedBox = h("div", {});
  private readonly mayBe = h("div", {});
  private readonly commandBox = h("div", {});
  private readonly undoDrops: () => void;

  constructor(
    page: Element,
    private readonly id: string,
    private readonly open: (id: string) => void,
  ) {
    this.undoDrops = takeDrops(() => this.id, open, (error) => this.failed(error));
    page.replaceChildren(
      this.header,
      this.problem,
      h(
        "main",
        { id: "main", class: "workbench" },
        h("section", { class: "explained", "aria-labelledby": "h-explained" }, h("h2", { id: "h-explained" }, "Explained"), this.explained, this.ladderBox, h("h3", {}, "Model"), this.modelBox, this.formulaBox, h("h3", {}, "Models tried"), this.triedBox, h("h3", {}, "Data"), this.dataBox, this.commandBox),
        h("section", { class: "fails", "aria-labelledby": "h-fails" }, h("h2", { id: "h-fails" }, "Where it fails"), this.plots.element),
        h("section", { class: "maybe", "aria-labelledby": "h-maybe" }, h("h2", { id: "h-maybe" }, "What it may be"), this.mayBe),
      ),
    );
    document.addEventListener("keydown", this.keys, { signal: this.closed.signal });
    window.addEventListener("theme", () => this.plots.redraw(), { signal: this.closed.signal });
    get<{ effects: CatalogueEffect[] }>("/api/effects").then((all) => (this.catalogue = all.effects), (e) => this.failed(e));
    void this.listen();
  }

  close(): void {
    this.closed.abort();
    this.undoDrops();
    this.stopBlinking();
  }

  // ---- news of the session

  /** Waits for news, for as long as the page is open. */
  private async listen(): Promise<void> {
    while (!this.closed.signal.aborted) {
      try {
        const seen = this.news ? `?seen=${this.news.revision}` : "";
        await this.take(await get<SessionNews>(`/api/sessions/${this.id}${seen}`, this.closed.signal));
      } catch (error) {
        if (this.closed.signal.aborted) {
          return;
        }
        this.failed(error);
        if (error instanceof Refused && error.status !== 0) {
          return;
        }
        await new Promise((later) => window.setTimeout(later, 2000));
      }
    }
  }

  /** Shows news, one after the other: what came first is shown first. */
  private take(news: SessionNews): Promise<void> {
    this.turn = this.turn.then(() => this.shown(news)).catch((error: unknown) => this.failed(error));
    return this.turn;
  }

  private async shown(news: SessionNews): Promise<void> {
    if (this.closed.signal.aborted || (this.news && news.revision < this.news.revision)) {
      return;
    }
    const before = this.news;
    this.news = news;
    document.title = `${news.name} - RETINA workbench`;
    put(this.problem, ...(news.problem ? [problemBox(news.problem, null)] : []));
    this.drawHeader();
    if (news.phase !== "ready") {
      this.drawWaiting();
      return;
    }
    const tables = JSON.stringify(news.inputs.tables);
    if (!this.data || tables !== this.tables) {
      this.data = readColumns(await getBytes(`/api/sessions/${this.id}/columns`));
      this.tables = tables;
      this.known.clear();
      this.plots.setData(this.data, (await this.modelAt(0)).rows);
      this.makeFormula();
    }
    const moved = !before || before.phase !== "ready" || before.at !== news.at || JSON.stringify(before.models) !== JSON.stringify(news.models);
    const { fit, rows } = await this.modelAt(news.at);
    if (moved || this.shownFit !== fit) {
      this.previewed = null;
      this.stopBlinking();
      this.shownFit = fit;
      this.plots.setModel(rows, modelName(news.models[news.at] ?? []));
      this.drawExplained(fit);
    }
    this.drawMayBe();
  }

  private key(at: number): string {
    return (this.news?.models[at] ?? []).map((effect) => effect.text).join("\n");
  }

  private async modelAt(at: number): Promise<Known> {
    const key = this.key(at);
    const known = this.known.get(key);
    if (known) {
      return known;
    }
    const path = `/api/sessions/${this.id}/models/${at}`;
    const [fit, bytes] = await Promise.all([get<FitDocument>(path), getBytes(`${path}/rows`)]);
    const made = { fit, rows: readRows(bytes) };
    this.known.set(key, made);
    return made;
  }

  private failed(error: unknown): void {
    if (error instanceof DOMException && error.name === "AbortError") {
      return;
    }
    put(this.problem, problemBox(problemOf(error), () => put(this.problem)));
  }

  // ---- what one does

  private readonly candidateActions = {
    add: (effect: string) => this.step({ add: effect }),
    preview: (effect: string | null) => void this.preview(effect),
    measure: () => this.ask("job/next", {}),
    look: () => this.ask("job/diagnose", {}),
    formulas: {
      look: () => this.ask("job/investigate", {}),
      add: (text: string) => this.ask("formula", { text, add: true }),
    },
  };

  private readonly modelActions = {
    remove: (effect: string) => this.step({ remove: effect }),
    edit: (effect: string) => {
      get<{ text: string }>(`/api/sessions/${this.id}/formula?name=${encodeURIComponent(effect)}`).then((own) => this.formula?.edit(own.text), (e) => this.failed(e));
    },
    go: (at: number) => this.step({ at }),
    leaveOut: (table: number) => this.ask("leave-out", { table }),
  };

  private step(body: unknown): void {
    this.ask("model", body);
  }

  private ask(what: string, body: unknown): void {
    if (this.busy) {
      return;
    }
    this.busy = true;
    document.body.classList.add("busy");
    put(this.problem);
    const done = (): void => {
      this.busy = false;
      document.body.classList.remove("busy");
    };
    post<SessionNews>(`/api/sessions/${this.id}/${what}`, body)
      .then((news) => this.take(news), (error) => this.failed(error))
      .finally(done);
  }

  private async preview(effect: string | null): Promise<void> {
    if (!this.news) {
      return;
    }
    try {
      const rows = effect === null ? null : readRows(await getBytes(`/api/sessions/${this.id}/preview/${effect}`));
      this.previewed = effect;
      // What the model already explains is not drawn again.
      const { rows: now } = await this.modelAt(this.news.at);
      const added = rows?.effect.map((axis, k) => axis.map((value, row) => value - (now.effect[k]?.[row] ?? 0))) ?? null;
      const covariates = this.catalogue.find((own) => own.effect === effect)?.covariates ?? [];
      this.plots.setPreview(added, covariates);
      this.drawMayBe();
    } catch (error) {
      this.failed(error);
    }
  }

  private undo(): void {
    if (this.news && this.news.at > 0) {
      this.step({ at: this.news.at - 1 });
    }
  }

  private redo(): void {
    if (this.news && this.news.at + 1 < this.news.models.length) {
      this.step({ at: this.news.at + 1 });
    }
  }

  private readonly keys = (event: KeyboardEvent): void => {
    const typing = event.target instanceof HTMLTextAreaElement || event.target instanceof HTMLInputElement;
    if (typing || !(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z") {
      return;
    }
    event.preventDefault();
    if (event.shiftKey) {
      this.redo();
    } else {
      this.undo();
    }
  };

  // ---- blinking

  private stopBlinking(): void {
    window.clearInterval(this.blinker);
    this.blinker = 0;
    this.plots.setBlink(null, "");
  }

  /** Two models in turn; for those who want no motion, one turn a press. */
  private async blink(): Promise<void> {
    const news = this.news;
    const other = this.blinkWith ?? (news && news.at > 0 ? news.at - 1 : null);
    if (!news || other === null || other === news.at || !news.models[other]) {
      return;
    }
    const rows = (await this.modelAt(other)).rows;
    const flip = (): void => {
      if (this.plots.blinking()) {
        this.plots.setBlink(null, "");
      } else {
        this.plots.setBlink(rows, modelName(news.models[other] ?? []));
      }
    };
    if (window.matchMedia("(prefers-reduced-motion: reduce)").matches) {
      flip();
    } else if (this.blinker !== 0) {
      this.stopBlinking();
    } else {
      flip();
      this.blinker = window.setInterval(flip, BLINK_MS);
    }
    this.drawHeader();
  }

  // ---- what is drawn

  private drawHeader(): void {
    const news = this.news;
    if (!news) {
      return;
    }
    const job = news.job;
    const button = (label: string, key: string, disabled: boolean, click: () => void, more: Record<string, string> = {}): HTMLElement =>
      h("button", { type: "button", "data-key": key, disabled, click, ...more }, label);
    const exports = news.phase === "ready" ? ["fit.html", ...(news.diagnosis ? ["diagnosis.html"] : []), "model.toml", "predictions.csv", "commands.txt"] : [];
    put(
      this.header,
      h("a", { href: "#", class: "home", "data-key": "home" }, "RETINA"),
      h("h1", {}, news.name),
      job
        ? h("span", { class: "job" }, JOBS[job.kind], job.total > 0 ? h("progress", { max: job.total, value: job.done, "aria-label": JOBS[job.kind] }) : null, button("Stop", "cancel", false, () => this.ask("job/cancel", {})))
        : null,
      h(
        "div",
        { class: "tools" },
        button("Undo", "undo", news.at === 0, () => this.undo(), { title: "Ctrl+Z" }),
        button("Redo", "redo", news.at + 1 >= news.models.length, () => this.redo(), { title: "Ctrl+Shift+Z" }),
        button("Blink", "blink", news.models.length < 2 || (news.at === 0 && this.blinkWith === null), () => void this.blink(), { "aria-pressed": String(this.blinker !== 0) }),
        h("details", { class: "menu" }, h("summary", { "data-key": "export" }, "Export"), h("ul", {}, ...exports.map((what) => h("li", {}, h("a", { href: `/api/sessions/${this.id}/export/${what}`, download: what, "data-key": what, click: (event: Event) => void this.exported(event, what) }, what))))),
        chooser("Load", () => this.id, this.open, (error) => this.failed(error)),
        button("Light / dark", "theme", false, turnTheme),
      ),
    );
  }

  /** Fetched first, so that a refusal is told on the page. */
  private async exported(event: Event, what: string): Promise<void> {
    event.preventDefault();
    this.header.querySelector(".menu")?.removeAttribute("open");
    try {
      const text = await getText(`/api/sessions/${this.id}/export/${what}`);
      if (what === "commands.txt") {
        put(this.commandBox, h("h3", {}, "The same by commands"), h("pre", { class: "commands", tabindex: 0 }, text));
        this.commandBox.scrollIntoView({ block: "nearest" });
        return;
      }
      const link = h("a", { href: URL.createObjectURL(new Blob([text])), download: what });
      link.click();
      window.setTimeout(() => URL.revokeObjectURL(link.href), 1000);
    } catch (error) {
      this.failed(error);
    }
  }

  private drawWaiting(): void {
    const news = this.news;
    if (!news || this.data) {
      return;
    }
    const stopped = news.phase === "failed" && !news.job;
    put(
      this.explained,
      stopped
        ? h("button", { type: "button", class: "primary", "data-key": "again", click: () => this.ask("job/diagnose", {}) }, "Start again")
        : h("p", { class: "dim" }, news.job?.kind === "bench" ? "The virtual bench makes the data ..." : "Reading ..."),
    );
  }

  /** Drawn anew only where it would differ: the news of a job's progress come many times a second. */
  private drawMayBe(): void {
    const news = this.news;
    if (!news) {
      return;
    }
    const shows = JSON.stringify([news.diagnosis, news.investigation, news.models[news.at], news.job?.kind, news.can_measure, news.inputs.bench, this.previewed]);
    if (shows !== this.mayBeShows) {
      this.mayBeShows = shows;
      put(this.mayBe, ...candidates(news, this.previewed, this.candidateActions));
    }
  }

  private makeFormula(): void {
    const data = this.data;
    if (!data) {
      return;
    }
    this.formula = new FormulaEditor(() => this.id, data.table, data.columns.map((column) => column.name), (news) => void this.take(news));
    put(this.formulaBox, this.formula.element);
  }

  private drawExplained(fit: FitDocument): void {
    const news = this.news;
    if (!news) {
      return;
    }
    const noise = fit.noise_floor;
    const fell = this.lastHeldOut !== null && this.lastHeldOut !== fit.heldout_rms ? ` It was ${told(this.lastHeldOut)}.` : "";
    this.lastHeldOut = fit.heldout_rms;
    put(
      this.explained,
      h("p", { class: "big", "data-heldout": fit.heldout_rms }, told(fit.heldout_rms), h("small", {}, ` ${fit.unit} held-out error; the noise is ${told(noise)}.${fell}`)),
    );
    tell(`Held-out error ${told(fit.heldout_rms)} ${fit.unit}, noise ${told(noise)}.${fell}`);
    put(this.ladderBox, ladder(fit.steps, noise, fit.unit));
    put(this.modelBox, ...modelPanel(news, fit, this.modelActions));
    put(this.dataBox, ...dataPanel(news, fit, this.modelActions));
    put(this.commandBox);
    put(
      this.triedBox,
      h(
        "ol",
        { class: "tried" },
        ...news.models.map((model, at) =>
          h(
            "li",
            {},
            h("button", { type: "button", class: "link", "data-key": `go-${at}`, "aria-current": at === news.at ? "true" : null, click: () => this.step({ at }) }, modelName(model)),
            at === news.at ? null : h("button", { type: "button", "data-key": `blink-${at}`, "aria-label": `Blink with ${modelName(model)}`, click: () => this.blinkWithModel(at) }, "Blink"),
          ),
        ),
      ),
    );
  }

  private blinkWithModel(at: number): void {
    this.stopBlinking();
    this.blinkWith = at;
    void this.blink();
  }
}
