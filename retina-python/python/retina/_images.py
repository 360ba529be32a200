"""Points of light in camera images."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from . import _duck, _native
from ._notebook import shown, table_html


class Detection:
    """Points of light in an image, brightest first.

    Every column is an array of shape (points,).

    Attributes
    ----------
    x_px, y_px : ndarray of float
        Centroids, px. The centre of pixel (0, 0) is (0.5, 0.5).
    sigma_px : ndarray of float
        Standard deviation of a centroid per axis from the image's noise, px.
    flux_dn, peak_dn, snr : ndarray of float
        Light and brightest pixel above the background, DN; light over its standard deviation.
    width_px, ellipticity : ndarray of float
        Standard deviation of the spot, px, and 1 - minor / major axis; NaN where noise hides them.
    saturated, blended, on_line : ndarray of bool
        A pixel is saturated; another point reaches into it; a line of light passes through it.
    columns : dict of str to ndarray
        All of them, and ``saturation_shift_px``, ``saturation_reach_px``, ``bright_surroundings``.
    hot_pixels : ndarray of int, shape (pixels, 2)
        Single-pixel spikes that were left out: column, row.
    background_dn, noise_dn, spot_sigma_px : float
        Typical background and its standard deviation, DN; standard deviation of the spots, px.
    """

    def __init__(self, columns: dict[str, npt.NDArray[Any]], about: dict[str, Any]) -> None:
        self.columns = columns
        self.x_px: npt.NDArray[np.float64] = columns["x_px"]
        self.y_px: npt.NDArray[np.float64] = columns["y_px"]
        self.sigma_px: npt.NDArray[np.float64] = columns["sigma_px"]
        self.flux_dn: npt.NDArray[np.float64] = columns["flux_dn"]
        self.peak_dn: npt.NDArray[np.float64] = columns["peak_dn"]
        self.snr: npt.NDArray[np.float64] = columns["snr"]
        self.width_px: npt.NDArray[np.float64] = columns["width_px"]
        self.ellipticity: npt.NDArray[np.float64] = columns["ellipticity"]
        self.saturated: npt.NDArray[np.bool_] = columns["saturated"]
        self.blended: npt.NDArray[np.bool_] = columns["blended"]
        self.on_line: npt.NDArray[np.bool_] = columns["on_line"]
        self.hot_pixels: npt.NDArray[np.int64] = about["hot_pixels"].astype(np.int64)
        self.background_dn: float = about["background_dn"]
        self.noise_dn: float = about["noise_dn"]
        self.spot_sigma_px: float = about["spot_sigma_px"]

    def __len__(self) -> int:
        return len(self.x_px)

    def __repr__(self) -> str:
        return f"<Detection of {len(self)} points>"

    def _repr_html_(self) -> str:
        names = ("x_px", "y_px", "sigma_px", "flux_dn", "snr", "width_px", "saturated")
        columns = [self.columns[name] for name in names]
        rows = ([shown(column[at].item()) for column in columns] for at in range(min(len(self), 20)))
        return table_html(f"{len(self)} points of light, the brightest first", names, rows)


def detect(
    image: Any,
    *,
    mask: Any = None,
    bits: int | None = None,
    threshold_sigma: float = 5.0,
    saturation_dn: float | None = None,
    gain_e_per_dn: float | None = None,
    spot_sigma_px: float | None = None,
    centroid: Literal["windowed", "moments"] = "windowed",
    mesh_px: int = 64,
    single_pixels: bool = False,
) -> Detection:
    """Find points of light in an image and measure each to a small fraction of a pixel.

    Parameters
    ----------
    image : array_like, shape (height, width)
        Digital numbers that are linear in light. uint8, uint16, float32 and float64 are taken as they are.
    mask : array_like of bool, shape (height, width), optional
        True where points are looked for.
    bits : int, optional
        Bits of the camera's digital numbers: the full scale. Default: those of a type of whole numbers; a
        floating-point image has no full scale.
    threshold_sigma : float
        A point's brightest 3 x 3 pixels stand out of the background by this many standard deviations.
    saturation_dn : float, optional
        Digital number from which a pixel is saturated. Default: the full scale.
    gain_e_per_dn : float, optional
        Gain, electrons per DN: adds the light's own noise to `Detection.sigma_px`.
    spot_sigma_px : float, optional
        Standard deviation of the spots, px. Default: measured on the bright ones.
    centroid : {"windowed", "moments"}
        Gaussian-weighted mean, or centre of mass above the threshold.
    mesh_px : int
        Side of the background's cells, px.
    single_pixels : bool
        Whether a single pixel can be a point of light.

    Returns
    -------
    Detection

    Raises
    ------
    RetinaError
        The image is not grey, holds values that are not finite, or an option is out of range.
    """
    columns, about = _native.detect(
        _duck.image(image),
        None if mask is None else np.ascontiguousarray(mask, dtype=bool),
        bits,
        float(threshold_sigma),
        saturation_dn,
        gain_e_per_dn,
        spot_sigma_px,
        centroid,
        mesh_px,
        single_pixels,
    )
    return Detection(columns, about)
