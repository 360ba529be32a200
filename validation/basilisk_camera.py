"""A Basilisk simulation whose camera is `retina serve --basilisk`: the real client, its images measured.

    python3 -m venv V && V/bin/pip install -r validation/requirements-basilisk.txt
    V/bin/python validation/basilisk_camera.py --out DIR [--retina target/release/retina] [--lab]

With --lab the images are photographs of the virtual bench (`retina lab loop --basilisk`): the same Moon, the bench's camera.

Basilisk's own vizInterface asks for images (noDisplay, lock-step). A spacecraft looks at the Moon from several places, with
the camera turned and mounted off its centre; each image has another camera. The Moon is a smooth sphere here, so that its
limb is a circle. Expected from numpy alone: where its centre and limb are seen, and which side is lit. The exit code is 1 where a centre or a radius is off by more than 0.3 px, or a
lit side by more than 0.5 deg.
"""

import argparse
import ctypes
import io
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.simulation import spacecraft
from Basilisk.utilities import RigidBodyKinematics as rbk
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeGravBody, vizSupport
from PIL import Image

ROOT = Path(__file__).resolve().parent.parent
MOON_RADIUS_M = 1_737_400.0
MOON_M = np.array([1.2e8, -3.4e8, 0.7e8])
SUN_M = np.array([1.4e11, 4.0e10, -2.0e10])
# Field of view along y (deg), width and height (px), place on the spacecraft (m), its turn there (MRP), and the
# spacecraft's distance and direction from the Moon.
CASES = [
    (3.0, (640, 480), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 9.0e7, (1.0, 0.3, 0.2)),
    (2.0, (512, 512), (1.0, -2.0, 0.5), (0.2, -0.4, 0.1), 1.4e8, (0.2, 1.0, -0.5)),
    (6.0, (400, 600), (0.0, 0.0, 3.0), (-0.6, 0.1, 0.5), 5.0e7, (0.9, -0.2, 0.7)),
]

# The bench's camera: 1536 rows of 3.45 um at 25 mm.
LAB_CASES = [
    (float(np.degrees(2 * np.arctan(0.5 * 1536 * 0.00345 / 25.0))), (2048, 1536), mounted, turn, distance, direction)
    for _, _, mounted, turn, distance, direction in CASES
]
LAB_TOLERANCE_PX = 1.5

TOLERANCE_PX = 0.3

SCENE = """schema = "retina.scene/1"
setup = "wide-fov"
trajectory = { kind = "lumio-halo", frames = 1, step_s = 300.0 }
radiance_scale = 1.0

[compensation]
mode = "none"

[[body]]
name = "moon"
model = "sphere.glb"
shading = "smooth"
photometry = { model = "lommel-seeliger", normal_albedo = 0.12 }
"""


def looking_at(direction, roll):
    """A matrix [C N] with the boresight +z along a direction."""
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, 1.0], z)
    x /= np.linalg.norm(x)
    axes = np.array([x, np.cross(z, x), z])
    c, s = np.cos(roll), np.sin(roll)
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) @ axes


def expected(camera_from_inertial, place_m, fov_deg, size_px):
    focal_px = size_px[1] / 2 / np.tan(np.radians(fov_deg) / 2)
    middle = np.array(size_px) / 2
    seen = camera_from_inertial @ (MOON_M - place_m)
    centre = middle + focal_px * seen[:2] / seen[2]
    radius = focal_px * np.tan(np.arcsin(MOON_RADIUS_M / np.linalg.norm(seen)))
    sun = (camera_from_inertial @ (SUN_M - MOON_M))[:2]
    phase = np.degrees(np.arccos(np.dot(SUN_M - MOON_M, place_m - MOON_M) / np.linalg.norm(SUN_M - MOON_M)
                                 / np.linalg.norm(place_m - MOON_M)))
    return centre, radius, sun / np.linalg.norm(sun), phase


