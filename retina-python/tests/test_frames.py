"""Frames against the command's files, and radiance against closed forms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retina
from conftest import ALBEDO, RADIUS_M, STAR_SCENE, assert_same

#: The Sun's spectral irradiance at 550 nm and 1 AU, W m^-2 nm^-1.
SUN_W_M2_NM = 1.856


def test_a_lambert_sphere_has_its_closed_form(lambert_frame: retina.Frame) -> None:
    factor, mask, depth = (lambert_frame.layers[name] for name in ("IF", "mask", "depth"))
    height, width = factor.shape
    pinhole = retina.Setup("narrow-fov").facility_pinhole
    # I/F = a cos i; at full phase and this distance the incidence is asin(rho / R) but for 0.03 rad.
    middle = factor[height // 2, width // 2]
    assert middle == pytest.approx(ALBEDO, rel=2e-3)
    assert lambert_frame.radiance[height // 2, width // 2] == pytest.approx(ALBEDO * SUN_W_M2_NM / np.pi, rel=2e-3)
    # A disc's angular area, of sin(theta) = R / d.
    tan = RADIUS_M / np.sqrt(4e7**2 - RADIUS_M**2)
    assert mask.sum() == pytest.approx(np.pi * tan**2 * pinhole.fx_px * pinhole.fy_px, rel=2e-3)
    assert depth[height // 2, width // 2] == pytest.approx(4e7 - RADIUS_M, rel=1e-5)
    assert np.isinf(depth[0, 0])


def test_a_pinhole_is_its_matrix() -> None:
    pinhole = retina.Setup("narrow-fov").facility_pinhole
    sight = np.array([[0.01, -0.02], [0.03, 0.0]])
    through = np.column_stack([sight, np.ones(2)]) @ pinhole.matrix.T
    assert pinhole.pixel(sight) == pytest.approx(through[:, :2])
    assert pinhole.line_of_sight(through[:, :2]) == pytest.approx(sight)
    # Eq. 13: 1200 rows span the camera's 1536 rows of 3.45 um behind 50 mm.
    assert pinhole.fy_px == pytest.approx(1200 / (1536 * 3.45e-3 / 50.0))


def test_counts_follow_the_display(lambert_frame: retina.Frame) -> None:
    setup = retina.Setup("narrow-fov")
    counts, radiance = lambert_frame.counts.ravel(), lambert_frame.radiance.ravel().astype(float)
    levels = range(60, 240, 20)
    mean = np.array([radiance[counts == level].mean() for level in levels])
    ratio = mean / (np.array(levels) / 255.0) ** setup.response_gamma
    # The mean over a level is that of its middle but for the curvature within it.
    assert np.abs(ratio / np.median(ratio) - 1).max() < 0.01
    assert lambert_frame.counts.max() in (254, 255) and lambert_frame.saturated_px == 0


def test_a_pose_turns_the_camera(renderer: retina.Renderer) -> None:
    angle = np.radians(1.0)
    # A camera turned about its y axis by +1 deg sees what was ahead 1 deg to the left.
    frame = renderer.render(
        [np.cos(angle / 2), 0.0, -np.sin(angle / 2), 0.0], [0, 0, -4e7], sun_position_m=[0, 0, -1.5e11]
    )
    center = frame.truth["bodies"]["ball"]["center_px"]
    pinhole = retina.Setup("narrow-fov").facility_pinhole
    assert center == pytest.approx([pinhole.cx_px - pinhole.fx_px * np.tan(angle), pinhole.cy_px], abs=1e-6)
    y, x = np.nonzero(frame.layers["mask"] > 0.5)
    assert np.mean(x) + 0.5 == pytest.approx(center[0], abs=0.2)
    moved = renderer.render(
        camera_position_m=[0, 0, 0], bodies={"ball": {"position_m": [0, 0, 4e7]}}, sun_position_m=[0, 0, -1.5e11]
    )
    assert moved.truth["bodies"]["ball"]["position_camera_m"] == pytest.approx([0, 0, 4e7])


def test_what_cannot_be_rendered_is_refused(renderer: retina.Renderer) -> None:
    with pytest.raises(retina.RetinaError, match="the camera is inside"):
        renderer.render(camera_position_m=[0, 0, 0.1], sun_position_m=[0, 0, 1.5e11])
    with pytest.raises(retina.RetinaError, match="where the Sun is"):
        renderer.render(camera_position_m=[0, 0, -4e7])
    with pytest.raises(retina.RetinaError, match="no body of this renderer"):
        renderer.render(bodies={"moon": {}}, sun_position_m=[0, 0, 1.5e11])
    with pytest.raises(retina.RetinaError, match="is no rotation"):
        renderer.render([0, 0, 0, 0], sun_position_m=[0, 0, 1.5e11])
    with pytest.raises(retina.RetinaError, match="backend"):
        retina.Renderer("narrow-fov", {}, backend="paper")  # type: ignore[arg-type]
    with pytest.raises(retina.RetinaError, match="no such layer"):
        retina.Scene(STAR_SCENE, layers=["colour"])


def scene_file(folder: Path, sphere: Path, setup_file: Path) -> Path:
    path = folder / "scene.toml"
    poses = folder / "poses.csv"
    poses.write_text(
        "time_s,camera_x_m,camera_y_m,camera_z_m,camera_from_inertial_w,camera_from_inertial_x,camera_from_inertial_y,"
        "camera_from_inertial_z,sun_x_m,sun_y_m,sun_z_m\n"
        "0,0,0,-3e7,1,0,0,0,1e11,0,-1e11\n60,0,0,-2.9e7,1,0,0,0,1e11,2e10,-1e11\n120,1e5,0,-2.8e7,1,0,0,0,1e11,0,-1e11\n"
    )
    path.write_text(
        f'schema = "retina.scene/1"\nsetup = "{setup_file}"\ntrajectory = "poses.csv"\n[[body]]\nname = "ball"\n'
        f'model = "{sphere}"\nshading = "smooth"\nphotometry = {{ model = "lommel-seeliger", normal_albedo = 0.1 }}\n'
    )
    return path


def test_frames_are_those_of_the_command(sphere: Path, setup_file: Path, command: Any, tmp_path: Path) -> None:
    path = scene_file(tmp_path, sphere, setup_file)
    told = command("render", path, "--out", tmp_path / "out", "--backend", "native")
    scene = retina.Scene(path, backend="native")
    assert len(scene) == told["frames_done"] == 3
    assert scene.radiance_scale == told["radiance_scale"]
    assert list(scene.time_s) == [0.0, 60.0, 120.0] == list(scene.et)
    for frame in scene:
        assert frame.png() == (tmp_path / "out" / "frames" / f"{frame.index:06}.png").read_bytes()
        assert_same(frame.truth, json.loads((tmp_path / "out" / "truth" / f"{frame.index:06}.json").read_text()), 0)
        assert frame.counts.dtype == np.uint8 and frame.radiance.dtype == np.float32
        assert frame.counts.flags.c_contiguous and frame.layers == {}


def test_a_scene_is_a_sequence(star_scene: retina.Scene) -> None:
    assert [frame.index for frame in star_scene] == [0, 1, 2]
    assert star_scene[-1].index == 2 and [frame.index for frame in star_scene[::2]] == [0, 2]
    with pytest.raises(IndexError):
        star_scene[3]
    assert star_scene.size_px == (1920, 1200) and star_scene[0].radiance.max() == 0.0
    assert np.asarray(star_scene[0]).shape == (1200, 1920)


def test_a_trajectory_is_a_table(ball: dict[str, Any]) -> None:
    table = {"time_s": [0.0, 10.0], "camera_x_m": [0, 0], "camera_y_m": [0, 0], "camera_z_m": [-4e7, -3e7]}
    table |= {f"camera_from_inertial_{axis}": [float(axis == "w")] * 2 for axis in "wxyz"}
    table |= {"sun_x_m": [0, 0], "sun_y_m": [0, 0], "sun_z_m": [-1.5e11, -1.5e11]}
    document = {"setup": retina.Setup("narrow-fov"), "trajectory": table, "body": [{"name": "ball", **ball}]}
    scene = retina.Scene(document, layers=["mask"], backend="native", radiance_scale=0.01)
    near, far = scene[1], scene[0]
    assert near.layers["mask"].sum() / far.layers["mask"].sum() == pytest.approx((4 / 3) ** 2, rel=3e-3)
    assert far.radiance_scale == 0.01
    with pytest.raises(retina.RetinaError) as caught:
        retina.Scene({**document, "trajectory": {k: v for k, v in table.items() if k != "camera_z_m"}})
    assert "camera_z_m" in str(caught.value)
