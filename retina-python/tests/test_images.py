"""Points of light, stars and limbs against closed forms, truth and the command."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retina
from conftest import RADIUS_M, assert_same


def spots(dtype: type = np.uint16) -> tuple[np.ndarray, np.ndarray]:
    """An image of Gaussian spots on a noisy level, and their centres, by numpy alone."""
    rng = np.random.default_rng(3)
    grid = np.stack(np.meshgrid(np.arange(6), np.arange(4)), -1).reshape(-1, 2)
    centres = 40.0 + 70.0 * grid + rng.uniform(-5, 5, grid.shape)
    y, x = np.mgrid[0:340, 0:460] + 0.5
    image = rng.normal(100.0, 3.0, x.shape)
    for cx, cy in centres:
        image += 2000.0 * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / (2 * 1.3**2))
    return image.round().astype(dtype), centres


def matched(found: retina.Detection, centres: np.ndarray) -> np.ndarray:
    places = np.column_stack([found.x_px, found.y_px])
    return np.array([np.min(np.hypot(*(places - centre).T)) for centre in centres])


@pytest.mark.parametrize("dtype", [np.uint16, np.float32, np.float64, np.int32])
def test_spots_are_found_where_they_are(dtype: type) -> None:
    image, centres = spots(dtype)
    found = retina.detect(image)
    assert len(found) == len(centres)
    # The Cramer-Rao bound of a Gaussian spot is sigma_noise / (flux-weighted slope): some 0.002 px here.
    assert matched(found, centres).max() < 0.02
    assert found.background_dn == pytest.approx(100.0, abs=0.5) and found.noise_dn == pytest.approx(3.0, rel=0.1)
    assert found.spot_sigma_px == pytest.approx(1.3, rel=0.1)


def test_views_and_byte_orders_are_taken() -> None:
    image, centres = spots()
    flipped = retina.detect(image[::-1])
    assert matched(flipped, centres * (1, -1) + (0, image.shape[0])).max() < 0.02
    assert len(retina.detect(image.astype(">u2"))) == len(centres)
    assert len(retina.detect(np.asfortranarray(image))) == len(centres)


def test_a_mask_and_a_full_scale() -> None:
    image, centres = spots()
    mask = np.zeros(image.shape, bool)
    mask[:, :230] = True
    found = retina.detect(image, mask=mask)
    assert len(found) == np.sum(centres[:, 0] < 230)
    with pytest.raises(retina.RetinaError, match="image's size"):
        retina.detect(image, mask=mask[:10])
    with pytest.raises(retina.RetinaError, match="beyond the camera's digital numbers"):
        retina.detect(image, bits=8)
    assert not found.saturated.any()
    assert retina.detect(np.minimum(image, 1023), bits=10).saturated.all()


def test_stars_give_the_attitude_that_was_rendered(star_frame: retina.Frame, star_field_deg: float) -> None:
    solved = retina.solve_stars(star_frame.counts, fov_deg=(star_field_deg - 1, star_field_deg + 1))
    assert solved.solved and solved.matches > 50
    product = abs(float(solved.camera_from_inertial @ star_frame.camera_from_inertial))
    # A pixel is 36 arcsec here, and the display has whole counts.
    assert np.degrees(2 * np.arccos(min(1.0, product))) * 3600 < 40.0
    w, x, y, z = solved.camera_from_inertial
    boresight = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    ra, dec = np.radians([solved.ra_deg, solved.dec_deg])
    assert boresight == pytest.approx([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], abs=1e-9)
    assert solved.fov_deg[0] == pytest.approx(star_field_deg, rel=1e-3)
    assert len(solved.stars["id"]) == solved.matches == len(solved.stars["x_px"])
    assert solved.wcs_header().startswith(b"SIMPLE  =")


def test_stars_are_solved_as_the_command_does(
    star_frame: retina.Frame, star_field_deg: float, command: Any, tmp_path: Path
) -> None:
    from retina import _native

    file = tmp_path / "stars.png"
    file.write_bytes(_native.grey_png_bytes(star_frame.counts))
    told = command("navigate", "stars", file, "--fov-deg", f"{star_field_deg - 1}..{star_field_deg + 1}", "--stars")
    for image in (star_frame.counts, file, str(file)):
        mine = retina.solve_stars(image, (star_field_deg - 1, star_field_deg + 1)).to_dict()
        theirs = dict(told["images"][0])
        for times in (mine, theirs):
            for name in ("solve_ms", "detect_ms", "file", "notes"):
                times.pop(name)
        assert_same(mine, theirs)


def test_an_image_without_stars_is_refused_in_words() -> None:
    noise = np.random.default_rng(2).normal(100, 5, (300, 400))
    found = retina.solve_stars(noise, fov_deg=12)
    assert not found.solved and found.reason and found.message and "--" not in found.message
    assert np.isnan(found.ra_deg) and found.matches == 0 and np.isnan(found.camera_from_inertial).all()
    with pytest.raises(retina.RetinaError, match="coordinates"):
        found.wcs_header()


def camera_numbers(frame: retina.Frame) -> np.ndarray:
    """A frame's radiance as a camera of 12 bits would have it, with read noise."""
    noise = np.random.default_rng(5).normal(50.0, 3.0, frame.radiance.shape)
    return np.clip(frame.radiance * (3000.0 / frame.radiance.max()) + noise, 0, 4095).round().astype(np.uint16)


