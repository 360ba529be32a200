// The model that is looked at: its effects with their errors, and the models that were tried.

import type { FitDocument, ModelEffect, Quantity, SessionNews } from "./api";
import { h } from "./dom";
import { told } from "./rows";

export interface ModelActions {
  remove: (effect: string) => void;
  edit: (effect: string) => void;
  go: (at: number) => void;
  leaveOut: (table: number) => void;
}

export function modelName(model: ModelEffect[]): string {
  return model.length === 0 ? "baseline" : model.map((effect) => effect.name).join(" + ");
}

/** Parameters that are shown before the rest is asked for. */
const FIRST = 4;

function parameterTable(entries: [string, Quantity][], caption: string): HTMLElement {
  const rows = entries.map(([name, { value, sigma }]) =>
    h("tr", {}, h("th", { scope: "row" }, name), h("td", {}, told(value)), h("td", {}, sigma === null ? "chosen" : `\u00b1 ${told(sigma)}`)),
  );
  return h("div", { class: "scroll" }, h("table", {}, h("caption", {}, caption), h("tbody", {}, ...rows)));
}

/** The first parameters, and the rest behind a line to press. */
function effectTables(name: string, entries: [string, Quantity][]): Node[] {
  const caption = `Parameters of ${name}, one standard deviation`;
  const rest = entries.slice(FIRST);
  const first = parameterTable(entries.slice(0, FIRST), caption);
  return rest.length === 0
    ? [first]
    : [first, h("details", {}, h("summary", { "data-key": `parameters-${name}` }, `${rest.length} more parameters`), parameterTable(rest, `Further parameters of ${name}`))];
}

export function modelPanel(news: SessionNews, fit: FitDocument, actions: ModelActions): Node[] {
  const model = news.models[news.at] ?? [];
  const all = Object.entries(fit.parameters);
  const own = (name: string): [string, Quantity][] =>
    all.filter(([key]) => key.startsWith(`${name}.`)).map(([key, value]) => [key.slice(name.length + 1), value]);
  const names = new Set(model.map((effect) => effect.name));
  const baseline = all.filter(([key]) => !names.has(key.split(".")[0] ?? ""));
  const effects = model.map((effect) =>
    h(
      "li",
      {},
      h(
        "div",
        { class: "head" },
        h("strong", {}, effect.name),
        effect.own ? h("button", { type: "button", "data-key": `edit-${effect.name}`, "aria-label": `Change the formula of ${effect.name}`, click: () => actions.edit(effect.name) }, "Change") : null,
        h("button", { type: "button", "data-key": `remove-${effect.name}`, "aria-label": `Take out ${effect.name}`, click: () => actions.remove(effect.name) }, "Take out"),
      ),
      ...effectTables(effect.name, own(effect.name)),
    ),
  );
  return [
    model.length === 0 ? h("p", { class: "dim" }, "The baseline alone. Press a candidate to add it.") : h("ul", { class: "effects" }, ...effects),
    h("details", {}, h("summary", { "data-key": "baseline" }, `${baseline.length} parameters of the baseline`), parameterTable(baseline, "Parameters of the baseline")),
  ];
}

export function dataPanel(news: SessionNews, fit: FitDocument, actions: ModelActions): Node[] {
  const { inputs } = news;
  const notes = [...fit.warnings, ...fit.notes];
  const tables = inputs.tables.map((table, at) =>
    h("li", {}, table, at > 0 ? h("button", { type: "button", "data-key": `out-${at}`, "aria-label": `Leave out ${table}`, click: () => actions.leaveOut(at) }, "Leave out") : null),
  );
  return [
    h("p", {}, `${fit.rows} rows of ${fit.table}, ${fit.outliers} outliers. Setup ${inputs.setup}; ${inputs.calibration ? `calibration ${inputs.calibration} held` : `baseline ${inputs.baseline}`}.`),
    h("ul", { class: "tables" }, ...tables),
    notes.length > 0 ? h("details", {}, h("summary", { "data-key": "notes" }, `${notes.length} notes`), h("ul", {}, ...notes.map((note) => h("li", {}, note)))) : h("span", {}),
  ];
}
