// A refusal, with what was found and how to mend it.

import { type Problem, Refused } from "./api";
import { h } from "./dom";

export function problemOf(error: unknown): Problem {
  return error instanceof Refused ? error.problem : { problem: String(error) };
}

export function problemBox(problem: Problem, close: (() => void) | null): HTMLElement {
  return h(
    "div",
    { class: "problem", role: "alert" },
    h("p", {}, problem.problem),
    problem.help ? h("p", {}, `To mend it: ${problem.help}`) : null,
    close ? h("button", { type: "button", "data-key": "close-problem", click: close }, "Close") : null,
  );
}
