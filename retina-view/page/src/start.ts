// The start page: sessions, files of the given folders, shipped examples, a place to drop files.

import { get, post, remove, type StartDocument } from "./api";
import { h, put } from "./dom";
import { chooser, takeDrops } from "./drop";
import { problemBox, problemOf } from "./problem";

export function showStart(page: Element, open: (id: string) => void): () => void {
  const box = h("div", {});
  const failed = (error: unknown): void => {
    put(box, problemBox(problemOf(error), () => put(box)));
  };
  const undo = takeDrops(() => null, open, failed);
  const body = h("div", {}, h("p", {}, "Loading ..."));
  page.replaceChildren(
    h(
      "main",
      { id: "main", class: "start" },
      h("h1", {}, "RETINA"),
      h("p", { class: "lead" }, "Compare a model with measurements. See where it fails, learn which effect is missing, add it, and watch the error fall."),
      box,
      body,
    ),
  );
  const load = (): void => {
    get<StartDocument>("/api/start").then((start) => put(body, ...sections(start, open, failed, load)), failed);
  };
  load();
  return undo;
}

function sections(start: StartDocument, open: (id: string) => void, failed: (e: unknown) => void, again: () => void): Node[] {
  const opened = (path: string, body: unknown): void => {
    post<{ id: string }>(path, body).then((session) => open(session.id), failed);
  };
  const out: Node[] = [
    h(
      "section",
      { class: "dropzone" },
      h("h2", {}, "Your data"),
      h("p", {}, "Drop a table (.csv) together with its setup (.toml) anywhere on this page; a calibration may come with them."),
      chooser("Choose files", () => null, open, failed),
    ),
  ];
  if (start.files.some((file) => ["setup", "table", "calibration"].includes(file.kind))) {
    out.push(h("section", {}, h("h2", {}, "Measurements of the given folders"), filesForm(start, opened)));
  }
  out.push(panes(start));
  out.push(
    h(
      "section",
      {},
      h("h2", {}, "Examples for the workbench"),
      h("p", { class: "dim" }, "The virtual bench makes the data here, in some ten seconds."),
      h(
        "ul",
        { class: "cards" },
        ...start.examples.map((example) =>
          h(
            "li",
            {},
            h("h3", {}, example.title),
            h("p", {}, example.text),
            h("button", { type: "button", class: "primary", "data-key": example.id, click: () => opened("/api/sessions/example", { id: example.id }) }, "Open"),
          ),
        ),
      ),
    ),
  );
  if (start.sessions.length > 0) {
    out.push(h("section", {}, h("h2", {}, "Sessions"), sessionList(start, open, failed, again)));
  }
  return out;
}

/** What else can be looked at: links to the panes. */
function panes(start: StartDocument): HTMLElement {
  const of = (kind: string): [string, string][] => start.files.filter((file) => file.kind === kind).map(({ path, name }) => [path, name]);
  const shipped = (names: string[]): [string, string][] => names.map((name) => [name, name]);
  const group = (pane: string, title: string, text: string, entries: [string, string][], missing: string): HTMLElement =>
    h(
      "li",
      {},
      h("h3", {}, title),
      h("p", {}, text),
      entries.length === 0
        ? h("p", { class: "dim" }, missing)
        : h("ul", { class: "links" }, ...entries.map(([at, name]) => h("li", {}, h("a", { href: `#${pane}=${encodeURIComponent(at)}`, "data-key": `${pane}-${at}` }, name)))),
    );
  return h(
    "section",
    {},
    h("h2", {}, "Look at"),
    h(
      "ul",
      { class: "cards" },
      group("sequence", "Sequences", "Rendered frames, the truth over them, two runs beside each other.", of("sequence"), "Give a folder that `retina render` wrote."),
      group("scene", "Live scenes", "Turn camera, Sun and body by hand, and save the pose.", of("scene"), "Give a scene, such as SCENE.toml."),
      group("bench", "Bench", "From the screen to the camera, part by part.", [...of("setup"), ...shipped(start.setups)], ""),
      group("optics", "Optics", "Layout, spots and contrast as gaps and tilts change; designs of a search.", [...of("designs"), ...of("system"), ...shipped(start.systems)], ""),
      group("results", "Results of navigation", "Errors and their bounds over time, and why a frame failed.", of("results"), "Give a folder that `retina navigate` wrote."),
    ),
  );
}

function filesForm(start: StartDocument, opened: (path: string, body: unknown) => void): HTMLElement {
  const of = (kind: string): StartDocument["files"] => start.files.filter((file) => file.kind === kind);
  const select = (label: string, files: StartDocument["files"], none: string | null): [HTMLElement, HTMLSelectElement] => {
    const options = files.map(({ path, name }) => h("option", { value: path }, name));
    const element = h("select", {}, none === null ? null : h("option", { value: "" }, none), ...options);
    return [h("label", {}, label, element), element];
  };
  const [setupField, setup] = select("Setup", of("setup"), null);
  const [tableField, table] = select("Table", of("table"), null);
  const [calibrationField, calibration] = select("Calibration", of("calibration"), "none");
  const ready = of("setup").length > 0 && of("table").length > 0;
  const submit = (event: Event): void => {
    event.preventDefault();
    opened("/api/sessions/open", { setup: setup.value, tables: [table.value], calibration: calibration.value || null });
  };
  return h(
    "form",
    { class: "files", submit },
    setupField,
    tableField,
    calibrationField,
    h("button", { type: "submit", class: "primary", disabled: !ready }, "Open"),
    ready ? null : h("p", { class: "dim" }, "A setup and a table are needed; the given folders do not hold both."),
  );
}

function sessionList(start: StartDocument, open: (id: string) => void, failed: (e: unknown) => void, again: () => void): HTMLElement {
  const gone = (id: string, name: string): void => {
    if (window.confirm(`Remove the session "${name}", with the files that were dropped for it?`)) {
      remove(`/api/sessions/${id}`).then(again, failed);
    }
  };
  return h(
    "ul",
    { class: "sessions" },
    ...start.sessions.map((session) =>
      h(
        "li",
        {},
        h("button", { type: "button", class: "link", "data-key": `open-${session.id}`, click: () => open(session.id) }, session.name),
        h("span", { class: "dim" }, session.effects.length === 0 ? "baseline" : session.effects.join(" + ")),
        h("button", { type: "button", "aria-label": `Remove ${session.name}`, "data-key": `remove-${session.id}`, click: () => gone(session.id, session.name) }, "Remove"),
      ),
    ),
  );
}
