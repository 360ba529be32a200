"""How well `retina lab align` aligns benches whose lenses it knows, and one whose lenses are as built.

    cargo build --release --features retina-cli/aravis
    python3 validation/lab_align.py [--camera-address 127.0.0.1] [--out out/lab-align]

The bench is the virtual GigE Vision camera (`retina lab camera`), tilted, shifted and defocused by what stands below; it
turns its own screws. The screen is a folder. Printed is what the screws were turned by, less what was needed. Needs Aravis.
"""

import argparse
import json
import random
import re
import signal
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RETINA = ROOT / "target/release/retina"
DESIGN = ROOT / "assets/optics/reference-1.3fc-wide.toml"
SETUP = ROOT / "assets/setups/wide-fov.toml"
PITCH_MM = [18.7 / 1920, 11.75 / 1200]
TILT_DEG, SHIFT_PX, FOCUS_MM = [0.3, -0.15], [20.5, -12.0], 0.1
NEEDED = {
    "ScreenTiltX": -TILT_DEG[0],
    "ScreenTiltY": -TILT_DEG[1],
    "ScreenShiftX": -SHIFT_PX[0] * PITCH_MM[0],
    "ScreenShiftY": -SHIFT_PX[1] * PITCH_MM[1],
    "ScreenFocus": -FOCUS_MM,
}


def as_built(text: str) -> str:
    """The design with gaps wrong by up to 0.1 mm (not the last) and its groups decentred and tilted."""
    draw = random.Random(3)
    parts = re.split(r"(thickness_mm = [0-9.]+)", text)
    gaps = [i for i, part in enumerate(parts) if part.startswith("thickness_mm")]
    for i in gaps[:-1]:
        parts[i] = f"thickness_mm = {float(parts[i].split('=')[1]) + draw.uniform(-0.1, 0.1):.6f}"
    groups = ""
    for name, tilt, decentre in [
        ("collimator", [0.05, -0.03, 0.0], [0.05, -0.04, 0.0]),
        ("relay", [-0.04, 0.05, 0.0], [-0.03, 0.05, 0.0]),
    ]:
        groups += f'\n[[group]]\nname = "{name}"\npivot_mm = 10.0\ntilt_deg = {tilt}\ndecentre_mm = {decentre}\n'
    return "".join(parts) + groups


def setup_with(system: str) -> str:
    text = re.sub(r"\[calibration\]\nfile = .*\n", "", SETUP.read_text())
    text = re.sub(r"observed_rows_px = 1200.*", "observed_rows_px = 1353", text)
    return f'{text}\n[optics]\nsystem = "{system}"\n'


def align(name: str, bench: Path, design: Path, out: Path, address: str, *more: str) -> None:
    screen = out / f"screen-{name}"
    screen.mkdir(parents=True, exist_ok=True)
    command = [RETINA, "lab", "camera", "--setup", bench, "--screen", f"folder:{screen}", "--interface", address, "--json"]
    command += ["--effect", f"screen_tilt={TILT_DEG[0]}deg,{TILT_DEG[1]}deg"]
    command += ["--effect", f"optical_centre={SHIFT_PX[0]},{SHIFT_PX[1]}", "--effect", f"defocus={FOCUS_MM}mm"]
    camera = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        camera.stdout.readline()
        command = [RETINA, "lab", "align", "--setup", design, "--screen", f"folder:{screen}", "--camera", "aravis"]
        command += ["--turn", "camera", "--rounds", "5", "--out", out / name, "--json", *more]
        start = time.monotonic()
        done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False)
        found = json.loads(done.stdout)
    finally:
        camera.send_signal(signal.SIGINT)
        camera.wait()
    # What the last round proposes has not been turned.
    turned = {screw: sum(r["screws"][screw]["turn"] for r in found["rounds"][:-1]) for screw in NEEDED}
    errors = ", ".join(f"{screw} {turned[screw] - needed:+.3f}" for screw, needed in NEEDED.items())
    print(f"{name}: {len(found['rounds'])} rounds, {time.monotonic() - start:.0f} s, aligned: {found['aligned']}; {errors}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--camera-address", default="127.0.0.1")
    parser.add_argument("--out", type=Path, default=ROOT / "out/lab-align")
    arguments = parser.parse_args()
    out = arguments.out
    out.mkdir(parents=True, exist_ok=True)
    built, design = out / "built-setup.toml", out / "design-setup.toml"
    (out / "as-built.toml").write_text(as_built(DESIGN.read_text()))
    design.write_text(setup_with("reference-1.3fc-wide"))
    built.write_text(setup_with("as-built.toml"))
    align("wide-fov", SETUP, SETUP, out, arguments.camera_address)
    align("reference-1.3fc-wide", design, design, out, arguments.camera_address)
    align("as-built", built, design, out, arguments.camera_address)
    align("as-built, relay fitted", built, design, out, arguments.camera_address, "--relay")


if __name__ == "__main__":
    main()
