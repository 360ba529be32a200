"""What the tests share: the command, a star frame, a Moon, and tables whose truth is known."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retina

#: The repository, for the files that are no part of the wheel.
ROOT = Path(__file__).resolve().parents[2]
MOON = ROOT / "assets" / "bodies" / "moon.glb"


def command_path() -> str:
    """The command that the wheel installed beside the interpreter."""
    return str(Path(sys.executable).parent / "retina")


@pytest.fixture(scope="session")
def command() -> Any:
    """Runs ``retina`` with ``--json`` and gives its document."""

    def run(*arguments: object, code: int = 0) -> dict[str, Any]:
        texts = [os.fspath(a) if isinstance(a, os.PathLike) else str(a) for a in arguments]
        done = subprocess.run([command_path(), *texts, "--json"], capture_output=True, text=True, check=False)
        assert done.returncode == code, done.stderr
        return json.loads(done.stdout) if done.stdout else {}

    return run


STAR_SCENE = {
    "setup": "wide-fov",
    "trajectory": {"kind": "deep-space", "frames": 3, "seed": 4},
    "stars": {"faintest_magnitude": 7.0},
}


@pytest.fixture(scope="session")
def star_scene() -> retina.Scene:
    return retina.Scene(STAR_SCENE)


@pytest.fixture(scope="session")
def star_frame(star_scene: retina.Scene) -> retina.Frame:
    return star_scene[0]


@pytest.fixture(scope="session")
def star_field_deg() -> float:
    """Horizontal field of the screen as K_f shows it."""
    pinhole = retina.Setup("wide-fov").facility_pinhole
    return float(np.degrees(2 * np.arctan(0.5 * pinhole.width_px / pinhole.fx_px)))


def sphere_obj(radius_m: float, rings: int = 60, arms: int = 120) -> str:
    """A sphere as Wavefront OBJ."""
    lines = []
    for i in range(rings + 1):
        for j in range(arms):
            polar, azimuth = np.pi * i / rings, 2 * np.pi * j / arms
            ring = radius_m * np.sin(polar)
            lines.append(f"v {ring * np.cos(azimuth)} {ring * np.sin(azimuth)} {radius_m * np.cos(polar)}")
    for i in range(rings):
        for j in range(arms):
            a, b = arms * i + j + 1, arms * i + (j + 1) % arms + 1
            if i > 0:
                lines.append(f"f {a} {a + arms} {b}")
            if i < rings - 1:
                lines.append(f"f {b} {a + arms} {b + arms}")
    return "\n".join(lines) + "\n"


RADIUS_M = 1.0e6
ALBEDO = 0.2


@pytest.fixture(scope="session")
def sphere(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bodies") / "sphere.obj"
    path.write_text(sphere_obj(RADIUS_M))
    return path


@pytest.fixture(scope="session")
def ball(sphere: Path) -> dict[str, Any]:
    """A Lambert sphere, as a scene and a renderer take a body."""
    photometry = {"model": "lambert", "normal_albedo": ALBEDO}
    return {"model": str(sphere), "shading": "smooth", "photometry": photometry, "reference_radius_m": RADIUS_M}


@pytest.fixture(scope="session")
def renderer(ball: dict[str, Any]) -> retina.Renderer:
    return retina.Renderer("narrow-fov", {"ball": ball}, layers=["mask", "depth"], backend="native")


@pytest.fixture(scope="session")
def lambert_frame(renderer: retina.Renderer) -> retina.Frame:
    """The sphere 4e7 m away, the Sun behind the camera at one astronomical unit."""
    return renderer.render(camera_position_m=[0, 0, -4e7], sun_position_m=[0, 0, -1.495978707e11])


def warming_points(exposures: int = 30, points: int = 40, px_per_k: float = 0.15) -> dict[str, Any]:
    """Points of the wide setup whose centroids move along x with the temperature, by numpy alone."""
    setup = retina.Setup("wide-fov")
    rng = np.random.default_rng(7)
    seen = rng.uniform((0, 0), setup.camera_size_px, (exposures, points, 2)) * 0.9 + 100
    shown = setup.facility_pinhole.pixel(setup.camera_pinhole.line_of_sight(seen))
    time_s = 60.0 * np.arange(exposures)
    # In no order, so that nothing that changes in time is like it.
    temperature_c = 20.0 + rng.uniform(-2.0, 2.0, exposures)
    moved = seen + rng.normal(0.0, 0.05, seen.shape)
    moved[..., 0] += px_per_k * (temperature_c[:, None] - 20.0)
    row = {"image": np.repeat([f"{k:03}" for k in range(exposures)], points)}
    row |= {"screen_x_px": shown[..., 0].ravel(), "screen_y_px": shown[..., 1].ravel()}
    row |= {"digital_count": np.full(exposures * points, 200), "camera_x_px": moved[..., 0].ravel()}
    row |= {"camera_y_px": moved[..., 1].ravel(), "time_s": np.repeat(time_s, points)}
    return row | {"temperature_c": np.repeat(temperature_c, points)}


@pytest.fixture(scope="session")
def warming() -> dict[str, Any]:
    return warming_points()


@pytest.fixture(scope="session")
def setup_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wide setup as a file without a calibration, for the command."""
    text = (ROOT / "assets" / "setups" / "wide-fov.toml").read_text().split("[calibration]")[0]
    path = tmp_path_factory.mktemp("setups") / "wide-fov.toml"
    path.write_text(text)
    return path


def csv_of(table: dict[str, Any], path: Path) -> Path:
    """A table of columns as a file, written by Python alone."""
    rows = zip(*table.values(), strict=True)
    path.write_text(",".join(table) + "\n" + "".join(",".join(str(cell) for cell in row) + "\n" for row in rows))
    return path


def assert_same(one: Any, other: Any, tolerance: float = 1e-12) -> None:
    """Two documents are the same, numbers to a relative tolerance."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key], tolerance)
    elif isinstance(one, list):
        assert len(one) == len(other)
        for a, b in zip(one, other, strict=True):
            assert_same(a, b, tolerance)
    elif isinstance(one, float) and isinstance(other, (int, float)):
        assert one == pytest.approx(other, rel=tolerance, abs=1e-300)
    else:
        assert one == other
