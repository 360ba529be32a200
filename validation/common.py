"""What the validation programs share: the mesh, poses, scene files, EXR reading, running `retina`."""

import json
import os
import shutil
import struct
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import OpenEXR

ROOT = Path(__file__).resolve().parent.parent
RETINA = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release" / "retina"
MOON = ROOT / "assets/bodies/moon.glb"
MOON_RADIUS_M = 1_737_400.0
AU_M = 149_597_870_700.0
SUN_RADIUS_M = 6.957e8
# K_f of assets/setups/narrow-fov.toml: n_v / (2 tan(alpha_v / 2)) = n_v * focal / (rows * pitch).
NARROW_FOCAL_PX = 1200.0 * 50.0 / (1536.0 * 3.45e-3)


def say(*words):
    print(*words, file=sys.stderr, flush=True)


def fail(message):
    say("error:", message)
    sys.exit(2)


def write_json(path, value):
    partial = Path(str(path) + ".partial")
    partial.write_text(json.dumps(value, indent=1) + "\n")
    partial.replace(path)


def write_if_changed(path, text):
    """Leaves an equal file alone, so that outputs made from it stay valid."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)


# --- bodies -----------------------------------------------------------------------------------


class Glb:
    """A .glb with one mesh, no node transforms and embedded images: what `retina body` writes."""

    COMPONENTS = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
    WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}

    def __init__(self, path):
        data = Path(path).read_bytes()
        magic, version, _ = struct.unpack_from("<4sII", data)
        if magic != b"glTF" or version != 2:
            fail(f"{path}: not a binary glTF 2.0 file")
        length, _ = struct.unpack_from("<II", data, 12)
        self.document = json.loads(data[20 : 20 + length])
        self.binary = data[20 + length + 8 :]
        nodes = self.document["nodes"]
        if len(self.document["meshes"]) != 1 or any(
            key in node for node in nodes for key in ("matrix", "rotation", "scale", "translation")
        ):
            fail(f"{path}: the benchmark reads files of one mesh without node transforms")

    def view(self, index):
        view = self.document["bufferViews"][index]
        start = view.get("byteOffset", 0)
        return self.binary[start : start + view["byteLength"]]

    def accessor(self, index):
        entry = self.document["accessors"][index]
        dtype = np.dtype(self.COMPONENTS[entry["componentType"]])
        width = self.WIDTHS[entry["type"]]
        view = self.document["bufferViews"][entry["bufferView"]]
        row = width * dtype.itemsize
        stride = view.get("byteStride", row)
        raw = np.frombuffer(self.view(entry["bufferView"]), dtype=np.uint8)[entry.get("byteOffset", 0) :]
        rows = np.lib.stride_tricks.as_strided(raw, (entry["count"], row), (stride, 1))
        values = np.ascontiguousarray(rows).view(dtype).reshape(entry["count"], width)
        if entry.get("normalized"):
            values = values.astype(np.float64) / np.iinfo(dtype).max
        return values[:, 0] if width == 1 else values

    def write_without_textures(self, path):
        document = json.loads(json.dumps(self.document))
        for material in document["materials"]:
            material["pbrMetallicRoughness"].pop("baseColorTexture", None)
        for key in ("images", "textures", "samplers"):
            document.pop(key, None)
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        binary = self.binary + b"\0" * (-len(self.binary) % 4)
        total = 12 + 8 + len(text) + 8 + len(binary)
        Path(path).write_bytes(
            struct.pack("<4sIIII", b"glTF", 2, total, len(text), 0x4E4F534A)
            + text
            + struct.pack("<II", len(binary), 0x004E4942)
            + binary
        )


def welded_mesh(glb):
    """One mesh of all primitives, vertices welded where their positions are equal bit by bit.

    Vertex normals are weighted with each triangle's area and its angle at the vertex. Returns
    positions, triangles, surface (primitive) of each triangle, uv of each corner, normals.
    """
    positions, triangles, surface, corner_uv, first = [], [], [], [], 0
    for k, primitive in enumerate(glb.document["meshes"][0]["primitives"]):
        at = glb.accessor(primitive["attributes"]["POSITION"]).astype(np.float64)
        index = glb.accessor(primitive["indices"]).astype(np.int64).reshape(-1, 3)
        uv_accessor = primitive["attributes"].get("TEXCOORD_0")
        uv = np.zeros((len(at), 2)) if uv_accessor is None else glb.accessor(uv_accessor)
        positions.append(at)
        triangles.append(index + first)
        surface.append(np.full(len(index), k))
        corner_uv.append(uv[index])
        first += len(at)
    positions, triangles = np.concatenate(positions) + 0.0, np.concatenate(triangles)
    unique, inverse = np.unique(positions, axis=0, return_inverse=True)
    triangles = inverse.reshape(-1)[triangles]
    corners = unique[triangles]
    doubled_area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(unique)
    for k in range(3):
        onward = corners[:, (k + 1) % 3] - corners[:, k]
        backward = corners[:, (k + 2) % 3] - corners[:, k]
        sine = np.linalg.norm(np.cross(onward, backward), axis=1)
        angle = np.arctan2(sine, (onward * backward).sum(axis=1))
        for axis in range(3):
            weights = doubled_area[:, axis] * angle
            normals[:, axis] += np.bincount(triangles[:, k], weights, minlength=len(unique))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return {
        "positions": unique,
        "triangles": triangles,
        "surface": np.concatenate(surface),
        "corner_uv": np.concatenate(corner_uv),
        "normals": normals,
    }


def srgb_to_linear(encoded):
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def bilinear_clamped(image, uv):
    height, width = image.shape
    x, y = uv[..., 0] * width - 0.5, uv[..., 1] * height - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = x - x0, y - y0
    x1, y1 = np.clip(x0 + 1, 0, width - 1), np.clip(y0 + 1, 0, height - 1)
    x0, y0 = np.clip(x0, 0, width - 1), np.clip(y0, 0, height - 1)
    top = image[y0, x0] * (1 - fx) + image[y0, x1] * fx
    bottom = image[y1, x0] * (1 - fx) + image[y1, x1] * fx
    return top * (1 - fy) + bottom * fy


def area_mean(mesh, images, cuts=4):
    """Area-weighted mean over the surface of the textures, cuts^2 samples a triangle."""
    corners = mesh["positions"][mesh["triangles"]]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    total = 0.0
    for k, image in enumerate(images):
        own = mesh["surface"] == k
        uv, count = mesh["corner_uv"][own], 0
        along, across = (uv[:, 1] - uv[:, 0]) / cuts, (uv[:, 2] - uv[:, 0]) / cuts
        mean = np.zeros(len(uv))
        for j in range(cuts):
            for i in range(cuts - j):
                corner = uv[:, 0] + along * i + across * j
                mean += bilinear_clamped(image, corner + (along + across) / 3)
                count += 1
                if i + j + 1 < cuts:
                    mean += bilinear_clamped(image, corner + (along + across) * 2 / 3)
                    count += 1
        total += (mean / count * area[own]).sum()
    return total / area.sum()


# --- poses ------------------------------------------------------------------------------------


def unit(vector):
    return np.asarray(vector, float) / np.linalg.norm(vector)


def pose(longitude_deg, latitude_deg, distance_m, phase_deg, roll_deg=0.0, offset=(0.0, 0.0)):
    """A camera above a point of a body at the origin, and the Sun at 1 au and a phase angle.

    `offset` is the line of sight (x, y) on which the body's centre lies. The Sun stands towards
    the camera's -x side, 20 degrees away from the x axis.
    """
    longitude, latitude = np.radians([longitude_deg, latitude_deg])
    outward = np.array(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )
    east = unit(np.cross([0.0, 0.0, 1.0], outward))
    north = np.cross(outward, east)
    roll = np.radians(roll_deg)
    right = np.cos(roll) * east + np.sin(roll) * north
    down = np.cross(-outward, right)
    facing = np.stack([right, down, -outward])  # rows: axes of a camera that looks at the centre
    # Turned so that the body's centre, seen by `facing` on (0, 0, 1), lies on `offset`.
    ahead = unit([offset[0], offset[1], 1.0])
    axis = np.cross([0.0, 0.0, 1.0], ahead)
    skew = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + skew + skew @ skew / (1.0 + ahead[2])
    camera_from_inertial = turn @ facing
    phase, tilt = np.radians(phase_deg), np.radians(20.0)
    aside = -np.cos(tilt) * right - np.sin(tilt) * down
    sun = np.cos(phase) * outward + np.sin(phase) * aside
    return {
        "camera_m": outward * distance_m,
        "camera_from_inertial": camera_from_inertial,
        "sun_direction": sun,
        "phase_deg": phase_deg,
    }


def quaternion(matrix):
    """Scalar first, of v' = M v."""
    w = np.sqrt(max(0.0, 1.0 + np.trace(matrix))) / 2
    x, y, z = (np.sqrt(max(0.0, 1.0 + 2 * matrix[k, k] - np.trace(matrix))) / 2 for k in range(3))
    candidates = np.array([w, x, y, z])
    best = int(np.argmax(candidates))
    m = matrix
    columns = {
        0: [4 * w * w, m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
        1: [m[2, 1] - m[1, 2], 4 * x * x, m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
        2: [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], 4 * y * y, m[1, 2] + m[2, 1]],
        3: [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], 4 * z * z],
    }
    return unit(columns[best])


