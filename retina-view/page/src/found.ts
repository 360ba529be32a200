// Formulas of what no known effect explains.

import type { Investigation, SessionNews, Term } from "./api";
import { h } from "./dom";
import { told } from "./rows";

export interface FormulaActions {
  look: () => void;
  add: (text: string) => void;
}

/** The button that looks for formulas, or what was found. */
export function formulas(news: SessionNews, actions: FormulaActions): HTMLElement {
  const found = news.investigation;
  if (!found) {
    const busy = news.job?.kind === "investigate";
    return h(
      "div",
      { class: "next" },
      h("h3", {}, "No known effect fits?"),
      h("p", {}, "Half of the exposures look for a formula of what is left, the other half judges it. That takes some seconds."),
      h("button", { type: "button", "data-key": "investigate", disabled: busy, click: actions.look }, busy ? "Looking ..." : "Look for a formula"),
    );
  }
  return h(
    "div",
    { class: "next" },
    h("h3", {}, "Formulas"),
    h("p", { class: "verdict" }, found.headline),
    found.known.length > 0 ? h("p", {}, `Known effects that belong to the model: ${found.known.join(", ")}. Add them first.`) : null,
    h("ol", { class: "candidates" }, ...found.terms.map((term) => termCard(term, found, actions))),
    h("p", { class: "dim" }, `${found.tried} formulas were tried.`),
  );
}

/** The lines of an effect's file that are formulas. */
function lines(text: string): string {
  return text
    .split("\n")
    .filter((line) => /^(dx|dy|value) =/.test(line))
    .map((line) => line.replace(/"/g, ""))
    .join("\n");
}

function termCard(term: Term, found: Investigation, actions: FormulaActions): HTMLElement {
  const proof = term.proof;
  const ratio = `${told(proof.ratio)}${proof.ratio_sigma === null ? "" : ` \u00b1 ${told(proof.ratio_sigma)}`}`;
  return h(
    "li",
    { class: "candidate" },
    h(
      "div",
      { class: "head" },
      h("button", { type: "button", class: "primary", "data-key": `add-${term.name}`, "aria-label": `Add ${term.name} to the model`, click: () => actions.add(term.effect_toml) }, `+ ${term.name}`),
    ),
    h("pre", { tabindex: 0 }, lines(term.effect_toml)),
    h("p", { class: "figures" }, `depends on ${term.covariates.join(", ")}; on unseen exposures p ${told(proof.p_value)}, amplitude ${ratio} of the one found`),
    h("p", {}, term.says.join(" ")),
    term.weak_beside ? h("p", { class: "dim" }, `Weak beside ${term.weak_beside}: it may be only what that formula lacks.`) : null,
    term.rivals.length > 0
      ? h(
          "details",
          {},
          h("summary", { "data-key": `rivals-${term.name}` }, `${term.rivals.length} formulas that these data cannot tell from it`),
          ...term.rivals.map((rival) => h("div", {}, h("p", { class: "figures" }, `differs by ${told(rival.difference_rms)} ${found.unit} rms`), h("pre", { tabindex: 0 }, lines(rival.effect_toml)))),
        )
      : null,
    term.origins.length > 0
      ? h(
          "details",
          {},
          h("summary", { "data-key": `origins-${term.name}` }, "Where such errors come from"),
          h("dl", {}, ...term.origins.flatMap((one) => [h("dt", {}, one.mechanism), h("dd", {}, `${one.check}. Shown by: ${one.instrument}.`)])),
        )
      : null,
  );
}
