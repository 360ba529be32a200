"""Renders a CORTO scenario with Blender Cycles, set up as CORTO does, and with `retina render --corto`; compares.

    python corto_blender.py [--scenario DIR] [--frames 0 1 ...] [--samples 64] [--out DIR]

The body's file, set_scale and albedo are those of the example's sidecar and given as arguments here.
Printed for each frame: the shift of one image against the other (least squares over the whole image, from
its gradients) and the ratio of their linear values where both are lit. Exit code 0: every
frame agrees within the limits below; 1: not; 2 bad input or failure. See docs/corto.md and README.md.
"""

import argparse
import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
# Where the two programs may differ: the pixel filter, Cycles' noise, 8-bit counts.
LARGEST_SHIFT_PX = 0.1
LARGEST_RATIO_ERROR = 0.01


def in_blender(job_file):
    """The part that runs inside Blender: the scenario as CORTO's classes build it."""
    import bpy
    from mathutils import Vector

    job = json.loads(Path(job_file).read_text())
    settings = json.loads(Path(job["scene"]).read_text())
    geometry = json.loads(Path(job["geometry"]).read_text())
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.color = (0, 0, 0)

    camera_settings = settings["camera_settings"]
    bpy.ops.object.camera_add(location=(0, 0, 0), rotation=(0, 0, 0))
    camera = bpy.context.object
    camera.data.type = "PERSP"
    camera.data.lens_unit = "FOV"
    camera.data.angle = math.radians(camera_settings["fov"])
    camera.data.clip_start = camera_settings["clip_start"]
    camera.data.clip_end = camera_settings["clip_end"]
    scene.camera = camera

    bpy.ops.object.light_add(type="SUN")
    sun = bpy.context.object
    sun.data.energy = settings["sun_settings"]["energy"]
    sun.data.angle = math.radians(settings["sun_settings"]["angle"])

    kind = Path(job["body"]).suffix.lower()
    if kind == ".obj":
        bpy.ops.wm.obj_import(filepath=job["body"])
        bpy.ops.object.shade_smooth()
    else:
        # Debian's NumPy has dropped the alias that Blender 3.4's importer uses.
        np.bool = bool
        bpy.ops.import_scene.gltf(filepath=job["body"])
    body = [item for item in bpy.context.selected_objects if item.type == "MESH"][0]
    body.scale = (job["set_scale"],) * 3
    material = bpy.data.materials.new("diffuse")
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output, diffuse = nodes.new("ShaderNodeOutputMaterial"), nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Color"].default_value = (job["albedo"],) * 3 + (1.0,)
    links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])
    body.data.materials.clear()
    body.data.materials.append(material)

    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = job["samples"]
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.cycles.film_exposure = camera_settings["film_exposure"]
    scene.cycles.max_bounces = scene.cycles.diffuse_bounces = job["bounces"]
    # Cycles pulls shadow rays off coarse meshes by default; the geometry's own shadow is wanted.
    body.cycles.shadow_terminator_geometry_offset = 0.0
    render = scene.render
    render.resolution_x, render.resolution_y = camera_settings["res_x"], camera_settings["res_y"]
    render.resolution_percentage = 100
    render.dither_intensity = 0.0
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_depth = "32"
    for frame in job["frames"]:
        for item, name in ((camera, "camera"), (body, "body")):
            item.location = geometry[name]["position"][frame]
            item.rotation_mode = "QUATERNION"
            item.rotation_quaternion = geometry[name]["orientation"][frame]
        # CORTO turns the lamp from its position towards the origin.
        position = Vector(geometry["sun"]["position"][frame])
        sun.location = position
        sun.rotation_mode = "QUATERNION"
        sun.rotation_quaternion = (-position).to_track_quat("-Z", "Y")
        render.filepath = str(Path(job["out"]) / ("blender-%06d.exr" % frame))
        bpy.ops.render.render(write_still=True)
        image = bpy.data.images.load(render.filepath)
        image.colorspace_settings.name = "Linear"
        width, height = image.size
        pixels = np.array(image.pixels[:], dtype=np.float32).reshape(height, width, 4)[::-1, :, 0]
        np.save(Path(job["out"]) / ("blender-%06d.npy" % frame), pixels)


