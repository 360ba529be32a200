"""Renders the same Moon with Blender Cycles and with `retina render`; prints seconds a frame and error.

See README.md for what is compared and how. Exit code 0 done, 2 bad input or failure.
"""

import argparse
import hashlib
import json
import os
import shutil
import statistics
import subprocess
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

import common
from common import say
from cycles_errors import Piece, against_whole_discs, errors, reference_noise
from cycles_table import print_table

FULL = (1920, 1200)
SQUARE = (1024, 1024)
NORMAL_ALBEDO = 0.12
DISTANCE_M = 41_000e3
UNIT_M = 1e6  # Blender's unit
REFERENCE_SEEDS = (101, 202)
RESULT_FORMAT = 2  # of the results kept from runs of retina


@dataclass
class Plan:
    """What is rendered; --quick takes less of it."""

    phases_deg: tuple
    samples: tuple
    reference_samples: int
    crop_px: int
    sizes: tuple
    error_size: tuple
    retina_runs: tuple  # (name, backend, quality)
    repeats: int


THOROUGH = Plan(
    phases_deg=(20, 60, 100),
    samples=(16, 64),
    reference_samples=4096,
    crop_px=128,
    sizes=(FULL, SQUARE),
    error_size=FULL,
    retina_runs=(("default", "native", "default"), ("best", "native", "best"), ("cpu best", "cpu", "best")),
    repeats=3,
)
QUICK = Plan(
    phases_deg=(60,),
    samples=(16, 64),
    reference_samples=1024,
    crop_px=96,
    sizes=(SQUARE,),
    error_size=SQUARE,
    retina_runs=(("default", "native", "default"), ("best", "native", "best")),
    repeats=6,
)


def pose_of(phase_deg):
    """Above the far side, rolled and off the middle, so that nothing lies on a pixel grid."""
    return common.pose(190.0, -7.0, DISTANCE_M, phase_deg, roll_deg=12.0, offset=(0.0006, -0.0004))


def size_name(size_px):
    return f"{size_px[0]}x{size_px[1]}"


def digest(*parts):
    total = hashlib.sha256()
    for part in parts:
        total.update(part if isinstance(part, bytes) else json.dumps(part, sort_keys=True).encode())
    return total.hexdigest()[:16]


# --- the body, for both sides ------------------------------------------------------------------


def prepare_body(folder, variant):
    """The mesh and textures as arrays for Blender, the model file for retina."""
    glb = common.Glb(common.MOON)
    mesh = common.welded_mesh(glb)
    mesh_file = folder / "mesh.npz"
    if not mesh_file.exists():
        np.savez(folder / "mesh.partial.npz", **mesh)
        (folder / "mesh.partial.npz").replace(mesh_file)
    primitives = glb.document["meshes"][0]["primitives"]
    if variant == "uniform":
        model = folder / "moon-uniform.glb"
        glb.write_without_textures(model)
        return mesh_file, model, [None] * len(primitives)
    images = []
    for primitive in primitives:
        material = glb.document["materials"][primitive["material"]]
        texture = material["pbrMetallicRoughness"]["baseColorTexture"]["index"]
        entry = glb.document["images"][glb.document["textures"][texture]["source"]]
        encoded = np.asarray(Image.open(BytesIO(glb.view(entry["bufferView"]))).convert("L"))
        images.append(common.srgb_to_linear(encoded / 255.0))
    scale = NORMAL_ALBEDO / common.area_mean(mesh, images)
    files = []
    for k, image in enumerate(images):
        file = folder / f"albedo-{k}.npy"
        np.save(file, (image * scale).astype(np.float32))
        files.append(str(file))
    return mesh_file, common.MOON, files


# --- where errors are taken --------------------------------------------------------------------


def crops(phase_deg, size_px, crop_px):
    """Squares at the lit limb, at the terminator and at a cusp, as [x, y, w, h]; by geometry alone."""
    at = pose_of(phase_deg)
    center = at["camera_from_inertial"] @ -at["camera_m"]
    toward_sun = (at["camera_from_inertial"] @ at["sun_direction"])[:2]
    toward_sun /= np.linalg.norm(toward_sun)
    middle = np.array(size_px) / 2 + common.NARROW_FOCAL_PX * center[:2] / center[2]
    radius = common.NARROW_FOCAL_PX * np.tan(np.arcsin(common.MOON_RADIUS_M / DISTANCE_M))
    cusp = np.array([-toward_sun[1], toward_sun[0]])
    places = {
        "limb": middle + toward_sun * radius,
        "terminator": middle - toward_sun * radius * np.cos(np.radians(phase_deg)),
        "cusp": middle + cusp * radius,
    }
    result = {}
    for name, place in places.items():
        corner = np.round(place - crop_px / 2).astype(int)
        corner = np.clip(corner, 0, np.array(size_px) - crop_px)
        result[name] = [int(corner[0]), int(corner[1]), crop_px, crop_px]
    return result


