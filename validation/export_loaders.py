"""Reads exported data sets with the loaders of others, and holds what they give to the frames' own truth.

    validation/export_loaders.py [WORK]

pycocotools, webdataset, astropy and OpenCV (requirements-export.txt). SPEED+ and BOP have no loader on PyPI: poses are
projected by OpenCV, whose conventions both state, and compared with the rendered silhouettes.
"""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import webdataset
from astropy.io import fits
from astropy.wcs import WCS
from pycocotools.coco import COCO

ROOT = Path(__file__).resolve().parent.parent
RETINA = Path(os.environ.get("CARGO_TARGET_DIR") or ROOT / "target") / "release" / "retina"
FRAMES = 12


def retina(*words):
    subprocess.run([str(RETINA), *map(str, words)], check=True, capture_output=True)


def prepared(work):
    text = (ROOT / "assets/scenarios/lumio.toml").read_text().replace("../", f"{ROOT}/assets/")
    text = text.replace("frames = 4321, step_s = 300.0", f"frames = {FRAMES}, step_s = {4320 * 300 / (FRAMES - 1)!r}")
    # A pinhole camera: the labels are of one.
    text = text.replace('mode = "direct"', 'mode = "none"') + '\n[output]\nlayers = ["mask"]\n'
    (work / "scene.toml").write_text(text)
    frames = work / "frames"
    if not frames.exists():
        retina("render", work / "scene.toml", "--quality", "draft", "--out", frames)
    for kind in ("speedplus", "bop", "webdataset", "coco", "fits"):
        if not (work / kind).exists():
            retina("export", frames, "--format", kind, "--out", work / kind, "--licence", "CC-BY-4.0")
    return frames


def truth(frames, index):
    return json.loads((frames / f"truth/{index:06}.json").read_text())


def matrix(q):
    """The active rotation of a unit quaternion, scalar first."""
    w, x, y, z = q
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def limb(rotation, position, radius):
    """Points of a sphere's limb in the body's axes."""
    towards = -rotation.T @ position
    distance = np.linalg.norm(towards)
    axis = towards / distance
    one = np.cross(axis, [0, 0, 1.0])
    one /= np.linalg.norm(one)
    two = np.cross(axis, one)
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    height, ring = radius**2 / distance, radius * np.sqrt(1 - (radius / distance) ** 2)
    return height * axis + ring * (np.cos(angle)[:, None] * one + np.sin(angle)[:, None] * two)


def overlap(projected, mask, half):
    """Intersection over union of a limb's polygon and a mask. `half` is where the first pixel's centre is."""
    drawn = np.zeros(mask.shape, np.uint8)
    # OpenCV's polygons have the first pixel's centre at 0, in sixteenths of a pixel here.
    cv2.fillPoly(drawn, [np.round((projected - half) * 16).astype(np.int32)], 1, shift=4)
    mask = mask > 127
    return (drawn.astype(bool) & mask).sum() / (drawn.astype(bool) | mask).sum()


def speedplus(work, frames):
    folder = work / "speedplus"
    camera = json.loads((folder / "camera.json").read_text())
    k, distortion = np.array(camera["cameraMatrix"]), np.array(camera["distCoeffs"])
    worst, count = 1.0, 0
    for part in ("train", "validation"):
        for label in json.loads((folder / f"synthetic/{part}.json").read_text()):
            own = truth(frames, int(label["filename"][3:9]))["bodies"]["moon"]
            rotation, position = matrix(label["q_vbs2tango_true"]), np.array(label["r_Vo2To_vbs_true"])
            points = limb(rotation, position, own["reference_radius_m"])
            seen, _ = cv2.projectPoints(points, cv2.Rodrigues(rotation)[0], position, k, distortion)
            mask = cv2.imread(str(folder / "synthetic/masks" / label["filename"]), cv2.IMREAD_GRAYSCALE)
            image = cv2.imread(str(folder / "synthetic/images" / label["filename"]), cv2.IMREAD_GRAYSCALE)
            assert image.shape == (camera["Nv"], camera["Nu"]) == mask.shape
            worst, count = min(worst, overlap(seen[:, 0], mask, 0.5)), count + 1
    return f"{count} poses; limb over mask at least {worst:.4f}"


