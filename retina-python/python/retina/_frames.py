"""Scenes rendered to frames."""

from __future__ import annotations

import json
import os
import threading

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, overload

import numpy as np
import numpy.typing as npt

from . import _duck, _native
from ._duck import PathLike, Time, Vector
from ._errors import RetinaError

from ._setup import Setup, setup_of

Backend = Literal["auto", "gpu", "native", "cpu"]
Quality = Literal["draft", "default", "best"]

_SCHEMA = "retina.scene/1"


class Frame:
    """A frame, as ``retina render`` writes it.

    Attributes
    ----------
    index : int
        Its number, from 0.
    time_s : float
        TDB seconds since J2000.
    counts : ndarray of uint8, shape (height, width)
        The screen image: digital counts, equal in the three channels.
    radiance : ndarray of float32, shape (height, width)
        True spectral radiance of the bodies at 550 nm, W m^-2 sr^-1 nm^-1, before stars and flashes are drawn.
    layers : dict of str to ndarray of float32, shape (height, width)
        The layers that were asked for, with ``Y`` (radiance of the undistorted image in mode ``resample``, otherwise
        that of the screen) and ``IF`` (radiance factor). Empty where none was asked for.
    truth : dict
        Ground truth, schema ``retina.truth/1``.
    radiance_scale : float
        Displayed over true radiance.
    saturated_px : int
        Pixels brighter than the screen can show.
    """

    def __init__(self, fields: dict[str, Any]) -> None:
        self.index: int = fields["index"]
        self.time_s: float = fields["time_s"]
        self.counts: npt.NDArray[np.uint8] = fields["counts"]
        self.radiance: npt.NDArray[np.float32] = fields["radiance"]
        self.layers: dict[str, npt.NDArray[np.float32]] = fields["layers"]
        self.truth: dict[str, Any] = fields["truth"]
        self.radiance_scale: float = fields["radiance_scale"]
        self.saturated_px: int = fields["saturated_px"]
        self._png_filtered: bool = fields["png_filtered"]

    @property
    def et(self) -> float:
        """SPICE's ephemeris time, which is `time_s`."""
        return self.time_s

    @property
    def camera_from_inertial(self) -> npt.NDArray[np.float64]:
        """Rotation from ICRF to the camera's axes: a unit quaternion, scalar first, shape (4,)."""
        return np.array(self.truth["camera_from_inertial"], dtype=float)

    def png(self) -> bytes:
        """Return the bytes of the PNG that ``retina render`` writes of the frame."""
        return _native.screen_png_bytes(self.index, self.counts, self._png_filtered)

    def save(self, path: PathLike) -> None:
        """Write the screen image as a PNG."""
        Path(path).write_bytes(self.png())

    def _repr_png_(self) -> bytes:
        return self.png()

    def __array__(self, dtype: npt.DTypeLike | None = None, copy: bool | None = None) -> npt.NDArray[Any]:
        return np.array(self.counts, dtype=dtype) if copy or dtype is not None else self.counts

    def __repr__(self) -> str:
        height, width = self.counts.shape
        return f"<Frame {self.index}, {width} x {height} px, {', '.join(self.truth['bodies']) or 'no body'}>"


class _Renders:
    """What scenes and renderers share."""

    _maker: _native.FrameMaker

    @property
    def adapter(self) -> dict[str, str | None]:
        """What renders: ``backend``, ``adapter``, ``driver``, and ``fallback_reason`` where the GPU is not used."""
        (backend, adapter, driver), reason = self._maker.adapter()
        return {"backend": backend, "adapter": adapter, "driver": driver, "fallback_reason": reason}

    @property
    def bodies(self) -> list[str]:
        """Names of the bodies."""
        return list(self._maker.fields()["bodies"])