# --- Cycles ------------------------------------------------------------------------------------


def cycles_jobs(plan, folder):
    def job(name, phase, size, samples, seed, border=None):
        at = pose_of(phase)
        return {
            "camera_m": at["camera_m"].tolist(),
            "inertial_from_camera": at["camera_from_inertial"].T.tolist(),
            "sun_direction": at["sun_direction"].tolist(),
            "size_px": list(size),
            "focal_px": common.NARROW_FOCAL_PX,
            "samples": samples,
            "seed": seed,
            "border_px": border,
            "out": str(folder / f"{name}.exr"),
        }

    jobs = []
    for size in plan.sizes:
        middle = plan.phases_deg[len(plan.phases_deg) // 2]
        phases = plan.phases_deg if size == plan.error_size else (middle,)
        for phase in phases:
            for samples in plan.samples:
                jobs.append(job(f"{size_name(size)}-{phase}-{samples}", phase, size, samples, 1))
    for phase in plan.phases_deg:
        for name, border in crops(phase, plan.error_size, plan.crop_px).items():
            for seed in REFERENCE_SEEDS:
                out = f"reference-{size_name(plan.error_size)}-{phase}-{name}-{seed}"
                jobs.append(job(out, phase, plan.error_size, plan.reference_samples, seed, border))
    return jobs


def run_cycles(plan, folder, mesh_file, textures):
    """Runs what is not there yet in one Blender process; returns all results by name."""
    folder.mkdir(parents=True, exist_ok=True)
    if shutil.which("blender") is None:
        common.fail("Blender is missing: apt-get install --no-install-recommends blender python3-numpy")
    script = Path(__file__).with_name("cycles_scene.py")
    spec = {
        "mesh": str(mesh_file),
        "textures": textures,
        "albedo": NORMAL_ALBEDO,
        "unit_m": UNIT_M,
        "sun_angle_rad": 2 * float(np.arcsin(common.SUN_RADIUS_M / common.AU_M)),
    }
    contents = [Path(f).read_bytes() for f in [mesh_file, *filter(None, textures)]]
    scene_key = digest(script.read_bytes(), *contents, spec)
    jobs = cycles_jobs(plan, folder)
    keys = {job["out"]: digest(scene_key, job) for job in jobs}

    def done(job):
        try:
            known = json.loads(Path(job["out"] + ".json").read_text())["job"].get("key")
        except (OSError, ValueError):
            return False
        return known == keys[job["out"]] and Path(job["out"]).exists()

    missing = [dict(job, key=keys[job["out"]]) for job in jobs if not done(job)]
    if missing:
        say(f"Cycles: {len(missing)} of {len(jobs)} renders to do in {folder}")
        spec["jobs"] = missing
        (folder / "jobs.json").write_text(json.dumps(spec))
        command = ["blender", "-b", "--factory-startup", "-P", str(script), "--", str(folder / "jobs.json")]
        with open(folder / "blender.log", "w") as log:
            process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=common.blender_env()
            )
            for line in process.stdout:
                log.write(line)
                if line.startswith("CYCLES-JOB"):
                    say("  ", line.strip())
            code = process.wait()
        if code != 0 or not all(map(done, jobs)):
            log = (folder / "blender.log").read_text()
            mend = "; its Python has no numpy: apt-get install python3-numpy" if "named 'numpy'" in log else ""
            common.fail(f"Blender ended with {code}{mend}; see {folder / 'blender.log'}")
    return {Path(job["out"]).stem: json.loads(Path(job["out"] + ".json").read_text()) for job in jobs}


# --- retina ------------------------------------------------------------------------------------


def cached(path, key, fresh_run):
    """The JSON of an earlier run of the same key, or of a new one."""
    try:
        known = json.loads(path.read_text())
        if known["key"] == key:
            return known
    except (OSError, ValueError, KeyError):
        pass
    result = dict(fresh_run(), key=key)
    common.write_json(path, result)
    return result


