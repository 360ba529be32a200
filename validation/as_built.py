"""The workbench on facilities that it does not know: lenses as they were built, and one or two things wrong.

A build is a prescription drawn within tolerances: radii, indices, gaps, tilts and decentres of every lens, another
focus. The virtual bench photographs through it, `retina` knows the nominal setup alone. Each build is calibrated with a
campaign of its own and then changed: each effect at two strengths, pairs of effects, and nothing (nulls).

    python validation/as_built.py --retina target/release/retina --out DIR [--builds 2] [--pairs 12] [--seed 1]

An oracle is asked beside the workbench: the effect that is there, fitted alone (`retina fit`). Where its amplitude is
below four standard deviations nobody could be sure, and the case counts apart. Finished cases are kept: a run that was
stopped goes on. Needs nothing but Python.
"""

import argparse
import csv
import json
import math
import pathlib
import random
import subprocess
import tomllib

from workbench_on_bench import CLASSES, EFFECTS, run

ASSETS = pathlib.Path(__file__).resolve().parent.parent / "assets"
DESIGNS = ["reference-1.3fc-wide", "reference-1.0fc-wide"]

# What is drawn, uniformly to both sides: a good mechanical shop and stock lenses.
RADIUS, INDEX, GAP_MM, TILT_DEG, DECENTRE_MM, FOCUS_MM = 1e-3, 5e-4, 0.1, 0.05, 0.05, 0.02

NULLS = 4
# An amplitude of so many standard deviations is there for sure.
SURE = 4.0

# Effect: how the value given to the bench is that of `physical`, by its parameter's name.
TRUTH = {
    "tilt": lambda values: math.hypot(*values),
    "boresight_off_axis": lambda values: math.hypot(*values),
    "sag_at_half_width": lambda values: math.hypot(*values),
    "coma_at_half_width": lambda values: abs(values[0]),
    "centre_off_axis": lambda values: math.hypot(*values),
    "boresight_per_kelvin": lambda values: math.hypot(*values),
    "focal_length_per_kelvin": lambda values: abs(values[0]),
    "boresight_drift": lambda values: math.hypot(*values),
    "step_at_half_width": lambda values: math.hypot(*values),
    "decentring_at_half_width": lambda values: math.hypot(*values),
    "prism_at_half_width": lambda values: math.hypot(*values),
    "r5_at_half_width": lambda values: abs(values[0]),
}


def class_of(effect):
    return next((c for c in CLASSES if effect in c), {effect})


def glasses(draw):
    """AGF lines of each glass with an index that is off, and the names they have."""
    lines, names = [], {}
    with open(ASSETS / "optics" / "glasses.csv", encoding="utf-8") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        for row in rows:
            if row["formula"] != "sellmeier":
                continue
            # n^2 - 1 = sum B l^2 / (l^2 - C): a step of n at 0.55 um, put on B1.
            b = [float(value) for value in row["coefficients"].split()]
            term = 0.55**2 / (0.55**2 - b[1])
            n = math.sqrt(1.0 + sum(b[k] * 0.55**2 / (0.55**2 - b[k + 1]) for k in (0, 2, 4)))
            b[0] += ((n + draw(INDEX)) ** 2 - n**2) / term
            name = "BUILT-" + row["glass"]
            names[row["glass"]] = name
            lines += [f"NM {name} 2 0 {row['nd'] or 1.5} {row['vd'] or 50} 0", "CD " + " ".join(map(repr, b)),
                      f"LD {row['min_um']} {row['max_um']}"]
    return lines, names