def write_scene(folder, model, poses, size_px, photometry, output, shading="smooth"):
    """setup.toml, poses.csv and scene.toml of a body at the origin; returns the scene's path."""
    folder.mkdir(parents=True, exist_ok=True)
    width, height = size_px
    setup = f"""schema = "retina.setup/1"
name = "validation"
[screen]
width_px = {width}
height_px = {height}
width_mm = 18.7
height_mm = 11.75
bits = 8
[camera]
width_px = 2048
height_px = 1536
pixel_um = 3.45
focal_mm = 50.0
f_number = 2.8
bits = 12
[facility]
intrinsics = {{ fx_px = {NARROW_FOCAL_PX!r}, fy_px = {NARROW_FOCAL_PX!r}, cx_px = {width / 2}, cy_px = {height / 2} }}
"""
    columns = "time_s camera_x_m camera_y_m camera_z_m camera_from_inertial_w camera_from_inertial_x "
    columns += "camera_from_inertial_y camera_from_inertial_z sun_x_m sun_y_m sun_z_m"
    rows = [",".join(columns.split())]
    for k, at in enumerate(poses):
        values = [300.0 * k, *at["camera_m"], *quaternion(at["camera_from_inertial"])]
        values += list(at["sun_direction"] * AU_M)
        rows.append(",".join(repr(float(v)) for v in values))
    scene = f"""schema = "retina.scene/1"
setup = "setup.toml"
trajectory = "poses.csv"
radiance_scale = 1e-3
[compensation]
mode = "none"
[[body]]
name = "moon"
model = "{os.path.relpath(model, folder)}"
shading = "{shading}"
reference_radius_m = {MOON_RADIUS_M!r}
photometry = {photometry}
[output]
{output}
"""
    write_if_changed(folder / "setup.toml", setup)
    write_if_changed(folder / "poses.csv", "\n".join(rows) + "\n")
    write_if_changed(folder / "scene.toml", scene)
    return folder / "scene.toml"


