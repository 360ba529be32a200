"""Renders jobs with Blender Cycles. Run by bench_cycles.py: blender -b -P cycles_scene.py -- JOBS.json

One process loads the mesh once and renders every job of the list, so that the scene's set-up and the
acceleration structure are paid once (persistent data). Each job leaves an EXR and a JSON beside it.
Positions are in units of `unit_m` metres, because Blender computes in f32. The mesh comes as arrays
in body-fixed axes: no importer turns its axes.
"""

import json
import os
import resource
import sys
import time

import bpy
import numpy as np
from mathutils import Matrix


def load_mesh(path, unit_m):
    """The welded mesh with the given vertex normals; returns it and its residual, rad."""
    arrays = np.load(path)
    positions, triangles = arrays["positions"] / unit_m, arrays["triangles"]
    mesh = bpy.data.meshes.new("body")
    mesh.vertices.add(len(positions))
    mesh.vertices.foreach_set("co", positions.astype(np.float32).ravel())
    mesh.loops.add(triangles.size)
    mesh.loops.foreach_set("vertex_index", triangles.astype(np.int32).ravel())
    mesh.polygons.add(len(triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, triangles.size, 3, dtype=np.int32))
    mesh.polygons.foreach_set("loop_total", np.full(len(triangles), 3, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(triangles), dtype=bool))
    mesh.polygons.foreach_set("material_index", arrays["surface"].astype(np.int32))
    layer = mesh.uv_layers.new(name="uv")
    # glTF counts v from the image's top, Blender from its bottom.
    uv = arrays["corner_uv"].reshape(-1, 2) * [1.0, -1.0] + [0.0, 1.0]
    layer.data.foreach_set("uv", uv.astype(np.float32).ravel())
    mesh.update(calc_edges=True)
    mesh.use_auto_smooth = True
    mesh.auto_smooth_angle = np.pi
    wanted = arrays["normals"]
    mesh.normals_split_custom_set_from_vertices(wanted.tolist())
    mesh.calc_normals_split()
    got = np.empty(triangles.size * 3, dtype=np.float32)
    mesh.loops.foreach_get("normal", got)
    difference = got.reshape(-1, 3) - wanted[triangles.ravel()]
    rms_rad = float(np.sqrt((difference**2).sum(axis=1).mean()))
    return mesh, rms_rad