def render_with_retina(folder, model, size, poses, quality, backend, output, binary, timed=False):
    """One run of `retina render`; frames stay in folder/frames. Seconds a frame from the times at
    which the frames' PNG were finished."""
    photometry = f'{{ model = "lambert", normal_albedo = {NORMAL_ALBEDO} }}'
    scene = common.write_scene(folder, model, poses, size, photometry, output)
    texts = [(folder / name).read_bytes() for name in ("scene.toml", "poses.csv", "setup.toml")]
    key = digest(RESULT_FORMAT, binary, Path(model).read_bytes(), *texts, quality, backend)

    def run():
        out = folder / "out"
        shutil.rmtree(out, ignore_errors=True)
        arguments = ["render", scene, "--out", out, "--backend", backend, "--quality", quality]
        say(f"retina {quality} {backend} {size_name(size)}: {len(poses)} frames")
        one = None
        if timed:
            # The CPU time of one frame alone holds the start-up, which is then taken off.
            one = common.run_retina([*arguments, "--frames", "0..1"], folder / "retina.log")
            shutil.rmtree(out)
        result = common.run_retina(arguments, folder / "retina.log")
        finished = sorted(f.stat().st_mtime_ns / 1e9 for f in (out / "frames").glob("*.png"))
        if len(finished) != len(poses):
            common.fail(f"{out}/frames holds {len(finished)} of {len(poses)} PNG")
        steps = np.diff(finished)
        result["frame_s"] = float(np.median(steps)) if len(steps) else None
        result["frame_mean_s"] = float(np.mean(steps)) if len(steps) else None
        if one is not None:
            result["frame_cpu_s"] = (result["cpu_s"] - one["cpu_s"]) / (len(poses) - 1)
        result["first_frame_s"] = finished[0] - result["started_at"]
        result["frame_count"] = len(poses)
        manifest = (out / "manifest.jsonl").read_text().splitlines()
        result["manifest"] = json.loads(manifest[0])
        return result

    result = cached(folder / "result.json", key, run)
    result["frames"] = str(folder / "out/frames")
    return result


def retina_images(plan, folder, model, binary):
    """Images for the errors: one frame a phase, with the mask."""
    poses = [pose_of(phase) for phase in plan.phases_deg]
    runs = {}
    for name, backend, quality in plan.retina_runs:
        runs[name] = render_with_retina(
            folder / f"errors-{name.replace(' ', '-')}",
            model,
            plan.error_size,
            poses,
            quality,
            backend,
            'radiance_exr = true\nlayers = ["mask"]',
            binary,
        )
    return runs


def retina_timings(plan, folder, model, binary):
    """Runs for the clock: PNG alone (the product), and with the linear EXR as Cycles writes one."""
    timings = {}
    for size in plan.sizes:
        for name, backend, quality in plan.retina_runs:
            repeats = plan.repeats if name == "default" else 2
            poses = [pose_of(phase) for _ in range(repeats) for phase in plan.phases_deg]
            if name != "default" and (backend == "cpu" or size != plan.error_size):
                continue
            for files, exr in (("png", "false"), ("png+exr", "true")):
                if name != "default" and exr == "true":
                    continue
                timings[f"{name} {files} {size_name(size)}"] = render_with_retina(
                    folder / f"time-{name}-{files}-{size_name(size)}",
                    model,
                    size,
                    poses,
                    quality,
                    backend,
                    f"radiance_exr = {exr}",
                    binary,
                    timed=True,
                )
    return timings


# --- images ------------------------------------------------------------------------------------


def load_pieces(plan, folder):
    pieces = []
    for phase in plan.phases_deg:
        for place, box in crops(phase, plan.error_size, plan.crop_px).items():
            halves = [
                common.read_exr(folder / f"reference-{size_name(plan.error_size)}-{phase}-{place}-{seed}.exr")
                for seed in REFERENCE_SEEDS
            ]
            values = [half["R"].astype(np.float64) for half in halves]
            alpha = np.mean([half["A"].astype(np.float64) for half in halves], axis=0)
            edge = (alpha > 1e-6) & (alpha < 1 - 1e-6)
            limb = ndimage.binary_dilation(edge, np.ones((3, 3)))
            pieces.append(
                Piece(
                    phase_deg=phase,
                    place=place,
                    box=box,
                    reference=(values[0] + values[1]) / 2,
                    half_difference=(values[0] - values[1]) / 2,
                    alpha=alpha,
                    limb=limb,
                    interior=(alpha >= 1 - 1e-6) & ~limb,
                )
            )
    return pieces


def frame_images(run, phases, key="IF"):
    images = {}
    for k, phase in enumerate(phases):
        channels = common.read_exr(Path(run["frames"]) / f"{k:06}.exr")
        images[phase] = (channels[key], channels["mask"])
    return images


def cycles_images(folder, plan, samples):
    images = {}
    for phase in plan.phases_deg:
        channels = common.read_exr(folder / f"{size_name(plan.error_size)}-{phase}-{samples}.exr")
        images[phase] = (channels["R"], channels["A"])
    return images


# --- the table ---------------------------------------------------------------------------------