def simulated(port, case, number):
    """One run of Basilisk; the PNG of its camera."""
    fov_deg, size_px, mounted_m, sigma_cb, distance_m, direction = case
    direction = np.array(direction) / np.linalg.norm(direction)
    place = MOON_M + distance_m * direction
    # A little beside the Moon's middle.
    cn = looking_at(MOON_M + 0.3 * MOON_RADIUS_M * np.array([0.5, 0.5, -1.0]) - place, 0.7 * number)
    bn = rbk.MRP2C(np.array(sigma_cb)).T @ cn
    sim = SimulationBaseClass.SimBaseClass()
    process = sim.CreateNewProcess("process")
    process.addTask(sim.CreateNewTask("task", macros.sec2nano(1.0)))
    craft = spacecraft.Spacecraft()
    craft.ModelTag = "probe"
    craft.hub.r_CN_NInit = place.reshape(3, 1)
    craft.hub.v_CN_NInit = np.zeros((3, 1))
    craft.hub.sigma_BNInit = rbk.C2MRP(bn).reshape(3, 1)
    sim.AddModelToTask("task", craft)
    factory = simIncludeGravBody.gravBodyFactory()
    kept = []
    for body, at in ((factory.createMoon(), MOON_M), (factory.createSun(), SUN_M)):
        body.mu = 0.0  # Nothing moves.
        state = messaging.SpicePlanetStateMsgPayload()
        state.PlanetName = body.planetName
        state.PositionVector = at.tolist()
        state.J20002Pfix = np.identity(3).tolist()
        kept.append(messaging.SpicePlanetStateMsg().write(state))
        body.planetBodyInMsg.subscribeTo(kept[-1])
    factory.addBodiesTo(craft)
    viz = vizSupport.enableUnityVisualization(sim, "task", craft, noDisplay=True)
    viz.reqPortNumber = str(port)
    payload, message = vizSupport.createCameraConfigMsg(
        viz, cameraID=number, fieldOfView=np.radians(fov_deg), resolution=list(size_px), cameraPos_B=list(mounted_m),
        sigma_CB=list(sigma_cb), renderRate=1.0,
    )
    payload.isOn = 1
    message.write(payload)
    sim.InitializeSimulation()
    sim.ConfigureStopTime(macros.sec2nano(2.0))
    sim.ExecuteSimulation()
    image = viz.opnavImageOutMsgs[0].read()
    if image.valid != 1:
        return None
    return ctypes.string_at(int(image.imagePointer), image.imageBufferLength), place, cn, bn


