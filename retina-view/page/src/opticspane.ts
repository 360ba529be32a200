// Lens systems: layout, spots and contrast as gaps and tilts are changed; the designs of a search.

import { get, post } from "./api";
import { h, put } from "./dom";
import { told } from "./rows";
import { facts, field, Latest, remember, remembered, select, Shell, slider } from "./shell";

interface System {
  name: string;
  airy_radius_um: number | null;
  fields: { field: [number, number]; rms_um: number; vignetted_fraction: number }[];
  gaps: { surface: number; between: string; designed_mm: number; gap_mm: number }[];
  groups: string[];
  length_mm: number | null;
  layout: string;
  spots: string;
  contrast: string | null;
  /** Why there is no contrast. */
  no_contrast: string | null;
}

interface Design {
  worst_rms_um: number;
  length_mm: number;
  lenses: { part: string; reversed: boolean }[];
  prescriptions?: Record<string, string>;
}

interface Offset {
  tilt_deg: [number, number];
  shift_mm: [number, number];
}

interface Kept {
  design: number | null;
  configuration: string;
  gaps_mm: Record<string, number>;
  groups: Record<string, Offset>;
}

/** How far the sliders go: of tilts, of shifts, of gaps. */
const [TILT_DEG, SHIFT_MM, GAP_MM] = [2, 3, 8];

export class OpticsPane {
  private readonly shell: Shell;
  private kept: Kept;
  private designs: Design[] = [];
  private designed: System | null = null;
  private readonly table = h("div", {});
  private readonly sliders = h("div", { class: "sliders" });
  private readonly figures = h("div", { class: "drawings" });
  private readonly side = h("div", {});
  private readonly traces: Latest<null>;

  constructor(
    page: Element,
    private readonly at: string,
  ) {
    this.kept = remembered<Kept>(`optics ${at}`, { design: null, configuration: "", gaps_mm: {}, groups: {} });
    this.shell = new Shell(page, "Optics", at.replace(/^\d+\/?/, "") || "the given system", "pane");
    this.traces = new Latest(() => this.trace(), this.shell.failed);
    this.shell.main.append(
      h("section", { class: "look", "aria-label": "Drawings" }, this.table, this.figures),
      h("section", { class: "beside", "aria-label": "Figures and screws" }, h("h2", {}, "Spots"), this.side, this.sliders),
    );
    void this.start().catch(this.shell.failed);
  }

  close(): void {
    this.shell.close();
  }

  private async start(): Promise<void> {
    if (/\.json$/.test(this.at) || this.kept.design !== null) {
      const document = await get<{ designs: Design[] }>(`/api/optics/designs?at=${encodeURIComponent(this.at)}`, this.shell.closed.signal);
      this.designs = document.designs;
      if (this.designs.length === 0) {
        put(this.table, h("p", { class: "dim" }, "The search found no design."));
        return;
      }
      this.kept.design ??= 0;
      this.drawDesigns();
    }
    this.traces.ask(null);
  }

  private choose(design: number, configuration: string): void {
    this.kept = { design, configuration, gaps_mm: {}, groups: {} };
    this.designed = null;
    this.drawDesigns();
    this.traces.ask(null);
  }

  private drawDesigns(): void {
    const { design, configuration } = this.kept;
    const names = Object.keys(this.designs[design ?? 0]?.prescriptions ?? {});
    if (!names.includes(configuration)) {
      this.kept.configuration = names[0] ?? "";
    }
    put(
      this.table,
      h("h2", {}, "Designs of the search"),
      h("p", { class: "dim" }, "Here: the worst spot of all configurations on the camera's sensor, and the length from the first lens to the screen. Beside the drawing: spots on the screen, and the length from the camera's pupil."),
      names.length > 0 ? field("Configuration", select("configuration", names.map((name): [string, string] => [name, name]), this.kept.configuration, (name) => this.choose(design ?? 0, name))) : null,
      h(
        "div",
        { class: "scroll designs", tabindex: 0 },
        h(
          "table",
          {},
          h("thead", {}, h("tr", {}, ...["Design", "Worst spot, um", "Length, mm", "Lenses from the camera"].map((text) => h("th", { scope: "col" }, text)))),
          h(
            "tbody",
            {},
            ...this.designs.map((own, k) =>
              h(
                "tr",
                {},
                h("td", {}, h("button", { type: "button", class: "link", "data-key": `design-${k}`, "aria-current": k === design ? "true" : null, click: () => this.choose(k, this.kept.configuration) }, `Design ${k + 1}`)),
                h("td", {}, own.worst_rms_um.toFixed(2)),
                h("td", {}, own.length_mm.toFixed(1)),
                h("td", {}, own.lenses.map((lens) => `${lens.part}${lens.reversed ? " (r)" : ""}`).join(", ")),
              ),
            ),
          ),
        ),
      ),
    );
  }

