"""The workbench on campaigns of the virtual bench, which share no form with its catalogue.

Each effect at two strengths is put into the bench, a campaign of some 1950 points in 40 exposures is photographed, and
`retina diagnose` is asked against a calibration that another campaign without the effect gave. Weak is about 0.3 of the
centroids' noise, strong about 3. Nulls are campaigns of other seeds without an effect.

    python validation/workbench_on_bench.py --retina target/release/retina --out DIR [--seeds 1]

Finished campaigns are kept: a run that was stopped goes on. Needs nothing but Python.
"""

import argparse
import json
import pathlib
import subprocess

# Id: weak and strong value in the bench's own unit (`retina simulate effects`).
EFFECTS = {
    "screen_tilt": ("0.01,0", "0.1,0"),
    "camera_pointing": ("0.01,0", "0.1,0"),
    "decentering": ("0.5,0", "5,0"),
    "optical_centre": ("1,0", "10,0"),
    "thin_prism": ("0.5,0", "5,0"),
    "radial_higher_order": ("1", "10"),
    "screen_bow": ("10,0", "100,0"),
    "flux_coma": ("0.1", "1"),
    "thermal_boresight": ("0.3,0", "3,0"),
    "thermal_focal": ("5", "50"),
    "drift": ("1,0", "10,0"),
    "roll_drift": ("1", "10"),
    "knock": ("0.5,0", "5,0"),
    "row_loading_shift": ("0.02", "0.2"),
}
CLASSES = [
    {"screen_tilt", "camera_pointing", "decentering", "optical_centre", "thin_prism"},
    {"thermal_boresight", "drift"},
    {"background_gradient", "flux_shift"},
    {"colour_wedge", "subpixel_offset"},
]
NULLS = 8


def class_of(effect):
    return next((c for c in CLASSES if effect in c), {effect})


def run(*arguments):
    done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, arguments))}\n{done.stderr}")
    return done.stdout


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--retina", default="target/release/retina")
    parser.add_argument("--setup", default="assets/setups/wide-fov.toml")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--seeds", type=int, default=1)
    a = parser.parse_args()
    calibration = a.out / "calibration.toml"
    if not calibration.exists():
        campaign = a.out / "calibration"
        run(a.retina, "simulate", "points", "--setup", a.setup, "--seed", 4, "--out", campaign,
            "--exposures", 160)
        run(a.retina, "calibrate", "geometry", "--setup", a.setup, "--data", campaign / "points.csv",
            "--out", calibration)
    cases = [("none", "-", "", 300 + k) for k in range(NULLS)]
    for effect, values in EFFECTS.items():
        for strength, value in zip(("weak", "strong"), values):
            cases += [(effect, strength, value, 100 + k) for k in range(a.seeds)]
    right = {}
    for effect, strength, value, seed in cases:
        folder = a.out / f"{effect}-{strength}-{seed}"
        found = folder / "diagnosis.json"
        if not found.exists():
            with_it = ["--effect", f"{effect}={value}"] if value else []
            run(a.retina, "simulate", "points", "--setup", a.setup, "--seed", seed, "--out", folder, *with_it)
            text = run(a.retina, "diagnose", "--setup", a.setup, "--data", folder / "points.csv",
                       "--calibration", calibration, "--json")
            found.write_text(text)
        d = json.loads(found.read_text())
        named = d["indistinguishable"]
        if effect == "none":
            good = d["verdict"] == "adequate"
        else:
            good = effect in named and set(named) <= class_of(effect)
        count = right.setdefault((effect, strength), [0, 0, 0])
        count[0] += good
        count[1] += 1
        count[2] += bool(d["accepted"])
        print(f"{effect:20} {value:8} seed {seed}: {d['verdict']:10} {d['accepted']} set {named} "
              f"left {d['unexplained']['covariates']} "
              f"{d['baseline']['heldout_rms']:.3f} -> {d['steps'][-1]['heldout_rms']:.3f}, "
              f"floor {d['baseline']['noise_floor']:.3f}", flush=True)
    print("\n| effect | strength | in the set and no other class | anything accepted | of |\n|---|---|---|---|---|")
    for (effect, strength), (good, of, accepted) in right.items():
        print(f"| {effect} | {strength} | {good} | {accepted} | {of} |")


if __name__ == "__main__":
    main()
