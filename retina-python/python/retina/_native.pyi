from collections.abc import Callable
from os import PathLike
from typing import Any, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "Bench",
    "Calibration",
    "Ephemeris",
    "Findings",
    "FrameMaker",
    "GeometryFit",
    "LimbAnswer",
    "Observer",
    "OpticalSystem",
    "RadiometryFit",
    "Setup",
    "StarAnswer",
    "StarSolver",
    "StarsBeside",
    "__version__",
    "bench_effects",
    "calibrate_geometry",
    "calibrate_radiometry",
    "detect",
    "effect_list",
    "effect_svgs",
    "fit_limb",
    "format_time",
    "grey_png_bytes",
    "investigate",
    "parse_time",
    "read_columns",
    "run_command",
    "screen_png_bytes",
    "simulate_points_table",
    "simulate_power_table",
    "write_table",
]

__version__: str

_Floats = npt.NDArray[np.float64]
_Path = str | PathLike[str]
_Column = _Floats | list[str | None]
_Table = list[str] | list[tuple[str, Any]]

@final
class Setup:
    @staticmethod
    def read(path: _Path) -> Setup: ...
    @staticmethod
    def parse(text: str, name: _Path) -> Setup: ...
    @staticmethod
    def shipped(name: str) -> Setup | None: ...
    def fields(self) -> dict[str, Any]: ...

@final
class FrameMaker:
    @staticmethod
    def open(
        path: _Path,
        text: str | None,
        setup: Setup | None,
        trajectory: str | None,
        layers: list[str] | None,
        backend: str,
        quality: str | None,
        scaling: float | None,
    ) -> FrameMaker: ...
    def frame_count(self) -> int: ...
    def fields(self) -> dict[str, Any]: ...
    def adapter(self) -> tuple[tuple[str, str, str], str | None]: ...
    def frame(self, index: int) -> dict[str, Any]: ...
    def pose(
        self,
        time_s: float,
        camera_position_m: _Floats,
        camera_from_inertial: _Floats,
        camera_velocity_m_s: _Floats | None,
        sun_position_m: _Floats | None,
        bodies: list[tuple[str, _Floats, _Floats]],
    ) -> dict[str, Any]: ...
    def trajectory_csv(self) -> str: ...

@final
class Calibration:
    @staticmethod
    def read(path: _Path, setup: Setup) -> Calibration: ...
    def text(self) -> str: ...
    def write(self, path: _Path) -> None: ...

@final
class GeometryFit:
    def document(self) -> dict[str, Any]: ...
    def text(self) -> str: ...
    def points(self) -> dict[str, npt.NDArray[Any]]: ...
    def calibration(self) -> Calibration: ...
    def write(self, path: _Path) -> None: ...
    def write_report(self, path: _Path) -> None: ...
    def figures(self) -> dict[str, str]: ...

@final
class RadiometryFit:
    def document(self) -> dict[str, Any]: ...
    def text(self) -> list[str]: ...
    def calibration(self) -> Calibration: ...
    def write(self, path: _Path) -> None: ...
    def figures(self) -> list[str]: ...

@final
class Findings:
    def document(self) -> dict[str, Any]: ...
    def text(self) -> list[str]: ...
    def svg(self) -> str: ...
    def html(self) -> str: ...
    def write_report(self, path: _Path) -> None: ...
    def predictions(self) -> dict[str, Any]: ...
    def write_model(self, path: _Path) -> float: ...

@final
class Ephemeris:
    def __new__(cls, kernels: list[str]) -> Ephemeris: ...
    def name(self) -> str: ...
    def positions_m(self, body: str, tdb_s: _Floats) -> _Floats: ...
    def velocities_m_s(self, body: str, tdb_s: _Floats) -> _Floats: ...
    def seen(
        self, body: str, tdb_s: float, position_m: _Floats, velocity_m_s: _Floats | None
    ) -> dict[str, Any]: ...
    def site(
        self, tdb_s: float, latitude_rad: float, longitude_rad: float, altitude_m: float
    ) -> tuple[list[float], list[float]]: ...
    def orientations(self, body: str, tdb_s: _Floats) -> _Floats: ...
    def frame_turns(self, frame: str, tdb_s: _Floats) -> _Floats: ...
    def axes_source(self, body: str) -> str | None: ...
    def semi_axes_m(self, body: str) -> list[float] | None: ...
    def next_new_moon_s(self, after_tdb_s: float) -> float: ...

@final
class Observer:
    def __new__(
        cls, ephemeris: Ephemeris, tdb_s: float, position_m: _Floats, velocity_m_s: _Floats | None
    ) -> Observer: ...

@final
class StarsBeside:
    def __new__(cls, ephemeris: Ephemeris, tdb_s: float | None) -> StarsBeside: ...

@final
class StarSolver:
    def __new__(
        cls,
        setup: Setup | None,
        calibration: Calibration | None,
        field_rad: tuple[float, float] | None,
        focal_slack: float,
        log10_bound: float,
        most_hypotheses: int | None,
        threshold_sigma: float,
        mirrored: bool,
        pixel_aspect: float | None,
        tdb_s: float | None,
    ) -> StarSolver: ...
    def solve(
        self,
        image: Any,
        bits: int | None,
        mask: npt.NDArray[np.bool_] | None,
        observer: Observer | None,
        position_sigma_m: float,
    ) -> StarAnswer: ...