def limb_points(light, centre, radius, sun):
    """Along rays within 60 deg of the Sun's side, where the light falls to half of what it is inside."""
    points = []
    for angle in np.radians(np.arange(-60, 61, 2)):
        c, s = np.cos(angle), np.sin(angle)
        ray = np.array([c * sun[0] - s * sun[1], s * sun[0] + c * sun[1]])
        r = np.arange(0.85 * radius, 1.15 * radius, 0.05)
        at = centre[None, :] + r[:, None] * ray[None, :] - 0.5
        x0, y0 = np.floor(at[:, 0]).astype(int), np.floor(at[:, 1]).astype(int)
        if x0.min() < 0 or y0.min() < 0 or x0.max() + 1 >= light.shape[1] or y0.max() + 1 >= light.shape[0]:
            continue
        fx, fy = at[:, 0] - x0, at[:, 1] - y0
        value = (light[y0, x0] * (1 - fx) * (1 - fy) + light[y0, x0 + 1] * fx * (1 - fy)
                 + light[y0 + 1, x0] * (1 - fx) * fy + light[y0 + 1, x0 + 1] * fx * fy)
        inside = np.median(value[(r > 0.9 * radius) & (r < 0.96 * radius)])
        below = np.nonzero((value[:-1] >= inside / 2) & (value[1:] < inside / 2))[0]
        if inside > 5 and len(below):
            points.append(centre + r[below[-1]] * ray)
    return np.array(points)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--retina", default=str(ROOT / "target/release/retina"))
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--lab", action="store_true", help="photographs of the virtual bench")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    subprocess.run(
        [arguments.retina, "body", "--radius-m", str(MOON_RADIUS_M), "--out", str(arguments.out / "sphere.glb"), "-q"],
        check=True,
    )
    scene = arguments.out / "scene.toml"
    setup = ROOT / "assets/setups/wide-fov.toml"
    if arguments.lab:
        bench = ["--setup", str(setup), "--screen", "bench", "--camera", "bench", "--settle-s", "0"]
        calibration = arguments.out / "calibration"
        subprocess.run(
            [arguments.retina, "lab", "calibrate", "geometry", *bench, "--screens", "16", "--out", str(calibration), "-q"],
            check=True,
        )
        compensated = f'mode = "direct"\ncalibration = "{(calibration / "calibration.toml").resolve()}"'
        scene.write_text(SCENE.replace('"wide-fov"', f'"{setup}"').replace('mode = "none"', compensated))
        command = ["lab", "loop", str(scene), *bench, "--radiance-scale", "0.02", "--out", str(arguments.out / "loop")]
    else:
        scene.write_text(SCENE)
        command = ["serve", str(scene), "--white-radiance-factor", "0.15"]
    cases, tolerance_px = (LAB_CASES, LAB_TOLERANCE_PX) if arguments.lab else (CASES, TOLERANCE_PX)
    server = subprocess.Popen(
        [arguments.retina, *command, "--basilisk", "--basilisk-port", "0", "--json"], stdout=subprocess.PIPE, text=True,
    )
    failed = False
    try:
        port = int(json.loads(server.stdout.readline())["basilisk"].rsplit(":", 1)[1])
        print("| camera | centre off | limb radius off | light off | phase |\n|---|---|---|---|---|")
        for number, case in enumerate(cases):
            made = simulated(port, case, number)
            if made is None:
                print(f"| {number} | no image | | | |")
                failed = True
                continue
            png, place, cn, bn = made
            (arguments.out / f"camera-{number}.png").write_bytes(png)
            pixels = np.asarray(Image.open(io.BytesIO(png)).convert("L"))
            fov_deg, size_px, mounted_m = case[:3]
            centre, radius, sun, phase = expected(cn, place + bn.T @ np.array(mounted_m), fov_deg, size_px)
            if pixels.shape != (size_px[1], size_px[0]):
                print(f"| {number} | {pixels.shape} px instead of {size_px} | | | |")
                failed = True
                continue
            light = pixels.astype(float)
            # The dark level of a camera is no light.
            light = np.maximum(light - 1.5 * np.median(light), 0.0) if arguments.lab else light
            points = limb_points(light, centre, radius, sun)
            # A circle by least squares: |p|^2 = 2 c . p + (r^2 - |c|^2).
            system = np.column_stack([2 * points, np.ones(len(points))])
            solution = np.linalg.lstsq(system, (points**2).sum(1), rcond=None)[0]
            found = solution[:2]
            found_radius = np.sqrt(solution[2] + found @ found)
            ys, xs = np.nonzero(light > 0)
            lit = np.array([np.average(xs + 0.5, weights=light[ys, xs]), np.average(ys + 0.5, weights=light[ys, xs])])
            lit = (lit - centre) / np.linalg.norm(lit - centre)
            off_deg = np.degrees(np.arccos(np.clip(lit @ sun, -1, 1)))
            off = found - centre
            wrong = np.hypot(*off) > tolerance_px or abs(found_radius - radius) > tolerance_px or off_deg > 0.5
            failed |= bool(wrong)
            print(f"| {number} | ({off[0]:+.3f}, {off[1]:+.3f}) px | {found_radius - radius:+.3f} px of {radius:.1f} | "
                  f"{off_deg:.2f} deg | {phase:.0f} deg |", flush=True)
    finally:
        server.terminate()
        server.wait(10)
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