def test_a_limb_gives_range_and_direction(renderer: retina.Renderer) -> None:
    pinhole = retina.Setup("narrow-fov").facility_pinhole
    # With the Sun at the side the limb is bright; at full phase Lambert's law leaves it dark.
    image = camera_numbers(renderer.render(camera_position_m=[0, 0, -4e7], sun_position_m=[1.3e11, 0, -0.75e11]))
    found = retina.fit_limb(image, focal_mm=50.0, pixel_um=50e3 / pinhole.fx_px, body=RADIUS_M, focal_percent=0.0, bits=12)
    assert found.solved, found.message
    # A face's middle is 1 - cos(pi / 120) = 3.4e-4 of the radius inside the sphere, along each of its two sides.
    assert found.range_m == pytest.approx(4e7, rel=1e-3)
    assert found.center_px == pytest.approx([pinhole.cx_px, pinhole.cy_px], abs=0.05)
    assert found.line_of_sight == pytest.approx([0, 0, 1], abs=1e-5)
    assert found.points["used"].sum() > 100
    field = np.degrees(2 * np.arctan(0.5 * pinhole.width_px / pinhole.fx_px))
    again = retina.fit_limb(image, fov_deg=field, body=[RADIUS_M] * 3, focal_percent=0.0, bits=12)
    # The two fits stop a little apart.
    assert again.range_m == pytest.approx(found.range_m, rel=1e-6)


def test_a_limb_is_measured_as_the_command_does(lambert_frame: retina.Frame, command: Any, tmp_path: Path) -> None:
    from retina import _native

    image = (lambert_frame.radiance * (200.0 / lambert_frame.radiance.max())).round().astype(np.uint8)
    file = tmp_path / "ball.png"
    file.write_bytes(_native.grey_png_bytes(image))
    told = command("navigate", "limb", file, "--fov-deg", "9.5", "--radii-m", str(RADIUS_M))
    mine = retina.fit_limb(image, fov_deg=9.5, body=RADIUS_M).to_dict()
    for document in (told, mine):
        document.pop("file"), document.pop("notes")
    assert_same(mine, told)


def test_a_limb_with_a_mask_and_stars_is_measured_as_the_command_does(
    lambert_frame: retina.Frame, command: Any, tmp_path: Path
) -> None:
    from retina import _native

    image = (lambert_frame.radiance * (200.0 / lambert_frame.radiance.max())).round().astype(np.uint8)
    # A lamp beside the body.
    image[:40, :60] = 255
    mask = np.ones(image.shape, dtype=bool)
    mask[:50, :70] = False
    files = tmp_path / "ball.png", tmp_path / "mask.png"
    for file, values in zip(files, (image, mask.astype(np.uint8) * 255)):
        file.write_bytes(_native.grey_png_bytes(values))
    flags = ("--fov-deg", "9.5", "--radii-m", str(RADIUS_M), "--mask", files[1])
    found = retina.fit_limb(image, fov_deg=9.5, body=RADIUS_M, mask=mask)
    assert found.solved and np.isnan(found.camera_from_inertial).all()
    mine = found.to_dict(), retina.fit_limb(image, fov_deg=9.5, body=RADIUS_M, mask=mask, stars=True).to_dict()
    told = command("navigate", "limb", files[0], *flags), command("navigate", "limb", files[0], *flags, "--stars")
    for document in (*mine, *told):
        document.pop("file"), document.pop("notes")
        for name in ("file", "detect_ms", "solve_ms"):
            document.get("stars", {}).pop(name, None)
        # The command widens a mask from a file by some pixels.
        document.get("stars", {}).get("seen", {}).pop("masked_share", None)
    assert "stars" not in mine[0] and mine[1]["stars"]["solved"] is False
    for one, other in zip(mine, told):
        assert_same(one, other)


def test_a_silhouette_needs_an_attitude(lambert_frame: retina.Frame, tmp_path: Path) -> None:
    with pytest.raises(retina.RetinaError, match="attitude"):
        retina.fit_limb(np.zeros((200, 200), np.uint8), fov_deg=10, silhouette=tmp_path / "body.obj")
    with pytest.raises(retina.RetinaError, match="mask"):
        retina.fit_limb(np.zeros((200, 200), np.uint8), fov_deg=10, mask=np.ones((2, 2), bool))
    # An octahedron of one metre stands for the shape: its corners, and not a circle, are the outline.
    corners = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
    faces = [(1, 3, 5), (3, 2, 5), (2, 4, 5), (4, 1, 5), (3, 1, 6), (2, 3, 6), (4, 2, 6), (1, 4, 6)]
    body = tmp_path / "body.obj"
    body.write_text("".join(f"v {x} {y} {z}\n" for x, y, z in corners) + "".join(f"f {a} {b} {c}\n" for a, b, c in faces))
    y, x = np.mgrid[:400, :400] + 0.5
    image = (180 * np.clip((100.9 - abs(x - 200) - abs(y - 190)) / 1.8, 0, 1)).round().astype(np.uint8)
    found = retina.fit_limb(image, fov_deg=10, body=1.0, silhouette=body, camera_from_body=(1, 0, 0, 0))
    assert found.solved, found.message
    # 100 px of a focal length of 2286 px: 1 m at 22.86 m.
    assert found.range_m == pytest.approx(22.86, rel=0.01) and found.center_px == pytest.approx((200, 190), abs=0.5)


def test_a_dark_image_has_no_limb() -> None:
    found = retina.fit_limb(np.zeros((200, 200), np.uint8), fov_deg=10, body="moon")
    assert not found.solved and found.reason == "no_body" and np.isnan(found.range_m)