def cycles_timing(results, size, samples):
    own = [r for name, r in results.items() if name.startswith(size_name(size)) and r["job"]["samples"] == samples]
    return {
        "frame_s": statistics.median(r["wall_s"] for r in own),
        "cpu_s": statistics.median(r["cpu_s"] for r in own),
        "frames": len(own),
        "first_frame_s": own[0]["build_s"] + own[0]["first_frame_s"],
        "peak_mb": own[0]["peak_mb"],
        "load": [max(r["load"][0] for r in own), max(r["load"][1] for r in own)],
    }


def bench(variant, plan, out):
    folder = out / variant
    folder.mkdir(parents=True, exist_ok=True)
    mesh_file, model, textures = prepare_body(folder, variant)
    cycles_folder = folder / "cycles"
    results = run_cycles(plan, cycles_folder, mesh_file, textures)
    common.require_retina()
    binary = hashlib.sha256(common.RETINA.read_bytes()).hexdigest()
    retina = folder / "retina"
    timings = retina_timings(plan, retina, model, binary)
    runs = retina_images(plan, retina, model, binary)

    table = {}
    ratios = {}
    for size in plan.sizes:
        for samples in plan.samples:
            table[f"Cycles {samples} {size_name(size)}"] = cycles_timing(results, size, samples)
        for name, run in timings.items():
            if name.endswith(size_name(size)):
                table[f"retina {name}"] = {
                    "frame_s": run["frame_s"],
                    "frame_mean_s": run["frame_mean_s"],
                    "cpu_s": run["frame_cpu_s"],
                    "frames": run["frame_count"],
                    "first_frame_s": run["first_frame_s"],
                    "peak_mb": run["peak_mb"],
                    "load": run["load"],
                }
        slow, fast = f"Cycles {max(plan.samples)} {size_name(size)}", f"retina default png+exr {size_name(size)}"
        for key, what in (("frame_s", "wall"), ("cpu_s", "CPU")):
            ratios[f"{slow} / {fast}, {what}"] = table[slow][key] / table[fast][key]
    pieces = load_pieces(plan, cycles_folder)
    contenders = {f"Cycles {s}": cycles_images(cycles_folder, plan, s) for s in plan.samples}
    contenders |= {f"retina {name}": frame_images(run, plan.phases_deg) for name, run in runs.items()}
    truth = contenders.get("retina cpu best")
    report = {
        "schema": "retina.bench-cycles/1",
        "albedo": variant,
        "phases_deg": plan.phases_deg,
        "distance_m": DISTANCE_M,
        "focal_px": common.NARROW_FOCAL_PX,
        "blender": next(iter(results.values()))["blender"],
        "normal_residual_rms_rad": next(iter(results.values()))["normal_rms_rad"],
        "processors": os.cpu_count(),
        "adapter": {k: v for k, v in next(iter(runs.values()))["manifest"].items() if k in ("adapter", "driver")},
        "reference_samples": plan.reference_samples,
        "timings": table,
        "speed_ratios": ratios,
        "errors": {name: errors(pieces, images) for name, images in contenders.items()},
        "reference_noise": reference_noise(pieces),
        "whole_discs": {
            name: against_whole_discs(images, truth) for name, images in contenders.items() if images is not truth
        }
        if truth
        else {},
    }
    common.write_json(folder / "report.json", report)
    print_table(variant, report)
    print(f"\n{folder / 'report.json'}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--albedo", choices=("uniform", "map", "both"), default="both", help="default: both")
    parser.add_argument("--quick", action="store_true", help="two minutes: one phase, 1024 x 1024, albedo map")
    parser.add_argument("--fresh", action="store_true", help="forget earlier results")
    parser.add_argument("--cycles-only", action="store_true", help="only make the Cycles images")
    parser.add_argument("--no-cpu", action="store_true", help="leave out retina's CPU renderer, which takes minutes")
    parser.add_argument("--out", type=Path, help="default: out/bench-cycles, or out/bench-cycles-quick")
    arguments = parser.parse_args()
    plan = QUICK if arguments.quick else THOROUGH
    out = arguments.out or common.ROOT / ("out/bench-cycles-quick" if arguments.quick else "out/bench-cycles")
    if arguments.no_cpu:
        plan = replace(plan, retina_runs=tuple(run for run in plan.retina_runs if run[1] != "cpu"))
    variants = {"both": ("uniform", "map")}.get(arguments.albedo, (arguments.albedo,))
    if arguments.quick and arguments.albedo == "both":
        variants = ("map",)
    for variant in variants:
        if arguments.fresh:
            shutil.rmtree(out / variant, ignore_errors=True)
        if arguments.cycles_only:
            folder = out / variant
            folder.mkdir(parents=True, exist_ok=True)
            mesh_file, _, textures = prepare_body(folder, variant)
            run_cycles(plan, folder / "cycles", mesh_file, textures)
        else:
            bench(variant, plan, out)


if __name__ == "__main__":
    main()
