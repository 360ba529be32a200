"""How long `retina serve` takes to its first image and from image to image.

    python3 validation/serve_time.py [--retina target/release/retina] [--images N] [--runs N]

The shipped Moon (750 000 triangles), 1024 x 1024, a disc of 850 px, phase 60 deg, the Moon a little farther on in each
image. The first run finds an empty cache folder, the others what it left there. Needs nothing from PyPI.
"""

import argparse
import json
import math
import os
import pathlib
import socket
import struct
import subprocess
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parent.parent
RANGE_M = 4.1e7
RADIUS_M = 1.7374e6
AU_M = 1.495978707e11
FOCAL_PX = 425 / math.tan(math.asin(RADIUS_M / RANGE_M))

SETUP = f"""schema = "retina.setup/1"
name = "square"
[screen]
width_px = 1024
height_px = 1024
width_mm = 10.24
height_mm = 10.24
bits = 8
[camera]
width_px = 1024
height_px = 1024
pixel_um = 5.0
focal_mm = 50.0
f_number = 2.8
bits = 12
[facility]
intrinsics = {{ fx_px = {FOCAL_PX}, fy_px = {FOCAL_PX}, cx_px = 512.0, cy_px = 512.0 }}
[response]
gamma = 2.2
brightest_magnitude = -1.44
"""

SCENE = f"""schema = "retina.scene/1"
setup = "setup.toml"
trajectory = {{ kind = "lumio-halo", frames = 2, step_s = 300.0 }}
radiance_scale = 0.02
[[body]]
name = "moon"
model = "{ROOT}/assets/bodies/moon.glb"
shading = "smooth"
photometry = {{ model = "lunar-lambert", normal_albedo = 0.12 }}
"""


def datagram(image):
    """A pose: Sun, camera (Blender's, which looks along its -z) and body, big-endian."""
    phase = math.radians(60)
    sun = (AU_M * math.sin(phase), 0.0, -AU_M * math.cos(phase))
    camera = (1e4 * image, 0.0, -RANGE_M)
    values = (*sun, *camera, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
    return struct.pack(">17d", *values)


def read(client, count):
    parts = b""
    while len(parts) < count:
        part = client.recv(count - len(parts))
        if not part:
            raise SystemExit("the server has gone")
        parts += part
    return parts


def run(retina, folder, images):
    """Seconds until it is ready, until the first image, and the mean of the others."""
    command = [retina, "serve", str(folder / "scene.toml"), "--pose-port", "0", "--image-port", "0", "--json"]
    command += ["--frames", str(images), "--quiet"]
    start = time.monotonic()
    server = subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={**os.environ, "XDG_CACHE_HOME": str(folder / "cache")}
    )
    ready = json.loads(server.stdout.readline())
    ready_s = time.monotonic() - start
    address = {key: ready[key].rsplit(":", 1) for key in ("poses", "images")}
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    client = socket.create_connection((address["images"][0], int(address["images"][1])))
    times = []
    for image in range(images):
        sender.sendto(datagram(image), (address["poses"][0], int(address["poses"][1])))
        png = read(client, struct.unpack("<Q", read(client, 8))[0])
        if image == images - 1:
            (folder / "last.png").write_bytes(png)
        times.append(time.monotonic() - start)
    server.wait()
    return ready_s, times[0], (times[-1] - times[0]) / (images - 1)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--retina", default=str(ROOT / "target/release/retina"))
    parser.add_argument("--images", type=int, default=6)
    parser.add_argument("--runs", type=int, default=4)
    parser.add_argument("--keep", type=pathlib.Path, help="where the last image goes")
    options = parser.parse_args()
    if options.images < 2:
        parser.error("--images: at least two, to time what comes after the first")
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        (folder / "setup.toml").write_text(SETUP)
        (folder / "scene.toml").write_text(SCENE)
        print("| cache | ready, s | first image, s | each further, s |\n|---|---|---|---|")
        for number in range(options.runs):
            ready_s, first_s, further_s = run(options.retina, folder, options.images)
            print(f"| {'empty' if number == 0 else 'full'} | {ready_s:.2f} | {first_s:.2f} | {further_s:.2f} |")
        if options.keep:
            options.keep.write_bytes((folder / "last.png").read_bytes())


if __name__ == "__main__":
    main()