def build(design, folder, seed):
    """Writes a prescription as it was built and returns its path."""
    draw_from = random.Random(seed)

    def draw(half):
        return draw_from.uniform(-half, half)

    nominal = tomllib.loads((ASSETS / "optics" / f"{design}.toml").read_text())
    with open(ASSETS / "optics" / "doublets.csv", encoding="utf-8") as file:
        parts = {row["part"]: row for row in csv.DictReader(line for line in file if not line.startswith("#"))}
    agf, names = glasses(draw)
    (folder / "built.agf").write_text("\n".join(agf) + "\n")
    head = ['schema = "retina.optics/1"', f'name = "{folder.name}"', 'glass_files = ["built.agf"]', "", "[beam]",
            f"entrance_pupil_mm = {nominal['beam']['entrance_pupil_mm']!r}", ""]
    for wavelength in nominal["wavelength"]:
        head += ["[[wavelength]]", f"nm = {wavelength['nm']}"] + ["primary = true"] * wavelength.get("primary", 0) + [""]
    for field in nominal["field"]:
        head += ["[[field]]", f"y_tan = {field['y_tan']!r}", ""]
    body, groups = [], []
    *surfaces, last = nominal["surface"]
    for number, surface in enumerate(surfaces):
        gap = surface.get("thickness_mm", 0.0) + (draw(GAP_MM) if number else 0.0)
        if "part" not in surface:
            body += ["[[surface]]", f'label = "{surface["label"]}"'] + ["stop = true"] * surface.get("stop", 0)
            body += [f"thickness_mm = {gap!r}", ""]
            continue
        part = parts[surface["part"]]
        radii = [float(part[f"radius_{k}_mm"]) * (1.0 + draw(RADIUS)) for k in (1, 2, 3)]
        thick = [float(part[f"thickness_{k}_mm"]) for k in (1, 2)]
        glass = [names[part[f"glass_{k}"]] for k in (1, 2)]
        if surface.get("reversed"):
            radii, thick, glass = [-r for r in reversed(radii)], thick[::-1], glass[::-1]
        name = f"lens{number}"
        for k in range(3):
            body += ["[[surface]]", f"radius_mm = {radii[k]!r}", f'group = "{name}"',
                     f"semi_diameter_mm = {float(part['diameter_mm']) / 2}"]
            body += [f'glass = "{glass[k]}"', f"thickness_mm = {thick[k]!r}"] if k < 2 else [f"thickness_mm = {gap!r}"]
            body += [""]
        groups += ["[[group]]", f'name = "{name}"', f"pivot_mm = {sum(thick) / 2!r}",
                   f"tilt_deg = [{draw(TILT_DEG)!r}, {draw(TILT_DEG)!r}, 0.0]",
                   f"decentre_mm = [{draw(DECENTRE_MM)!r}, {draw(DECENTRE_MM)!r}, 0.0]", ""]
    return head, body, groups, last, draw(FOCUS_MM)


def written(parts, path, focus_mm):
    head, body, groups, last, _ = parts
    body = list(body)
    # The last gap is what a builder turns to focus.
    at = max(k for k, line in enumerate(body) if line.startswith("thickness_mm"))
    gap = float(body[at].split("=")[1]) + focus_mm
    body[at] = f"thickness_mm = {gap!r}"
    path.write_text("\n".join([*head, *body, "[[surface]]", f'label = "{last["label"]}"', "", *groups]) + "\n")


def setups(a, folder, design, seed):
    """The setup that the workbench knows, with the nominal prescription, and that of the facility as it was built, focused
    as a builder would and then a little off."""
    nominal, setup = folder / "nominal.toml", folder / "setup.toml"
    if setup.exists():
        return nominal, setup
    folder.mkdir(parents=True, exist_ok=True)
    shipped = ASSETS / "optics" / f"{design}.toml"
    efl_mm = abs(json.loads(run(a.retina, "optics", "first-order", shipped, "--json"))["first_order"]["efl_mm"])
    text = (ASSETS / "setups" / "wide-fov.toml").read_text().split("[calibration]")[0]
    given = tomllib.loads(text)
    # Eq. 13: rows that the camera's height covers at this magnification.
    camera, screen = given["camera"], given["screen"]
    height = camera["height_px"] * camera["pixel_um"] * 1e-3 / camera["focal_mm"]
    rows = efl_mm * height / (screen["height_mm"] / screen["height_px"])
    text = text.replace(f"observed_rows_px = {given['facility']['observed_rows_px']}", f"observed_rows_px = {rows:.2f}")
    nominal.write_text(text + f'\n[optics]\nsystem = "{shipped}"\n')
    parts = build(design, folder, seed)
    optics = folder / "built.toml"

    def blur(focus_mm):
        written(parts, optics, focus_mm)
        fields = json.loads(run(a.retina, "optics", "spots", optics, "--json"))["systems"][0]["fields"]
        return sum(field["rms_um"] ** 2 for field in fields)

    low, mid, high = (blur(place) for place in (-1.0, 0.0, 1.0))
    written(parts, optics, 0.5 * (low - high) / (low - 2.0 * mid + high) + parts[-1])
    setup.write_text(text + '\n[optics]\nsystem = "built.toml"\n')
    return nominal, setup


def cases(a):
    """(folder, effects with values, seed) of one build."""
    for k in range(NULLS):
        yield f"none-{k}", [], 300 + k
    for effect, values in EFFECTS.items():
        for strength, value in zip(("weak", "strong"), values):
            yield f"{effect}-{strength}", [(effect, value)], 100
    draw = random.Random(a.seed)
    names = [name for name in EFFECTS if name != "row_loading_shift"]
    for k in range(a.pairs):
        one, two = draw.sample(names, 2)
        while class_of(one) == class_of(two):
            one, two = draw.sample(names, 2)
        yield f"pair{k}-{one}-{two}", [(one, EFFECTS[one][1]), (two, EFFECTS[two][1])], 500 + k