@final
class StarAnswer:
    def document(self) -> dict[str, Any]: ...
    def svg(self, title: str) -> str: ...
    def wcs_header(self) -> bytes | list[int] | None: ...

@final
class LimbAnswer:
    def document(self) -> dict[str, Any]: ...
    def points(self) -> dict[str, npt.NDArray[Any]]: ...
    def svg(self, title: str) -> str: ...

@final
class Bench:
    def __new__(
        cls, setup: Setup, effects: list[str], seed: int, nodes: tuple[int, int] | None, lines: int | None
    ) -> Bench: ...
    def expose(
        self,
        screen: npt.NDArray[np.uint8],
        exposure_s: float | None,
        temperature_c: float,
        frame: int,
        shift_px: tuple[float, float],
        roll_rad: float,
    ) -> tuple[npt.NDArray[np.uint16], float]: ...
    def land_px(self, x_px: float, y_px: float, channel: str) -> tuple[float, float] | None: ...
    def sensor(self) -> tuple[int, float]: ...

@final
class OpticalSystem:
    @staticmethod
    def read(source: _Path, agf: list[str], clear_fraction: float | None, unclipped: bool) -> OpticalSystem: ...
    @staticmethod
    def shipped() -> list[str]: ...
    def fields(self) -> dict[str, Any]: ...
    def first_order(self) -> dict[str, Any]: ...
    def trace(self, fields: _Floats, pupils: _Floats, wavelength_nm: float | None) -> dict[str, Any]: ...
    def trace_ray(
        self, field: tuple[float, float], pupil: tuple[float, float], wavelength_nm: float | None
    ) -> dict[str, Any]: ...
    def spots(self, rings: int, arms: int) -> dict[str, Any]: ...
    def psf(self, pupil: int | None, pixels: int | None, pitch_um: float | None) -> dict[str, Any]: ...
    def mtf(self, pupil: int, highest_per_mm: float, count: int) -> dict[str, Any]: ...
    def layout_svg(self) -> str: ...

def bench_effects() -> list[tuple[str, str, str, int, str]]: ...
def calibrate_geometry(
    table: _Table,
    setup: Setup,
    plain: bool,
    reference_log10_irradiance: float | None,
    response: Calibration | None,
) -> GeometryFit: ...
def calibrate_radiometry(table: _Table, setup: Setup, for_setup: Setup | None) -> RadiometryFit: ...
def detect(
    image: npt.NDArray[Any],
    mask: npt.NDArray[np.bool_] | None,
    bits: int | None,
    threshold_sigma: float,
    saturation_dn: float | None,
    gain_e_per_dn: float | None,
    spot_sigma_px: float | None,
    centroid: str,
    mesh_px: int,
    single_pixels: bool,
) -> tuple[dict[str, npt.NDArray[Any]], dict[str, Any]]: ...
def effect_list(table: str | None) -> list[dict[str, Any]]: ...
def effect_svgs(name: str) -> list[str]: ...
def fit_limb(
    image: Any,
    setup: Setup | None,
    calibration: Calibration | None,
    focal_px: float | None,
    field_rad: float | None,
    focal_sigma_share: float | None,
    body: str | _Floats,
    camera_from_body: _Floats | None,
    limb_height_m: float | None,
    limb_height_sigma_m: float | None,
    sun_angle_rad: float | None,
    observer: Observer | None,
    bits: int | None,
    silhouette: str | None,
    mask: npt.NDArray[np.bool_] | None,
    stars: StarsBeside | None,
) -> LimbAnswer: ...
def format_time(tdb_s: float) -> str: ...
def grey_png_bytes(values: npt.NDArray[np.uint8]) -> bytes: ...
def investigate(
    what: str,
    setup: Setup,
    table: _Table,
    calibration: Calibration | None,
    effects: list[Any],
    baseline: str,
    flips: int,
    seed: int,
    terms: int,
) -> Findings: ...
def parse_time(text: str) -> float: ...
def read_columns(path: _Path) -> dict[str, Any]: ...
def run_command(arguments: list[str]) -> int: ...
def screen_png_bytes(index: int, counts: npt.NDArray[np.uint8], filtered: bool) -> bytes: ...
def simulate_points_table(
    setup: Setup,
    seed: int,
    effects: list[str],
    exposures: int,
    points: int,
    interval_s: float,
    temperature: str,
    exposure_s: float | None,
    channel: str,
    counts: list[int],
    nodes: tuple[int, int] | None,
    lines: int | None,
    progress: Callable[[int, int], object] | None,
) -> dict[str, Any]: ...
def simulate_power_table(
    setup: Setup,
    seed: int,
    effects: list[str],
    series: int,
    counts: list[int],
    squares_px: list[int] | None,
) -> dict[str, Any]: ...
def write_table(table: _Table, path: _Path, setup: Setup) -> None: ...