class Scene(_Renders, Sequence[Frame]):
    """A scene: a sequence whose frames are rendered when they are asked for.

    ``len(scene)``, ``scene[3]``, ``for frame in scene`` and ``scene.frames(0, 100, 10)`` work. A frame has the same
    bytes as ``retina render`` writes, on the same adapter.

    Parameters
    ----------
    source : path or dict
        A file of schema ``retina.scene/1``, or a dict with its keys. Paths in a dict are relative to the working
        directory.
    setup : Setup, path or str, optional
        The facility, in the place of the scene's own.
    trajectory : table, optional
        Columns ``time_s``, ``camera_x_m`` ..., ``camera_from_inertial_w`` ... (scalar first), in the place of the
        scene's own: a dict of arrays, a data frame, or a file.
    layers : sequence of str, optional
        Layers of each frame: depth, mask, normal, incidence, emission, phase, shadow. Default: the scene's.
    backend : {"auto", "gpu", "native", "cpu"}
        What renders.
    quality : {"draft", "default", "best"}, optional
        Default: the scene's.
    radiance_scale : float, optional
        Displayed over true radiance. Default: the scene's; ``"auto"`` there looks for the sequence's brightest pixel
        when the scene is opened.

    Raises
    ------
    RetinaError
        Something does not fit, in whichever of the files.
    """

    def __init__(
        self,
        source: PathLike | Mapping[str, Any],
        *,
        setup: Setup | PathLike | None = None,
        trajectory: Any = None,
        layers: Sequence[str] | None = None,
        backend: Backend = "auto",
        quality: Quality | None = None,
        radiance_scale: float | None = None,
    ) -> None:
        path, text, setup = _source(source, setup)
        if isinstance(source, Mapping) and trajectory is None and not _is_toml(source.get("trajectory")):
            trajectory = source.get("trajectory")
        self._maker = _native.FrameMaker.open(
            path,
            text,
            None if setup is None else setup_of(setup)._native,
            None if trajectory is None else _trajectory_csv(trajectory),
            None if layers is None else list(layers),
            backend,
            quality,
            _finite(radiance_scale),
        )

    def __len__(self) -> int:
        return self._maker.frame_count()

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...
    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        if isinstance(index, slice):
            return list(self.frames(index.start, index.stop, index.step))
        at = index + len(self) if index < 0 else index
        if not 0 <= at < len(self):
            raise IndexError(f"frame {index} of {len(self)}")
        return Frame(self._maker.frame(at))

    def __iter__(self) -> Iterator[Frame]:
        return self.frames()

    def frames(
        self, start: int | None = None, stop: int | None = None, step: int | None = None
    ) -> Iterator[Frame]:
        """Iterate over frames, each rendered when it is reached; the numbers are those of a slice."""
        for at in range(*slice(start, stop, step).indices(len(self))):
            yield Frame(self._maker.frame(at))

    @property
    def time_s(self) -> npt.NDArray[np.float64]:
        """TDB seconds since J2000 of every frame, shape (frames,)."""
        return np.asarray(self._maker.fields()["time_s"])

    @property
    def et(self) -> npt.NDArray[np.float64]:
        """SPICE's ephemeris time of every frame, which is `time_s`."""
        return self.time_s

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the screen, px."""
        width_px, height_px = self._maker.fields()["size_px"]
        return width_px, height_px

    @property
    def radiance_scale(self) -> float:
        """Displayed over true radiance: one value for the sequence."""
        return float(self._maker.fields()["radiance_scale"])

    def __repr__(self) -> str:
        return f"<Scene of {len(self)} frames, {', '.join(self.bodies) or 'no body'}>"


class Renderer(_Renders):
    """Renders bodies from any pose, without a trajectory.

    Parameters
    ----------
    setup : Setup, path or str
        The facility.
    bodies : dict of str to dict
        By name, the keys of a scene's ``[[body]]``: ``model`` (a .glb, .gltf, .obj, .icq or .bds file), ``photometry`` (a dict),
        ``shading`` and more.
    scene : dict, optional
        More tables of a scene, such as ``{"compensation": {"mode": "direct"}}``.
    layers, backend, quality
        As `Scene` takes them.
    radiance_scale : float, optional
        Displayed over true radiance. Default: each frame by itself, so that its brightest pixel is just below
        saturation. Give one value where frames are compared.

    Examples
    --------
    >>> moon = {"model": "moon.glb", "photometry": {"model": "lambert", "normal_albedo": 0.12}}
    >>> renderer = retina.Renderer("narrow-fov", {"moon": moon})                            # doctest: +SKIP
    >>> frame = renderer.render(camera_position_m=[0, 0, -6e7], sun_position_m=[1.5e11, 0, 0])  # doctest: +SKIP
    """

    def __init__(
        self,
        setup: Setup | PathLike,
        bodies: Mapping[str, Mapping[str, Any]],
        *,
        scene: Mapping[str, Any] | None = None,
        layers: Sequence[str] | None = None,
        backend: Backend = "auto",
        quality: Quality | None = None,
        radiance_scale: float | None = None,
    ) -> None:
        document = {
            "schema": _SCHEMA,
            "setup": "setup",
            "trajectory": "poses",
            **(scene or {}),
            "allow_empty_frames": True,
            "body": [{"name": name, "may_be_behind": True, **body} for name, body in bodies.items()],
        }
        self._maker = _native.FrameMaker.open(
            str(Path.cwd() / "renderer"),
            toml_text(document),
            setup_of(setup)._native,
            _resting_csv(list(bodies)),
            None if layers is None else list(layers),
            backend,
            quality,
            float("nan") if radiance_scale is None else _finite(radiance_scale),
        )
        self._lock = threading.Lock()

    def render(
        self,
        camera_from_inertial: Vector = (1.0, 0.0, 0.0, 0.0),
        camera_position_m: Vector = (0.0, 0.0, 0.0),
        *,
        sun_position_m: Vector | None = None,
        bodies: Mapping[str, Mapping[str, Vector]] | None = None,
        time: Time = 0.0,
        camera_velocity_m_s: Vector | None = None,
    ) -> Frame:
        """Render one pose.

        Parameters
        ----------
        camera_from_inertial : array_like, shape (4,)
            Rotation from ICRF to the camera's axes (+z boresight, +x right, +y down), scalar first.
        camera_position_m : array_like, shape (3,)
            The camera, m (or a quantity).
        sun_position_m : array_like, shape (3,), optional
            The Sun, m, in the frame of the other positions. Default: the ephemeris, where the Moon or the Earth stands
            at the origin.
        bodies : dict of str to dict, optional
            By name ``position_m`` (default: the origin) and ``body_from_inertial`` (default: aligned).
        time : float, str, datetime or astropy.time.Time
            Epoch; a number is TDB seconds since J2000.
        camera_velocity_m_s : array_like, shape (3,), optional
            For aberration of stars.

        Returns
        -------
        Frame

        Raises
        ------
        RetinaError
            The camera or the Sun is inside a body, or nothing says where the Sun is.
        """
        places = []
        for name, place in (bodies or {}).items():
            unknown = set(place) - {"position_m", "body_from_inertial"}
            if name not in self.bodies or unknown:
                raise RetinaError(
                    "is no body of this renderer" if name not in self.bodies else "has an unknown key",
                    place=f"argument `bodies`, `{name}`",
                    found=", ".join(sorted(unknown)) or name,
                    expected=", ".join(self.bodies) if name not in self.bodies else "position_m, body_from_inertial",
                )
            position_m = _duck.vector(place.get("position_m", (0.0, 0.0, 0.0)), "m")
            turn = _duck.vector(place.get("body_from_inertial", (1.0, 0.0, 0.0, 0.0)))
            places.append((name, position_m, turn))
        with self._lock:
            return Frame(
                self._maker.pose(
                    _duck.time_s(time),
                    _duck.vector(camera_position_m, "m"),
                    _duck.vector(camera_from_inertial),
                    None if camera_velocity_m_s is None else _duck.vector(camera_velocity_m_s, "m/s"),
                    None if sun_position_m is None else _duck.vector(sun_position_m, "m"),
                    places,
                )
            )

    def __repr__(self) -> str:
        return f"<Renderer of {', '.join(self.bodies) or 'no body'}>"


def _finite(value: float | None) -> float | None:
    if value is not None and not np.isfinite(value):
        raise RetinaError("is out of range", place="argument `radiance_scale`", found=str(value), expected="above 0")
    return None if value is None else float(value)


def _source(
    source: PathLike | Mapping[str, Any], setup: Setup | PathLike | None
) -> tuple[str, str | None, Setup | PathLike | None]:
    if not isinstance(source, Mapping):
        return os.fspath(source), None, setup
    document = dict(source)
    document.setdefault("schema", _SCHEMA)
    own = document.get("setup")
    if setup is None and (isinstance(own, Setup) or own in ("wide-fov", "narrow-fov")):
        setup = own
    if setup is not None:
        document["setup"] = "setup"
    if not _is_toml(document.get("trajectory")):
        document["trajectory"] = "trajectory"
    return str(Path.cwd() / "scene"), toml_text(document), setup


def _is_toml(trajectory: Any) -> bool:
    """Whether a trajectory is what a scene's file may say: a path, or a table that generates one."""
    return isinstance(trajectory, (str, os.PathLike)) or (isinstance(trajectory, Mapping) and "kind" in trajectory)