def linear(png):
    """Linear values 0..1 of an sRGB-encoded grey PNG (IEC 61966-2-1)."""
    from PIL import Image

    picture = Image.open(png)
    full = 65535.0 if picture.mode.startswith("I") else 255.0
    encoded = np.asarray(picture, dtype=float) / full
    encoded = encoded if encoded.ndim == 2 else encoded[..., 0]
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def shift(ours, theirs):
    """Least-squares shift (x, y) in pixels that takes theirs onto ours, from the images' gradients."""
    slope_y, slope_x = np.gradient(0.5 * (ours + theirs))
    columns = np.stack([slope_x.ravel(), slope_y.ravel()], axis=1)
    solution, *_ = np.linalg.lstsq(columns, (theirs - ours).ravel(), rcond=None)
    return solution


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", type=Path, default=ROOT / "assets/corto/eros")
    parser.add_argument("--body", default="eros.obj", help="name in body/shape/")
    parser.add_argument("--set-scale", type=float, default=0.1)
    parser.add_argument("--albedo", type=float, default=0.25)
    parser.add_argument("--frames", type=int, nargs="+", default=[0, 1, 2, 3, 4])
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--bounces", type=int, default=0)
    parser.add_argument("--retina", type=Path, default=ROOT / "target/release/retina")
    parser.add_argument("--backend", default="auto", choices=["auto", "gpu", "cpu"])
    parser.add_argument("--out", type=Path, default=ROOT / "out/corto-blender")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    job = {
        "scene": str(arguments.scenario.resolve() / "scene/scene.json"),
        "geometry": str(arguments.scenario.resolve() / "geometry/geometry.json"),
        "body": str(arguments.scenario.resolve() / "body/shape" / arguments.body),
        "set_scale": arguments.set_scale,
        "albedo": arguments.albedo,
        "samples": arguments.samples,
        "bounces": arguments.bounces,
        "frames": arguments.frames,
        "out": str(out),
    }
    job_file = out / "job.json"
    job_file.write_text(json.dumps(job))
    subprocess.run(
        ["blender", "-b", "--python-exit-code", "2", "-P", __file__, "--", str(job_file)],
        check=True,
        stdout=subprocess.DEVNULL,
        # Blender looks for its Python's libraries beside the first `python3` of PATH.
        env=dict(os.environ, PATH=os.pathsep.join(["/usr/bin", os.environ.get("PATH", os.defpath)])),
    )
    frames = out / "retina"
    command = [arguments.retina, "render", "--corto", arguments.scenario, "--out", frames]
    command += ["--backend", arguments.backend, "--resume"]
    subprocess.run(command, check=True)
    agrees = True
    print("frame   shift x   shift y   ratio (median)   ratio 5 .. 95 %   lit pixels")
    for frame in arguments.frames:
        ours = linear(frames / ("frames/%06d.png" % frame))
        theirs = np.clip(np.load(out / ("blender-%06d.npy" % frame)), 0.0, 1.0)
        lit = (ours > 0.05) & (theirs > 0.05)
        ratio = ours[lit] / theirs[lit]
        x, y = shift(ours, theirs)
        low, middle, high = np.percentile(ratio, [5, 50, 95])
        print(f"{frame:5d} {x:9.4f} {y:9.4f} {middle:16.5f} {low:9.4f} .. {high:.4f} {lit.sum():9d}")
        agrees &= math.hypot(x, y) <= LARGEST_SHIFT_PX and abs(middle - 1.0) <= LARGEST_RATIO_ERROR
    return 0 if agrees else 1


if __name__ == "__main__":
    if "--" in sys.argv and "bpy" in sys.modules:
        in_blender(sys.argv[sys.argv.index("--") + 1])
    else:
        try:
            sys.exit(main())
        except (OSError, subprocess.CalledProcessError) as error:
            print(f"corto_blender: {error}", file=sys.stderr)
            sys.exit(2)
