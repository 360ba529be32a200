// What the server says, and how it is asked.

export interface Problem {
  problem: string;
  what?: string;
  found?: string | null;
  expected?: string | null;
  help?: string | null;
  snippet?: { offset: number; length: number } | null;
}

/** A refusal of the server, or its silence. */
export class Refused extends Error {
  constructor(
    readonly status: number,
    readonly problem: Problem,
  ) {
    super(problem.problem);
  }
}

export interface Quantity {
  value: number;
  sigma: number | null;
}

export interface Physical {
  called: string | null;
  parameter: string;
  value: number;
  unit: string;
  sigma: number | null;
  remedy: string;
}

export interface Candidate {
  effect: string;
  p_value: number;
  odds_at_most: number;
  heldout_rms: number;
  parameters: Record<string, Quantity>;
  rivals: string[] | null;
  class?: string[];
  formula?: string;
  source?: string;
  implausible: { parameter: string; plausible: (number | null)[] }[];
}

export interface Diagnosis {
  headline: string;
  verdict: string;
  baseline: { heldout_rms: number; unit: string; noise_floor: number };
  accepted: string[];
  rivals: Record<string, string[]>;
  physical: Record<string, Physical>;
  candidates: Candidate[];
  next_measurement: { action: string; value: string; separates: string[]; expected_sigma: number | null } | null;
  unexplained: { p_value: number; covariates: string[]; width_px: number | null };
  not_testable: { effect: string; reason: string }[];
  warnings: string[];
  notes: string[];
}

export interface Term {
  name: string;
  effect_toml: string;
  covariates: string[];
  proof: { p_value: number; ratio: number; ratio_sigma: number | null; strength: number };
  weak_beside: string | null;
  rivals: { effect_toml: string; covariates: string[]; difference_rms: number }[];
  says: string[];
  independent_of: string[];
  origins: { mechanism: string; check: string; instrument: string }[];
}

export interface Investigation {
  headline: string;
  verdict: "found" | "nothing";
  unit: string;
  known: string[];
  terms: Term[];
  tried: number;
}

export interface ModelEffect {
  text: string;
  name: string;
  own: boolean;
}

export interface SessionNews {
  id: string;
  name: string;
  revision: number;
  phase: "loading" | "ready" | "failed";
  problem: Problem | null;
  job: { kind: "bench" | "read" | "diagnose" | "investigate"; done: number; total: number } | null;
  inputs: { setup: string; tables: string[]; calibration: string | null; baseline: string; bench: boolean };
  models: ModelEffect[][];
  at: number;
  diagnosis: Diagnosis | null;
  investigation: Investigation | null;
  can_measure: boolean;
}

export interface FitDocument {
  unit: string;
  table: string;
  rows: number;
  outliers: number;
  parameters: Record<string, Quantity>;
  rms: number;
  heldout_rms: number;
  noise: { white: number; group: number; structured: number; source: string };
  noise_floor: number;
  steps: { effects: string[]; heldout_rms: number }[];
  warnings: string[];
  notes: string[];
}

export interface CatalogueEffect {
  effect: string;
  table: string;
  formula: string;
  covariates: string[];
}

export interface StartDocument {
  version: string;
  first: string | null;
  sessions: { id: string; name: string; effects: string[] }[];
  files: { path: string; name: string; kind: "setup" | "calibration" | "table" | "scene" | "system" | "designs" | "sequence" | "results" }[];
  setups: string[];
  systems: string[];
  examples: { id: string; title: string; text: string }[];
}

/** The server's answer, if it is no refusal. */
export async function answer(path: string, init?: RequestInit): Promise<Response> {
  let response: Response;
  try {
    response = await fetch(path, init);
  } catch (error) {
    if (error instanceof DOMException && error.name === "AbortError") {
      throw error;
    }
    throw new Refused(0, { problem: "The program does not answer. Is `retina view` still running?" });
  }
  if (response.ok) {
    return response;
  }
  const text = await response.text();
  let problem: Problem;
  try {
    problem = JSON.parse(text) as Problem;
  } catch {
    problem = { problem: text.trim() || `The program answered with status ${response.status}.` };
  }
  throw new Refused(response.status, problem);
}

export async function get<T>(path: string, signal?: AbortSignal): Promise<T> {
  return (await (await answer(path, signal ? { signal } : {})).json()) as T;
}

export async function getBytes(path: string): Promise<ArrayBuffer> {
  return (await answer(path)).arrayBuffer();
}

export async function getText(path: string): Promise<string> {
  return (await answer(path)).text();
}

export async function post<T>(path: string, body: unknown = {}): Promise<T> {
  const init = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  const text = await (await answer(path, init)).text();
  return (text === "" ? {} : JSON.parse(text)) as T;
}

export async function remove(path: string): Promise<void> {
  await answer(path, { method: "DELETE" });
}
