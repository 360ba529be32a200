"""Lens systems, the bench and the ephemeris against the command and closed forms."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retina
from conftest import STAR_SCENE

DESIGN = "reference-1.3fc-wide"


@pytest.fixture(scope="module")
def system() -> retina.OpticalSystem:
    return retina.OpticalSystem(DESIGN)


def test_rays_are_those_of_the_command(system: retina.OpticalSystem, command: Any) -> None:
    field = [float(value) for value in system.fields[1]]
    told = command("optics", "trace", DESIGN, "--field", f"{field[0]},{field[1]}", "--pupil", "0.3,-0.4")
    ray = system.trace_ray((field[0], field[1]), (0.3, -0.4))
    assert np.array([crossing["position_mm"] for crossing in told["crossings"]]) == pytest.approx(ray.position_mm, abs=1e-12)
    assert np.degrees(ray.incidence_rad) == pytest.approx([c["incidence_deg"] for c in told["crossings"]], abs=1e-9)
    many = system.trace(field, [[0.3, -0.4], [0.0, 0.0]])
    assert [many.x_mm[0], many.y_mm[0]] == pytest.approx(ray.position_mm[-1, :2], abs=1e-9)
    assert many.direction.shape == (2, 3) and many.lost == [None, None]
    assert np.linalg.norm(many.direction, axis=1) == pytest.approx(1.0)


def test_a_paraxial_ray_has_the_focal_length(system: retina.OpticalSystem) -> None:
    first = system.first_order()
    share = 1e-3
    height_mm = 0.5 * share * first["entrance_pupil_diameter_mm"]
    ray = system.trace([0, 0], [0, share])
    # A ray parallel to the axis crosses it at the focal length behind the rear principal plane.
    assert -ray.direction[0, 1] / ray.direction[0, 2] == pytest.approx(height_mm / first["efl_mm"], rel=1e-4)
    with pytest.raises(retina.RetinaError, match="points a side or more"):
        system.mtf(pupil=8)


def test_lost_rays_are_nan_and_say_why(tmp_path: Path) -> None:
    small = retina.OpticalSystem(DESIGN, clear_fraction=0.3)
    rays = small.trace(small.fields[-1], [[0.0, 0.95], [0.0, 0.0]])
    lost = [text is not None for text in rays.lost]
    assert any(lost) and np.isnan(rays.x_mm[lost]).all()
    with pytest.raises(retina.RetinaError, match="outside the pupil"):
        small.trace([0, 0], [2.0, 0.0])


def test_spots_psf_and_mtf(system: retina.OpticalSystem, command: Any) -> None:
    told = command("optics", "spots", DESIGN)["systems"][0]["fields"]
    spots = system.spots()
    assert spots.rms_um == pytest.approx([field["rms_um"] for field in told], rel=1e-12)
    assert spots.points_mm[0][0].shape[1] == 2
    psf = system.psf()
    assert psf.values.shape[0] == len(system.fields) and 0 < psf.values.max() <= 1.0
    assert psf.energy_on_grid == pytest.approx(1.0, abs=0.01)
    mtf = system.mtf(highest_per_mm=50.0, count=10)
    assert mtf.frequency_per_mm == pytest.approx(np.linspace(0, 50, 11)) and mtf.x[:, 0] == pytest.approx(1.0)
    assert (mtf.x <= mtf.diffraction_limit + 1e-6)[0].all()
    assert DESIGN in retina.OpticalSystem.shipped()


@pytest.fixture(scope="module")
def bench() -> retina.Bench:
    return retina.Bench("wide-fov", nodes=(7, 5), lines=1)


def test_the_bench_shows_a_point_where_its_rays_land(bench: retina.Bench) -> None:
    setup = bench.setup
    columns = (940, 1000)
    found = []
    for column in columns:
        screen = np.zeros((1200, 1920), np.uint8)
        screen[600, column] = 255
        dn = bench.expose(screen).dn
        y, x = np.unravel_index(np.argmax(dn), dn.shape)
        window = np.s_[y - 14 : y + 15, x - 14 : x + 15]
        light = dn[window] - np.median(dn)
        rows, columns_px = np.mgrid[window] + 0.5
        found.append((np.average(columns_px, weights=light), np.average(rows, weights=light)))
        # Stripes side by side: the centre of mass is the green one's, where the sensor sees all colours alike.
        assert found[-1] == pytest.approx(bench.land_px((column + 0.5, 600.5), "g"), abs=0.1)
    # The facility shows a screen pixel at C K_f^-1; distortion is below 1 % so near the axis.
    ratio = setup.camera_pinhole.fx_px / setup.facility_pinhole.fx_px
    assert found[1][0] - found[0][0] == pytest.approx(60 * ratio, rel=0.01)


def test_exposures_have_their_own_noise(bench: retina.Bench, star_frame: retina.Frame) -> None:
    one, again, other = (bench.expose(star_frame, 0.01, frame=k).dn for k in (0, 0, 1))
    assert (one == again).all() and (one != other).any()
    moved = bench.expose(star_frame, 0.01, shift_px=(25.0, 0.0)).dn
    assert np.argmax(moved.sum(axis=0)) - np.argmax(one.sum(axis=0)) == pytest.approx(25, abs=1)
    assert one.dtype == np.uint16 and one.shape == (1536, 2048) and one.max() <= bench.full_scale_dn
    with pytest.raises(retina.RetinaError, match="another size"):
        bench.expose(np.zeros((10, 10), np.uint8))


def test_campaigns_are_those_of_the_command(setup_file: Path, command: Any, tmp_path: Path) -> None:
    command("simulate", "points", "--setup", setup_file, "--seed", 3, "--exposures", 2, "--points", 20, "--out", tmp_path)
    theirs = retina.read_table(tmp_path / "points.csv")
    seen: list[tuple[int, int]] = []
    mine = retina.simulate_points(setup_file, seed=3, exposures=2, points=20, progress=lambda a, b: seen.append((a, b)))
    assert seen == [(1, 2), (2, 2)] and mine.keys() == theirs.keys()
    for name, column in theirs.items():
        assert list(mine[name]) == list(column)
    power = retina.simulate_power(setup_file, seed=3, series=1, counts=[64, 255], squares_px=[0, 50])
    assert set(power["channel"]) == {"r", "g", "b", "w"}


def test_the_ephemeris() -> None:
    bodies = retina.Ephemeris()
    # The solar eclipse of 2 August 2027, greatest at 10:06:36 UTC: Sun and Moon are in line from the Earth.
    time = "2027-08-02T10:06:36Z"
    earth = bodies.position_m("earth", time)
    sun, moon = (bodies.position_m(name, time) - earth for name in ("sun", "moon"))
    cosine = sun @ moon / np.linalg.norm(sun) / np.linalg.norm(moon)
    assert np.degrees(np.arccos(cosine)) < 0.3
    assert np.linalg.norm(moon) == pytest.approx(3.6e8, rel=0.02)
    times = retina.time_s(time) + np.array([0.0, 3600.0])
    assert bodies.position_m("moon", times).shape == (2, 3) and earth.shape == (3,)
    slope = np.diff(bodies.position_m("earth", times), axis=0)[0] / 3600.0
    assert bodies.velocity_m_s("earth", times[0] + 1800.0) == pytest.approx(slope, abs=0.5)
    turned = bodies.body_from_inertial("moon", times)
    assert turned.shape == (2, 4) and np.linalg.norm(turned, axis=1) == pytest.approx(1.0)
    seen = bodies.seen("moon", time, earth)
    assert seen.direction == pytest.approx(moon / np.linalg.norm(moon), abs=1e-4)
    position_m, velocity_m_s = bodies.site(time, latitude_deg=25.5, longitude_deg=33.2)
    assert np.linalg.norm(position_m - earth) == pytest.approx(6.37e6, rel=0.01)
    assert np.linalg.norm(velocity_m_s) == pytest.approx(3e4, rel=0.05)


def test_times_of_many_kinds() -> None:
    import datetime

    # J2000 is 2000-01-01 12:00 TDB; 64.184 s earlier in UTC.
    assert retina.time_s("2000-01-01T12:00:00 TDB") == 0.0
    utc = datetime.datetime(2000, 1, 1, 11, 58, 55, 816000, tzinfo=datetime.timezone.utc)
    assert retina.time_s(utc) == pytest.approx(0.0, abs=2e-3)
    assert retina.time_s(np.datetime64("2000-01-01T11:58:55.816")) == pytest.approx(0.0, abs=2e-3)
    assert retina.time_s(5) == 5.0
    with pytest.raises(retina.RetinaError, match="no such month"):
        retina.time_s("2000-13-01")


def test_astropy() -> None:
    pytest.importorskip("astropy")
    from astropy import units as u
    from astropy.coordinates import SkyCoord
    from astropy.table import QTable
    from astropy.time import Time

    time = Time("2027-08-02T10:06:36", scale="utc")
    assert retina.time_s(time) == pytest.approx(retina.time_s("2027-08-02T10:06:36Z"), abs=2e-6)
    bodies = retina.Ephemeris()
    place = bodies.position_m("earth", time) * u.m
    assert bodies.seen("moon", time, place.to(u.km)).distance_m == bodies.seen("moon", time, place.value).distance_m
    coordinates = SkyCoord(*place, representation_type="cartesian")
    assert bodies.seen("mars", time, coordinates).distance_m > 1e10
    assert bodies.position_m("moon", time + [0, 1] * u.h).shape == (2, 3)
    table = QTable(retina.simulate_power("wide-fov", series=1, counts=[64, 255], squares_px=[0, 50]))
    table["irradiance_w_m2"] = (table["irradiance_w_m2"] * u.W / u.m**2).to(u.mW / u.m**2)
    plain = retina.compare("wide-fov", {name: table[name].value if name == "irradiance_w_m2" else table[name] for name in table.colnames} | {"irradiance_w_m2": table["irradiance_w_m2"].to_value("W / m2")})
    assert retina.compare("wide-fov", table).rms == pytest.approx(plain.rms)
    with pytest.raises(retina.RetinaError, match="cannot be converted"):
        bodies.seen("moon", time, place.value * u.kg)


def test_xarray(star_frame: retina.Frame, star_field_deg: float) -> None:
    xarray = pytest.importorskip("xarray")
    image = xarray.DataArray(star_frame.counts, dims=("y", "x"))
    assert retina.solve_stars(image, fov_deg=star_field_deg).solved


def test_a_spacecraft_of_kernels() -> None:
    kernels = Path(__file__).parents[2] / "retina-sky/tests/spice/craft/craft.tm"
    if not kernels.exists():
        pytest.skip("the wheel is tested without the sources")
    bodies = retina.Ephemeris(kernels)
    times = retina.time_s("2027-03-17T00:00 TDB") + np.array([0.0, 1.0])
    place_m, velocity_m_s = bodies.position_m("CRAFT", times), bodies.velocity_m_s("-999", times)
    assert np.diff(place_m, axis=0)[0] == pytest.approx(velocity_m_s.mean(axis=0), abs=0.1)
    assert np.linalg.norm(place_m - bodies.position_m("comet", times), axis=1) == pytest.approx(4e4, rel=0.01)
    turned = bodies.frame_from_inertial("CRAFT_CAMERA", times)
    assert turned.shape == (2, 4) and np.linalg.norm(turned, axis=1) == pytest.approx(1.0)
    with pytest.raises(retina.RetinaError, match="CRAFT_LIDAR"):
        bodies.frame_from_inertial("CRAFT_LIDAR", times[0])