  private async trace(): Promise<void> {
    // What a refusal leaves here would be of another system.
    this.figures.classList.add("stale");
    const { design, configuration, gaps_mm, groups } = this.kept;
    const system = await post<System>("/api/optics", { at: this.at, design, configuration: design === null ? null : configuration, gaps_mm, groups });
    if (this.shell.closed.signal.aborted) {
      return;
    }
    this.shell.mended();
    this.figures.classList.remove("stale");
    remember(`optics ${this.at}`, this.kept);
    if (!this.designed) {
      this.designed = system;
      this.drawSliders(system);
    }
    const picture = (svg: string, alt: string): HTMLElement => h("img", { src: `data:image/svg+xml,${encodeURIComponent(svg)}`, alt });
    put(this.figures, picture(system.layout, `Layout of ${system.name}, with rays`), picture(system.spots, "Spot diagrams by field"), system.contrast === null ? h("p", { class: "dim" }, `No contrast: ${system.no_contrast ?? ""}`) : picture(system.contrast, "Contrast over spatial frequency by field"));
    const rows = system.fields.map(({ field, rms_um, vignetted_fraction }): [string, string] => {
      const degrees = (Math.atan(Math.hypot(...field)) * 180) / Math.PI;
      return [`${degrees.toFixed(2)} deg`, `${rms_um.toFixed(2)} um rms${vignetted_fraction > 5e-4 ? `, ${(100 * vignetted_fraction).toFixed(1)} % vignetted` : ""}`];
    });
    put(this.side, facts([...rows, ["Airy radius", system.airy_radius_um === null ? "none" : `${system.airy_radius_um.toFixed(2)} um`], ["Length", `${told(system.length_mm ?? 0)} mm`]]));
    this.figures.dataset["traced"] = String(Number(this.figures.dataset["traced"] ?? 0) + 1);
  }

  private drawSliders(system: System): void {
    const again = (): void => this.traces.ask(null);
    const gap = ({ surface, between, designed_mm, gap_mm }: System["gaps"][number]): HTMLElement =>
      slider(`gap-${surface}`, `${between}, mm`, { low: Math.max(0, designed_mm - GAP_MM), high: designed_mm + GAP_MM, digits: 3 }, gap_mm, (value) => {
        this.kept.gaps_mm[surface] = value;
        again();
      }, again).element;
    const offset = (name: string): HTMLElement[] => {
      const own = (): Offset => (this.kept.groups[name] ??= { tilt_deg: [0, 0], shift_mm: [0, 0] });
      return (["tilt_deg", "shift_mm"] as const).flatMap((key) =>
        ([0, 1] as const).map((axis) => {
          const [limit, unit, what] = key === "tilt_deg" ? [TILT_DEG, "deg", "tilt about"] : [SHIFT_MM, "mm", "shift along"];
          return slider(`${name}-${key}-${axis}`, `${name}: ${what} ${axis === 0 ? "x" : "y"}, ${unit}`, { low: -limit, high: limit, digits: 3 }, this.kept.groups[name]?.[key][axis] ?? 0, (value) => {
            own()[key][axis] = value;
            again();
          }, again).element;
        }),
      );
    };
    put(
      this.sliders,
      h("div", { class: "head" }, h("h2", {}, "Gaps"), h("button", { type: "button", "data-key": "as-designed", click: () => {
        [this.kept.gaps_mm, this.kept.groups, this.designed] = [{}, {}, null];
        again();
      } }, "As designed")),
      ...system.gaps.map(gap),
      system.groups.length > 0 ? h("h2", {}, "Groups") : null,
      ...system.groups.flatMap(offset),
    );
  }
}
