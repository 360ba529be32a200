// What the missing effect may be.

import type { Candidate, Diagnosis, SessionNews } from "./api";
import { h } from "./dom";
import { formulas, type FormulaActions } from "./found";
import { told } from "./rows";

export interface CandidateActions {
  add: (effect: string) => void;
  preview: (effect: string | null) => void;
  measure: () => void;
  look: () => void;
  formulas: FormulaActions;
}

/** Candidates that are shown before the rest is asked for. */
const FIRST = 5;

export function candidates(news: SessionNews, previewed: string | null, actions: CandidateActions): Node[] {
  const found = news.diagnosis;
  if (!found) {
    const busy = news.job !== null;
    return [
      h("p", { class: "dim" }, busy ? "Looking for candidates ..." : "The candidates are not known."),
      busy ? h("div", { class: "waiting" }) : h("button", { type: "button", "data-key": "look", click: actions.look }, "Look for candidates"),
    ];
  }
  const inModel = new Set((news.models[news.at] ?? []).map((effect) => effect.name));
  const list = found.candidates.filter((candidate) => !inModel.has(candidate.effect));
  const card = (candidate: Candidate): HTMLElement => candidateCard(candidate, found, previewed === candidate.effect, actions);
  const rest = list.slice(FIRST);
  return [
    h("p", { class: `verdict ${found.verdict}` }, found.headline),
    nextCard(news, found, actions),
    list.length === 0 ? h("p", {}, "No further effect of the catalogue can be tried on this table.") : null,
    h("ol", { class: "candidates" }, ...list.slice(0, FIRST).map(card)),
    formulas(news, actions.formulas),
    rest.length > 0
      ? h("details", {}, h("summary", { "data-key": "more" }, `${rest.length} less likely ones`), h("ol", { class: "candidates" }, ...rest.map(card)))
      : null,
    found.not_testable.length > 0
      ? h(
          "details",
          {},
          h("summary", { "data-key": "not-testable" }, `${found.not_testable.length} that this table cannot show`),
          h("dl", {}, ...found.not_testable.flatMap((one) => [h("dt", {}, one.effect), h("dd", {}, one.reason)])),
        )
      : null,
  ].filter((node): node is HTMLElement => node !== null);
}

function candidateCard(candidate: Candidate, found: Diagnosis, previewed: boolean, actions: CandidateActions): HTMLElement {
  const name = candidate.effect;
  const noise = found.baseline.noise_floor;
  const falls = found.baseline.heldout_rms - candidate.heldout_rms;
  const mistaken = candidate.rivals && candidate.rivals.length > 0 ? candidate.rivals : (candidate.class ?? []).filter((other) => other !== name);
  const significant = candidate.p_value <= 0.02;
  const physical = found.physical[name];
  const share = found.baseline.heldout_rms > noise ? Math.min(1, Math.max(0, falls / (found.baseline.heldout_rms - noise))) : 0;
  const meter = h("meter", { min: 0, max: 1, value: share, "aria-label": `${name} explains ${Math.round(100 * share)} % of what is left above the noise` });
  const odds = candidate.odds_at_most;
  return h(
    "li",
    { class: significant ? "candidate likely" : "candidate" },
    h(
      "div",
      { class: "head" },
      h("button", { type: "button", class: significant ? "primary" : "", "data-key": `add-${name}`, "aria-label": `Add ${name} to the model`, click: () => actions.add(name) }, `+ ${name}`),
      h("button", { type: "button", "aria-pressed": previewed ? "true" : "false", "aria-label": `Draw ${name} beside the data`, "data-key": `preview-${name}`, click: () => actions.preview(previewed ? null : name) }, "Draw"),
    ),
    meter,
    h(
      "p",
      { class: "figures" },
      `held out ${told(candidate.heldout_rms)} ${found.baseline.unit}, p ${pValue(candidate.p_value)}`,
      odds > 1.05 ? `, odds at most ${told(Number(odds.toPrecision(2)))} : 1` : "",
    ),
    candidate.implausible.length > 0 ? h("p", { class: "bad" }, `Not plausible: ${candidate.implausible.map((one) => one.parameter).join(", ")}`) : null,
    mistaken.length > 0 ? h("p", { class: "dim" }, `Mistaken for: ${mistaken.join(", ")}`) : null,
    physical ? h("p", {}, `${physical.called ?? physical.parameter.replaceAll("_", " ")}: ${told(physical.value)}${physical.sigma === null ? "" : ` \u00b1 ${told(physical.sigma)}`} ${physical.unit}. ${physical.remedy}`) : null,
    previewed
      ? h(
          "div",
          { class: "signature" },
          candidate.formula ? h("code", {}, candidate.formula) : null,
          candidate.source ? h("p", { class: "dim" }, candidate.source) : null,
          h("img", { src: `/api/effects/${name}/0.svg`, alt: `Signature of ${name} on a campaign laid out for it`, loading: "lazy" }),
          h("p", { class: "dim" }, "Above: the form on a campaign laid out for it. In the plots, dashed: its fit to these data."),
        )
      : null,
  );
}

/** With 1999 flips no p-value is smaller than 1 / 2000. */
function pValue(p: number): string {
  return p <= 5.001e-4 ? "\u2264 0.0005" : told(p);
}

function nextCard(news: SessionNews, found: Diagnosis, actions: CandidateActions): HTMLElement | null {
  const next = found.next_measurement;
  if (!next) {
    return null;
  }
  const sigma = next.expected_sigma === null ? "" : ` They would then differ by ${told(next.expected_sigma)} sigma.`;
  const separates = next.separates.length > 0 ? ` It separates ${next.separates.join(", ")}.` : "";
  return h(
    "div",
    { class: "next" },
    h("h3", {}, "Measure next"),
    h("p", {}, `${next.action.replaceAll("_", " ")}: ${next.value}.${separates}${sigma}`),
    news.can_measure
      ? h("button", { type: "button", class: "primary", "data-key": "measure", disabled: news.job !== null && news.job.kind === "bench", click: actions.measure }, "Take it on the virtual bench")
      : h("p", { class: "dim" }, news.inputs.bench ? "The virtual bench cannot change this." : "These data did not come from the virtual bench: measure it on yours."),
  );
}