def _trajectory_csv(trajectory: Any) -> str:
    if _duck.is_path(trajectory):
        return Path(trajectory).read_text(encoding="utf-8")
    columns = _duck.columns(trajectory)
    names = [name for name, _ in columns]
    values = np.column_stack([np.asarray(column, dtype=float) for _, column in columns])
    rows = [",".join("" if np.isnan(value) else repr(float(value)) for value in row) for row in values]
    return "\n".join([",".join(json.dumps(str(name)) for name in names), *rows]) + "\n"


def _resting_csv(bodies: list[str]) -> str:
    """A trajectory of one frame that stands for those to come: every body is behind the camera and apart from others."""
    columns = {"time_s": 0.0, "camera_x_m": 0.0, "camera_y_m": 0.0, "camera_z_m": 0.0}
    columns |= {f"camera_from_inertial_{axis}": float(axis == "w") for axis in "wxyz"}
    columns |= {"sun_x_m": 0.0, "sun_y_m": 1.5e17, "sun_z_m": 0.0}
    for at, name in enumerate(bodies):
        columns |= {f"{name}_x_m": 1e15 * at, f"{name}_y_m": 0.0, f"{name}_z_m": -1e15}
        columns |= {f"{name}_from_inertial_{axis}": float(axis == "w") for axis in "wxyz"}
    return ",".join(columns) + "\n" + ",".join(repr(value) for value in columns.values()) + "\n"


def toml_text(document: Mapping[str, Any]) -> str:
    """A document as TOML: every value on one line, tables inline."""
    return "".join(f"{_key(key)} = {_value(value)}\n" for key, value in document.items() if value is not None)


def _key(key: str) -> str:
    return json.dumps(str(key), ensure_ascii=False)


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{_key(key)} = {_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, (str, os.PathLike)):
        return json.dumps(os.fspath(value), ensure_ascii=False)
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return repr(float(value))
    if isinstance(value, (Sequence, np.ndarray)):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    raise RetinaError("has no place in a scene", found=f"a value of type {type(value).__name__}", expected="a number, text, list or dict")