def diffuse_material(name, texture, albedo):
    """Plain Lambert of the given albedo: a linear image (rows from the top) or one number."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    output = nodes.new("ShaderNodeOutputMaterial")
    diffuse = nodes.new("ShaderNodeBsdfDiffuse")
    diffuse.inputs["Roughness"].default_value = 0.0
    links.new(diffuse.outputs["BSDF"], output.inputs["Surface"])
    if texture is None:
        diffuse.inputs["Color"].default_value = (albedo, albedo, albedo, 1.0)
        return material
    values = np.load(texture)
    height, width = values.shape
    # A float image: Cycles filters 8-bit sRGB images before it decodes them.
    image = bpy.data.images.new(name, width, height, float_buffer=True, is_data=True)
    pixels = np.ones((height, width, 4), dtype=np.float32)
    pixels[..., :3] = values[::-1, :, None]
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    node = nodes.new("ShaderNodeTexImage")
    node.image = image
    node.interpolation = "Linear"
    node.extension = "EXTEND"
    links.new(node.outputs["Color"], diffuse.inputs["Color"])
    return material


def build(spec):
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    mesh, normal_rms_rad = load_mesh(spec["mesh"], spec["unit_m"])
    for k, texture in enumerate(spec["textures"]):
        mesh.materials.append(diffuse_material("surface-%d" % k, texture, spec["albedo"]))
    body = bpy.data.objects.new("body", mesh)
    scene.collection.objects.link(body)
    # The shadow ray starts at the facet itself, and the smooth normal is left as it is.
    body.cycles.shadow_terminator_geometry_offset = 0.0
    body.cycles.shadow_terminator_offset = 0.0

    sun = bpy.data.lights.new("sun", "SUN")
    sun.energy = np.pi  # irradiance pi: a Lambert surface has radiance albedo * cos i = I/F
    sun.angle = spec["sun_angle_rad"]
    sun.cycles.use_multiple_importance_sampling = False
    scene.collection.objects.link(bpy.data.objects.new("sun", sun))
    camera = bpy.data.cameras.new("camera")
    scene.collection.objects.link(bpy.data.objects.new("camera", camera))
    scene.camera = bpy.data.objects["camera"]
    scene.world = None

    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.feature_set = "SUPPORTED"
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.use_auto_tile = False
    cycles.pixel_filter_type = "BOX"  # one pixel wide
    cycles.filter_width = 1.0
    cycles.light_sampling_threshold = 0.0
    cycles.sample_clamp_direct = 0.0
    cycles.time_limit = 0.0
    for kind in ("max", "diffuse", "glossy", "transmission", "volume", "transparent_max"):
        setattr(cycles, kind + "_bounces", 0)
    render = scene.render
    render.use_persistent_data = True
    render.film_transparent = True  # alpha is the coverage
    render.resolution_percentage = 100
    render.dither_intensity = 0.0
    render.use_compositing = False
    render.use_sequencer = False
    render.image_settings.file_format = "OPEN_EXR"
    render.image_settings.color_mode = "RGBA"
    render.image_settings.color_depth = "32"
    render.image_settings.exr_codec = "ZIP"
    scene.view_settings.view_transform = "Raw"
    scene.view_settings.look = "None"
    return scene, normal_rms_rad


def place(scene, job, unit_m):
    """Body, camera and Sun. Job axes: camera +x right, +y down, +z boresight; Blender's +y up, -z ahead.

    Blender's matrices are f32. A turned camera would be off by some 1e-7 rad, 0.002 px; so the camera
    stays unturned and the body turns, where the same rounding is 1e-4 px at the limb.
    """
    blender_from_camera = np.diag([1.0, -1.0, -1.0])
    turn = blender_from_camera @ np.array(job["inertial_from_camera"]).T
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    body = bpy.data.objects["body"]
    body.rotation_mode = "QUATERNION"
    body.matrix_world = Matrix(matrix.tolist())
    matrix = np.eye(4)
    matrix[:3, 3] = turn @ np.array(job["camera_m"]) / unit_m
    scene.camera.matrix_world = Matrix(matrix.tolist())
    # A sun lamp shines along its -z.
    towards = turn @ np.array(job["sun_direction"])
    aside = np.cross(towards, [0.0, 1.0, 0.0] if abs(towards[1]) < 0.9 else [1.0, 0.0, 0.0])
    aside /= np.linalg.norm(aside)
    lamp = np.eye(4)
    lamp[:3, :3] = np.stack([aside, np.cross(towards, aside), towards], axis=1)
    bpy.data.objects["sun"].matrix_world = Matrix(lamp.tolist())

    render, camera = scene.render, scene.camera.data
    width, height = job["size_px"]
    render.resolution_x, render.resolution_y = width, height
    camera.sensor_fit = "HORIZONTAL"
    camera.sensor_width = 36.0
    camera.lens = 36.0 * job["focal_px"] / width
    distance = np.linalg.norm(job["camera_m"]) / unit_m
    camera.clip_start, camera.clip_end = 0.5 * distance, 2.0 * distance
    border = job.get("border_px")
    render.use_border = render.use_crop_to_border = border is not None
    if border is not None:
        # Blender truncates fraction * size; rows count from below.
        x, y, w, h = border
        render.border_min_x, render.border_max_x = (x + 0.25) / width, (x + w + 0.25) / width
        render.border_min_y, render.border_max_y = (height - y - h + 0.25) / height, (height - y + 0.25) / height
    cycles = scene.cycles
    cycles.samples = job["samples"]
    cycles.seed = job["seed"]
    # The tables of the default pattern end after some thousand samples; Sobol's sequence does not.
    cycles.sampling_pattern = "SOBOL" if job["samples"] > 1024 else "PROGRESSIVE_MULTI_JITTER"


def render_job(scene, job, unit_m):
    place(scene, job, unit_m)
    scene.render.filepath = job["out"] + ".partial.exr"
    load_before = os.getloadavg()[0]
    cpu_before = resource.getrusage(resource.RUSAGE_SELF)
    started = time.perf_counter()
    bpy.ops.render.render(write_still=True)
    wall_s = time.perf_counter() - started
    cpu = resource.getrusage(resource.RUSAGE_SELF)
    os.replace(job["out"] + ".partial.exr", job["out"])
    return {
        "wall_s": wall_s,
        "cpu_s": cpu.ru_utime + cpu.ru_stime - cpu_before.ru_utime - cpu_before.ru_stime,
        "peak_mb": cpu.ru_maxrss / 1024,
        "load": [load_before, os.getloadavg()[0]],
    }


def main():
    with open(sys.argv[sys.argv.index("--") + 1]) as file:
        spec = json.load(file)
    started = time.perf_counter()
    scene, normal_rms_rad = build(spec)
    build_s = time.perf_counter() - started
    # The first render hands the mesh to Cycles and builds its acceleration structure.
    first = dict(spec["jobs"][0], samples=1, border_px=None, out=spec["jobs"][0]["out"] + ".first.exr")
    start = render_job(scene, first, spec["unit_m"])
    os.remove(first["out"])
    placed = spec["jobs"][0]["inertial_from_camera"]
    for job in spec["jobs"]:
        if job["inertial_from_camera"] != placed:
            # Cycles builds its acceleration structure again where a body has turned: not timed.
            render_job(scene, dict(first, inertial_from_camera=job["inertial_from_camera"]), spec["unit_m"])
            os.remove(first["out"])
            placed = job["inertial_from_camera"]
        result = render_job(scene, job, spec["unit_m"])
        result.update(
            blender=bpy.app.version_string,
            normal_rms_rad=normal_rms_rad,
            build_s=build_s,
            first_frame_s=start["wall_s"],
            job=job,
        )
        with open(job["out"] + ".json.partial", "w") as file:
            json.dump(result, file, indent=1)
        os.replace(job["out"] + ".json.partial", job["out"] + ".json")
        print("CYCLES-JOB %s %.2f s" % (os.path.basename(job["out"]), result["wall_s"]), flush=True)


try:
    main()
except Exception:
    import traceback

    traceback.print_exc()
    sys.stderr.flush()
    os._exit(2)  # blender -b -P ends with 0 after an exception
