"""The workbench: how far a model is from measurements, and which physical effect it lacks."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any

from . import _duck, _native
from ._calibrate import Calibrations, native_calibration
from ._duck import PathLike
from ._effects import Effects, OwnEffect
from ._findings import Comparison, Diagnosis, Fit, Investigation
from ._setup import Setup, setup_of


def _investigated(
    what: str,
    setup: Setup | PathLike,
    data: Any,
    calibration: Calibrations | None,
    effects: Effects | Sequence[Effects],
    baseline: str,
    flips: int = 1999,
    seed: int = 1,
    terms: int = 3,
) -> _native.Findings:
    own = setup_of(setup)
    listed = [effects] if isinstance(effects, (str, os.PathLike, OwnEffect)) else list(effects)
    described = [effect._described() if isinstance(effect, OwnEffect) else os.fspath(effect) for effect in listed]
    return _native.investigate(
        what,
        own._native,
        _duck.table(data),
        native_calibration(calibration, own),
        described,
        baseline,
        flips,
        seed,
        terms,
    )


def compare(
    setup: Setup | PathLike,
    data: Any,
    calibration: Calibrations | None = None,
    *,
    effects: Effects | Sequence[Effects] = (),
    baseline: str = "physical",
) -> Comparison:
    """Compare a model with measurements: errors, noise, and what the errors depend on.

    Parameters
    ----------
    setup : Setup, path or str
        The facility.
    data : table, path or sequence of paths
        Points, power readings, a phase curve, or (files only) frames. A table is a dict of arrays or anything with
        columns.
    calibration : optional
        Held fixed: of points its distortion, of power readings its response.
    effects : str, path, OwnEffect, or a sequence of them
        Effects to fit: ids of the catalogue, files with formulas, functions.
    baseline : str
        ``physical``, ``polynomial:N`` with N from 1 to 7, or a lens model (``pinhole``, ``fisheye:equidistant``,
        ``fisheye:equisolid``, ``fisheye:stereographic``, ``fisheye:kannala-brandt``, ``rational``). Frames:
        ``physical`` or ``gain``.

    Returns
    -------
    Comparison

    Raises
    ------
    RetinaError
        The table, the calibration or an effect does not fit.
    """
    return Comparison(_investigated("compare", setup, data, calibration, effects, baseline))


def diagnose(
    setup: Setup | PathLike,
    data: Any,
    calibration: Calibrations | None = None,
    *,
    effects: Effects | Sequence[Effects] = (),
    baseline: str = "physical",
    flips: int = 1999,
    seed: int = 1,
) -> Diagnosis:
    """Find the physical effect that a model lacks, and what to measure next.

    Parameters
    ----------
    setup, data, calibration, effects, baseline
        As `compare` takes them. `effects` are those that the model already has.
    flips : int
        Number of sign flips of whole groups, 199 to 99999. The smallest p-value is 1 / (flips + 1).
    seed : int
        Seed of the sign flips.

    Returns
    -------
    Diagnosis

    Raises
    ------
    RetinaError
        The table, the calibration or an effect does not fit.
    """
    return Diagnosis(_investigated("diagnose", setup, data, calibration, effects, baseline, flips, seed))


def investigate(
    setup: Setup | PathLike,
    data: Any,
    calibration: Calibrations | None = None,
    *,
    effects: Effects | Sequence[Effects] = (),
    baseline: str = "physical",
    terms: int = 3,
    seed: int = 1,
) -> Investigation:
    """Look for a formula where no known effect fits, and prove it on exposures that the search has not seen.

    Parameters
    ----------
    setup, data, calibration, effects, baseline
        As `compare` takes them. `effects` are those that the model already has.
    terms : int
        Most formulas to look for, one beside the other, 1 to 8.
    seed : int
        Seed of the sign flips.

    Returns
    -------
    Investigation

    Raises
    ------
    RetinaError
        The table has too few groups to be halved; the calibration or an effect does not fit.
    """
    return Investigation(
        _investigated("investigate", setup, data, calibration, effects, baseline, seed=seed, terms=terms)
    )


def fit(
    setup: Setup | PathLike,
    data: Any,
    effects: Effects | Sequence[Effects],
    calibration: Calibrations | None = None,
    *,
    baseline: str = "physical",
) -> Fit:
    """Fit effects together with the baseline model.

    Parameters
    ----------
    setup, data, effects, calibration, baseline
        As `compare` takes them.

    Returns
    -------
    Fit

    Raises
    ------
    RetinaError
        The table, the calibration or an effect does not fit.
    """
    return Fit(_investigated("fit", setup, data, calibration, effects, baseline))
