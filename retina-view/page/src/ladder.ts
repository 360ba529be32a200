// The ladder of held-out error: a bar a step, down to the noise.

import { h, s } from "./dom";
import { told } from "./rows";

interface Rung {
  label: string;
  rms: number;
}

const WIDTH = 320;
const ROW = 46;

/** Bars as a figure; the same figures as text for those who do not see it. */
export function ladder(steps: { effects: string[]; heldout_rms: number }[], noise: number, unit: string): HTMLElement {
  const rungs: Rung[] = steps.map((step, at) => ({
    label: at === 0 ? "baseline" : `+ ${step.effects[step.effects.length - 1] ?? ""}`,
    rms: step.heldout_rms,
  }));
  const most = Math.max(noise, ...rungs.map((rung) => rung.rms)) || 1;
  const at = (value: number): number => ((WIDTH - 62) * value) / most;
  const height = ROW * rungs.length + 26;
  const said = rungs.map((rung) => `${rung.label} ${told(rung.rms)} ${unit}`).join(", ");
  const figure = s("svg", {
    viewBox: `0 0 ${WIDTH} ${height}`,
    class: "ladder",
    role: "img",
    "aria-label": `Held-out error: ${said}. Noise: ${told(noise)} ${unit}.`,
  });
  rungs.forEach((rung, row) => {
    const y = row * ROW;
    figure.append(
      s("text", { x: 0, y: y + 15, class: "rung" }, rung.label),
      s("rect", { x: 0, y: y + 21, width: at(rung.rms), height: 16, rx: 3, class: row === rungs.length - 1 ? "bar last" : "bar" }),
      s("text", { x: at(rung.rms) + 6, y: y + 34, class: "value" }, told(rung.rms)),
    );
  });
  const x = at(noise);
  figure.append(
    s("line", { x1: x, x2: x, y1: 18, y2: height - 18, class: "noise" }),
    s("text", { x: Math.min(Math.max(x, 62), WIDTH - 62), y: height - 4, class: "noise-label", "text-anchor": "middle" }, `noise ${told(noise)} ${unit}`),
  );
  return h("figure", {}, figure);
}
