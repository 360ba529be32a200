"""Calibration and workbench against the command, and tables of every kind."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retina
from conftest import assert_same, csv_of


def without_files(document: Any) -> Any:
    """A document without what names its files."""
    if isinstance(document, dict):
        return {k: without_files(v) for k, v in document.items() if k not in ("files", "file", "out", "inputs", "data")}
    return [without_files(v) for v in document] if isinstance(document, list) else document


@pytest.fixture(scope="module")
def points_file(warming: dict[str, Any], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return csv_of(warming, tmp_path_factory.mktemp("tables") / "points.csv")


def test_the_missing_effect_is_named(warming: dict[str, Any]) -> None:
    found = retina.diagnose("wide-fov", warming)
    assert found.verdict == "named" and found.accepted == ["thermal_boresight"]
    best = found.candidates[0]
    assert best.effect == "thermal_boresight" and best.p_value < 0.01
    # 0.15 px a kelvin are 4.27 arcsec.
    px_arcsec = np.degrees(1 / retina.Setup("wide-fov").camera_pinhole.fx_px) * 3600
    assert best.parameters["a_per_k_arcsec"]["value"] == pytest.approx(0.15 * px_arcsec, rel=0.02)
    assert found.steps[-1]["heldout_rms"] < 0.5 * found.baseline_heldout_rms
    # The noise was drawn with 0.05 px.
    assert found.noise_floor == pytest.approx(0.05 * px_arcsec, rel=0.1)
    assert "thermal_boresight" in str(found)


@pytest.mark.parametrize("what", ["compare", "diagnose", "fit"])
def test_results_are_those_of_the_command(
    what: str, warming: dict[str, Any], points_file: Path, setup_file: Path, command: Any
) -> None:
    more = ["--effect", "thermal_boresight"] if what == "fit" else []
    told = command(what, "--setup", setup_file, "--data", points_file, *more)
    arguments = ("thermal_boresight",) if what == "fit" else ()
    from_file = getattr(retina, what)(setup_file, points_file, *arguments).to_dict()
    assert_same(from_file, told, 0)
    in_memory = getattr(retina, what)(setup_file, warming, *arguments).to_dict()
    assert_same(without_files(in_memory), without_files(told))


def test_a_formula_is_found_and_is_that_of_the_command(tmp_path: Path, setup_file: Path, command: Any) -> None:
    rng = np.random.default_rng(3)
    series, reading = np.divmod(np.arange(480), 20)
    humidity = rng.uniform(30.0, 70.0, 24)[series]
    count = np.array([8.0, 24.0, 60.0, 120.0, 255.0])[reading % 5]
    side = np.array([20.0, 60.0, 100.0, 200.0])[(series + reading) % 4]
    wet = 0.02 * (humidity - 50.0) / 20.0 * np.sqrt(side / 200.0)
    light = side**2 * (count / 255.0) ** 2.2 * (1.0 + wet) * (1.0 + 0.004 * rng.standard_normal(480))
    readings = {
        "channel": ["w"] * 480,
        "digital_count": count,
        "square_px": side,
        "irradiance_w_m2": 2e-9 * light,
        "series": [f"s{number:02}" for number in series],
        "time_s": 30.0 * np.arange(480),
        "humidity": humidity,
    }
    found = retina.investigate(setup_file, readings)
    assert found.verdict == "found" and "humidity" in found.formulas[0].covariates
    assert found.formulas[0].p_value < 0.01 and found.formulas[0].weak_beside is None
    assert "humidity" in repr(found) and "humidity" in found._repr_html_()
    table = csv_of(readings, tmp_path / "power.csv")
    told = command("investigate", "--setup", setup_file, "--data", table)
    assert_same(retina.investigate(setup_file, table).to_dict(), told, 0)
    found.formulas[0].write(tmp_path / "found.toml")
    fitted = retina.fit(setup_file, readings, tmp_path / "found.toml")
    assert fitted.heldout_rms < 0.8 * retina.fit(setup_file, readings, []).heldout_rms
    with pytest.raises(retina.RetinaError, match="terms"):
        retina.investigate(setup_file, readings, terms=0)


def test_an_effect_is_a_function_or_a_formula(warming: dict[str, Any], tmp_path: Path) -> None:
    def turning(temperature_c: np.ndarray, per_k_arcsec: float) -> tuple[np.ndarray, float]:
        assert temperature_c.shape == (len(warming["image"]),) and temperature_c.dtype == float
        return per_k_arcsec * (temperature_c - 20.0), 0.0

    function = retina.OwnEffect(turning, {"per_k_arcsec": (1.0, "arcsec/K")})
    formula = tmp_path / "turning.toml"
    formula.write_text(
        'schema = "retina.effect/1"\nname = "turning"\nunit = "arcsec"\n'
        '[parameters]\nper_k_arcsec = { start = 1.0, unit = "arcsec/K" }\n'
        '[formulas]\ndx = "per_k_arcsec * (temperature_c - 20)"\n'
    )
    by_function = retina.fit("wide-fov", warming, function)
    value = by_function.parameters["turning.per_k_arcsec"]
    px_arcsec = np.degrees(1 / retina.Setup("wide-fov").camera_pinhole.fx_px) * 3600
    assert value["value"] == pytest.approx(0.15 * px_arcsec, abs=4 * value["sigma"])
    predictions = by_function.predictions
    assert predictions["residual_x_px"].shape == (len(warming["image"]),)
    assert np.array_equal(predictions["camera_x_px"], warming["camera_x_px"])
    moved = 0.15 * (warming["temperature_c"] - 20.0)
    assert np.std(predictions["effect_x_px"] - moved) < 0.01
    assert by_function.correlation.shape == (len(by_function.correlated),) * 2
    assert "turning.per_k_arcsec" in by_function.correlated
    assert "turning" in by_function.to_html() and by_function.plot().svg.startswith("<svg")


def test_a_function_that_raises_stops_the_fit(warming: dict[str, Any]) -> None:
    def broken(x: np.ndarray, a_arcsec: float) -> np.ndarray:
        raise ZeroDivisionError("on purpose")

    with pytest.raises(ZeroDivisionError, match="on purpose"):
        retina.fit("wide-fov", warming, retina.OwnEffect(broken, {"a_arcsec": 1.0}))
    with pytest.raises(TypeError, match="not dx and dy"):
        retina.fit("wide-fov", warming, retina.OwnEffect(lambda x, a: (x, x, x), {"a": 1.0}, "three"))
    with pytest.raises(TypeError, match="shape"):
        retina.fit("wide-fov", warming, retina.OwnEffect(lambda x, a: (a * x[:3], x), {"a": 1.0}, "short"))
    with pytest.raises(retina.RetinaError, match="does not have|do not have"):
        retina.fit("wide-fov", warming, retina.OwnEffect(lambda humidity, a: (a, a), {"a": 1.0}, "wet"))
    with pytest.raises(retina.RetinaError, match="no such parameter"):
        retina.OwnEffect(lambda x: (x, x), {"a": 1.0}, "lost")


def test_geometry_is_calibrated_as_the_command_does(
    warming: dict[str, Any], points_file: Path, setup_file: Path, command: Any, tmp_path: Path
) -> None:
    told = command("calibrate", "geometry", "--setup", setup_file, "--data", points_file, "--out", tmp_path / "c.toml")
    found = retina.calibrate_geometry(warming, setup_file)
    assert_same(without_files(found.to_dict()), without_files(told), 1e-9)
    assert found.covariance.shape == (len(found.coefficients["a"]),) * 2
    assert len(found.points["error_arcsec"]) == told["points"] + told["outliers"]
    found.write(tmp_path / "mine.toml")
    for calibration in (found, found.calibration, tmp_path / "mine.toml", retina.Calibration(tmp_path / "c.toml", setup_file)):
        held = retina.compare(setup_file, warming, calibration)
        assert held.rms == pytest.approx(retina.compare(setup_file, warming, tmp_path / "c.toml").rms, rel=1e-6)
    with pytest.raises(retina.RetinaError):
        retina.compare("narrow-fov", warming, tmp_path / "c.toml")


def test_radiometry_finds_the_response_that_was_drawn(setup_file: Path, command: Any, tmp_path: Path) -> None:
    # (B / 255)^2.2, 2e-8 W m^-2 a pixel at full count, 0.5 % noise.
    rng = np.random.default_rng(9)
    grid = [(c, b, n) for c in "rgb" for b in (*range(8, 256, 16), 255) for n in (100, 200) for _ in range(3)]
    grid += [(c, 0, 0) for c in "rgb" for _ in range(4)]
    channel, count, square = (np.array(column) for column in zip(*grid, strict=True))
    light = 2e-8 * square.astype(float) ** 2 * (count / 255.0) ** 2.2
    table = {"channel": channel, "digital_count": count, "square_px": square}
    table |= {"irradiance_w_m2": light * (1 + 0.005 * rng.standard_normal(len(grid))), "sigma_w_m2": 0.005 * light + 1e-9}
    found = retina.calibrate_radiometry(table, setup_file)
    green = found.response("g")
    bright = green["digital_count"] >= 64
    expected = 2e-8 * (green["digital_count"] / 255.0) ** 2.2
    assert np.abs(green["irradiance_w_m2"][bright] / expected[bright] - 1).max() < 0.01
    assert found.monotone and found.magnitude_range[0] < found.magnitude_range[1]
    told = command("calibrate", "radiometry", "--setup", setup_file, "--data", csv_of(table, tmp_path / "power.csv"))
    assert_same(without_files(found.to_dict()), without_files(told), 1e-9)
    assert retina.compare(setup_file, table, found).rms < 0.02
    found.write(tmp_path / "response.toml")
    assert "[response" in (tmp_path / "response.toml").read_text()


def test_tables_come_in_many_forms(warming: dict[str, Any], points_file: Path) -> None:
    expected = without_files(retina.compare("wide-fov", warming).to_dict())
    names = list(warming)
    kinds = [("U8" if name == "image" else float) for name in names]
    records = np.zeros(len(warming["image"]), dtype=list(zip(names, kinds, strict=True)))
    for name in names:
        records[name] = warming[name]
    lists = {name: list(column) for name, column in warming.items()}
    for table in (records, lists, [points_file], str(points_file), retina.read_table(points_file)):
        assert_same(without_files(retina.compare("wide-fov", table).to_dict()), expected)


def test_pandas(warming: dict[str, Any]) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame(warming)
    frame.loc[3, "temperature_c"] = None
    assert_same(retina.compare("wide-fov", frame).rows, len(warming["image"]))


def test_polars(warming: dict[str, Any]) -> None:
    polars = pytest.importorskip("polars")
    frame = polars.DataFrame(warming)
    assert retina.compare("wide-fov", frame).rms == retina.compare("wide-fov", warming).rms


def test_tables_are_written_and_read(tmp_path: Path, setup_file: Path, warming: dict[str, Any]) -> None:
    path = tmp_path / "points.csv"
    retina.write_table(warming, path, setup_file)
    again = retina.read_table(path)
    assert again["image"] == list(warming["image"])
    # Centroids are written to 1e-5 px.
    assert np.abs(again["camera_x_px"] - warming["camera_x_px"]).max() <= 0.5001e-5
    with pytest.raises(retina.RetinaError, match="another setup"):
        retina.compare("narrow-fov", path)


def test_the_catalogue() -> None:
    listed = retina.effects()
    assert "screen_tilt" in listed and set(retina.effects("power")) < set(listed)
    assert listed["screen_tilt"].table == "points" and listed["screen_tilt"].formula
    assert listed["screen_tilt"].plots()[0].svg.startswith("<svg")
    assert retina.bench_effects()["screen_tilt"]["unit"]