def bop(work, frames):
    worst, count, box = 1.0, 0, 0.0
    for part in ("train", "val"):
        for scene in sorted((work / "bop" / part).iterdir()):
            cameras, poses, infos = (json.loads((scene / f"scene_{name}.json").read_text()) for name in ("camera", "gt", "gt_info"))
            for number, entries in poses.items():
                k = np.array(cameras[number]["cam_K"]).reshape(3, 3)
                for at, (entry, info) in enumerate(zip(entries, infos[number])):
                    rotation = np.array(entry["cam_R_m2c"]).reshape(3, 3)
                    position = np.array(entry["cam_t_m2c"])
                    radius = truth(frames, int(number))["bodies"]["moon"]["reference_radius_m"] * 1000
                    seen, _ = cv2.projectPoints(limb(rotation, position, radius), cv2.Rodrigues(rotation)[0], position, k, None)
                    mask = cv2.imread(str(scene / f"mask/{int(number):06}_{at:06}.png"), cv2.IMREAD_GRAYSCALE)
                    worst, count = min(worst, overlap(seen[:, 0], mask, 0.0)), count + 1
                    low, high = seen[:, 0].min(0), seen[:, 0].max(0)
                    box = max(box, np.abs(np.array(info["bbox_obj"]) - np.concatenate([low, high - low])).max())
                    assert info["px_count_all"] == (mask > 127).sum()
    return f"{count} poses; limb over mask at least {worst:.4f}; boxes to {box:.3f} px"


def coco(work, frames):
    worst, count, points = 1.0, 0, 0.0
    for part in ("train", "val"):
        data = COCO(work / f"coco/annotations/instances_{part}.json")
        for image in data.loadImgs(data.getImgIds()):
            own = truth(frames, image["id"] - 1)
            for entry in data.loadAnns(data.getAnnIds(imgIds=image["id"])):
                mask = data.annToMask(entry)
                assert mask.shape == (image["height"], image["width"]) and mask.sum() == entry["area"]
                x, y, width, height = entry["bbox"]
                rows, columns = np.nonzero(mask)
                assert (columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1) == (x, y, width, height)
                ellipse = own["bodies"]["moon"]["limb_ellipse_px"]
                a, b = ellipse["semi_axes_px"]
                worst = min(worst, 1 - abs(mask.sum() / (np.pi * a * b) - 1))
                centre = np.array(entry["keypoints"]).reshape(-1, 3)[0]
                points = max(points, np.abs(centre[:2] - own["bodies"]["moon"]["center_px"]).max())
                count += 1
    return f"{count} instances; area of the ellipse to {1 - worst:.4f}; centres to {points:.1e} px"


def web(work, frames):
    count = 0
    for part in ("train", "val"):
        for sample in webdataset.WebDataset(str(work / f"webdataset/{part}-000000.tar"), shardshuffle=False).decode("rgb8"):
            own = truth(frames, int(sample["__key__"]))
            assert sample["json"]["time_s"] == own["time_s"]
            png = cv2.imread(str(frames / f"frames/{sample['__key__']}.png"))[:, :, ::-1]
            assert (sample["png"] == png).all()
            assert (sample["moon.mask.png"][:, :, 0] > 127).sum() == sample["json"]["bodies_px"]["moon"]["area"]
            count += 1
    return f"{count} samples, pixels and truth equal"


def world(work, frames):
    worst, count = 0.0, 0
    for path in sorted((work / "fits").glob("*.fits")):
        with fits.open(path) as file:
            file.verify("exception")
            header, data = file[0].header, file[0].data
        own = truth(frames, int(path.stem))
        image = own["image_px"]
        assert data.shape == (image["height"], image["width"])
        inertial_from_camera = matrix(own["camera_from_inertial"]).T
        for x, y in ((0.5, 0.5), (image["width"] - 0.5, 0.5), (300.0, 900.0)):
            seen = inertial_from_camera @ [(x - image["cx"]) / image["fx"], (y - image["cy"]) / image["fy"], 1]
            ra, dec = WCS(header).all_pix2world(x - 0.5, y - 0.5, 0)
            sky = [np.cos(np.radians(dec)) * np.cos(np.radians(ra)), np.cos(np.radians(dec)) * np.sin(np.radians(ra)), np.sin(np.radians(dec))]
            worst = max(worst, np.linalg.norm(np.cross(seen / np.linalg.norm(seen), sky)))
        count += 1
    return f"{count} files; lines of sight to {np.degrees(worst) * 3600:.1e} arcsec"


def main():
    with tempfile.TemporaryDirectory() as temporary:
        work = Path(sys.argv[1] if len(sys.argv) > 1 else temporary).resolve()
        work.mkdir(parents=True, exist_ok=True)
        frames = prepared(work)
        for name, check in (("speedplus", speedplus), ("bop", bop), ("coco", coco), ("webdataset", web), ("fits", world)):
            print(f"| {name} | {check(work, frames)} |", flush=True)


if __name__ == "__main__":
    main()