def oracle(a, nominal, folder, effects, calibration):
    """For each effect: the largest amplitude of its leading form in standard deviations, the others fitted with it."""
    arguments = [x for effect, _ in effects for x in ("--effect", effect)]
    fit = json.loads(run(a.retina, "fit", "--setup", nominal, "--data", folder / "points.csv", "--calibration",
                         calibration, *arguments, "--json"))
    out = {}
    for effect, _ in effects:
        own = [p for name, p in fit["parameters"].items() if name.startswith(effect + ".") and p.get("sigma")]
        out[effect] = max((abs(p["value"] / p["sigma"]) for p in own), default=0.0)
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--retina", default="target/release/retina")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--builds", type=int, default=2)
    parser.add_argument("--pairs", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    a = parser.parse_args()
    score = {}
    values_off = []
    for number in range(a.builds):
        root = a.out / f"build{number}"
        nominal, setup = setups(a, root, DESIGNS[number % len(DESIGNS)], a.seed * 1000 + number)
        calibration = root / "calibration.toml"
        if not calibration.exists():
            run(a.retina, "simulate", "points", "--setup", setup, "--seed", 4, "--out", root / "calibration",
                "--exposures", 160)
            run(a.retina, "calibrate", "geometry", "--setup", nominal, "--data", root / "calibration" / "points.csv",
                "--out", calibration)
        # What the facility has by itself shows in the calibration's own exposures, and may be found in any other.
        own = root / "own.json"
        if not own.exists():
            own.write_text(run(a.retina, "diagnose", "--setup", nominal, "--data",
                               root / "calibration" / "points.csv", "--calibration", calibration, "--json"))
        own = set(json.loads(own.read_text())["indistinguishable"])
        print(f"build {number} has by itself: {sorted(own)}", flush=True)
        for name, effects, seed in cases(a):
            folder = root / name
            found = folder / "diagnosis.json"
            if not (folder / "points.csv").exists():
                given = [x for effect, value in effects for x in ("--effect", f"{effect}={value}")]
                run(a.retina, "simulate", "points", "--setup", setup, "--seed", seed, "--out", folder, *given)
            if not found.exists():
                found.write_text(run(a.retina, "diagnose", "--setup", nominal, "--data", folder / "points.csv",
                                     "--calibration", calibration, "--json"))
            d = json.loads(found.read_text())
            sure = oracle(a, nominal, folder, effects, calibration) if effects else {}
            named = set(d["indistinguishable"])
            wanted = [class_of(effect) for effect, _ in effects]
            could = all(t >= SURE for t in sure.values())
            left = [name for name in d["unexplained"]["covariates"]
                    if not (name.startswith("camera_phase") and "camera_pixel_phase" in own)]
            within = named <= own.union(*wanted)
            good = all(named & c for c in wanted) and within and not left
            if not effects:
                good = within and not left
            kind = "null" if not effects else "pair" if len(effects) > 1 else name.rsplit("-", 1)[1]
            key = (kind, could)
            count = score.setdefault(key, [0, 0, 0])
            count[0] += good
            count[1] += 1
            count[2] += not within
            text = []
            for accepted, physical in d["physical"].items():
                value = next((v for e, v in effects if e == accepted), None)
                truth = TRUTH.get(physical["parameter"])
                if value and truth:
                    true = truth([float(v) for v in value.split(",")])
                    off = (physical["value"] - true) / physical["sigma"]
                    values_off.append((physical["parameter"], abs(off), abs(physical["value"] / true - 1.0)))
                    text.append(f"{physical['parameter']} {physical['value']:.4g} +- {physical['sigma']:.2g} of {true}")
            print(f"build {number} {name:38} {'ok ' if good else 'NOT'} {d['verdict']:11} {d['accepted']} set "
                  f"{sorted(named)} left {left} oracle {', '.join(f'{t:.1f}' for t in sure.values())} | "
                  f"{d['baseline']['heldout_rms']:.3f} -> {d['steps'][-1]['heldout_rms']:.3f} | {'; '.join(text)}",
                  flush=True)
    print("\n| campaigns | an oracle is sure | in the set, no other class, nothing left | of | another class |\n|---|---|---|---|---|")
    for (kind, could), (good, of, other) in sorted(score.items()):
        print(f"| {kind} | {'yes' if could else 'no'} | {good} | {of} | {other} |")
    if values_off:
        near = sum(sigmas <= 3.0 or part <= 0.05 for _, sigmas, part in values_off)
        print(f"\nParameters within 3 sigma or 5 % of the truth: {near} of {len(values_off)}")


if __name__ == "__main__":
    main()