# --- running and reading ----------------------------------------------------------------------


def require_retina():
    if not RETINA.exists():
        fail(f"{RETINA} is missing: cargo build --release -p retina-cli")


def run_retina(arguments, log):
    """Runs `retina`; returns wall and CPU seconds, peak memory, and the load before and after."""
    command = [str(RETINA), *map(str, arguments)]
    load = os.getloadavg()[0]
    started_at, started = time.time(), time.perf_counter()
    with open(log, "w") as out:
        process = subprocess.Popen(command, stdout=out, stderr=subprocess.STDOUT)
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = code = os.waitstatus_to_exitcode(status)
    wall_s = time.perf_counter() - started
    if code != 0:
        fail(f"{' '.join(command)} ended with {code}:\n{Path(log).read_text()[-3000:]}")
    return {
        "started_at": started_at,
        "wall_s": wall_s,
        "cpu_s": usage.ru_utime + usage.ru_stime,
        "peak_mb": usage.ru_maxrss / 1024,
        "load": [load, os.getloadavg()[0]],
    }


def read_exr(path):
    """Channels by name, float32 arrays of height x width."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(channel.pixels) for name, channel in file.channels().items()}


def blender_env():
    """The environment for Blender: it looks for its Python's libraries beside the first `python3` of PATH, which pyenv or
    a virtual environment may have put there."""
    blender = shutil.which("blender")
    before = [str(Path(blender).resolve().parent)] if blender else []
    return dict(os.environ, PATH=os.pathsep.join([*before, os.environ.get("PATH", os.defpath)]))
