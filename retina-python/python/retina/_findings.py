"""What the workbench finds: comparisons, diagnoses, fits and formulas."""

from __future__ import annotations

import html
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from . import _native
from ._duck import PathLike
from ._notebook import Figure, Report, shown, table_html


class _Findings(Report):
    """What the workbench's results share."""

    def __init__(self, native: _native.Findings) -> None:
        super().__init__(native.document())
        self._native = native

    @property
    def rows(self) -> int:
        """Rows of the table."""
        return int(self._document["rows"])

    @property
    def outliers(self) -> int:
        """Number of outliers."""
        return int(self._document["outliers"])

    @property
    def notes(self) -> list[str]:
        """What was done with the table."""
        return self._texts("notes")

    def plot(self) -> Figure:
        """Draw the model's errors over the field and against the columns; of frames, the images."""
        return Figure(self._native.svg())

    def to_html(self) -> str:
        """Return the command's report page, which opens offline."""
        return self._native.html()

    def write_report(self, path: PathLike) -> None:
        """Write the command's report page."""
        self._native.write_report(os.fspath(path))

    def __str__(self) -> str:
        return "\n".join(self._native.text())


class Comparison(_Findings):
    """How far a model is from measurements, and on what its errors depend."""

    @property
    def rms(self) -> float:
        """Weighted root mean square of the errors per axis, without outliers, in `unit`."""
        return float(self._document["rms"])

    @property
    def noise_floor(self) -> float:
        """The noise, as it is known apart from the model, in `unit`."""
        return float(self._document["noise_floor"])

    @property
    def unit(self) -> str:
        """``arcsec``, ``relative``, ``mag`` or ``DN``."""
        return str(self._document["unit"])

    @property
    def percentiles(self) -> dict[str, float]:
        """Sizes of the errors at 50, 68, 90, 95, 96 and 99 per cent, in `unit`."""
        return dict(self._document["percentiles"])

    @property
    def fraction_within_10_arcsec(self) -> float | None:
        """Share of the points within 10 arcsec; None of other tables."""
        return self._optional("fraction_within_10_arcsec")

    @property
    def dependence(self) -> list[dict[str, Any]]:
        """Columns on which the errors depend: ``covariates``, ``p_value``, ``share``."""
        return list(self._document["dependence"])

    @property
    def worst_groups(self) -> list[dict[str, Any]]:
        """Exposures, series or nights with the largest errors."""
        return list(self._document["worst_groups"])

    def __repr__(self) -> str:
        return f"<Comparison: {self.rms:.4g} {self.unit} rms, noise {self.noise_floor:.4g}>"

    def _repr_html_(self) -> str:
        rows = [("rms", f"{self.rms:.4g} {self.unit}"), ("noise floor", f"{self.noise_floor:.4g} {self.unit}")]
        rows += [(", ".join(d["covariates"]), f"p {d['p_value']:.2g}") for d in self.dependence[:8]]
        return table_html("comparison", ("", ""), rows)


@dataclass(frozen=True)
class Candidate:
    """An effect that was tried.

    Attributes
    ----------
    effect : str
        Its id.
    p_value : float
        Corrected for the number of candidates tried.
    heldout_rms : float
        Error of held-out groups with it, in the table's unit.
    parameters : dict
        By name ``value`` and ``sigma``.
    """

    effect: str
    p_value: float
    heldout_rms: float
    parameters: dict[str, Any]


class Diagnosis(_Findings):
    """Which physical effect a model lacks, and what to measure next."""

    @property
    def verdict(self) -> str:
        """``adequate``, ``named``, ``confounded``, ``unknown`` or ``undecided``."""
        return str(self._document["verdict"])

    @property
    def headline(self) -> str:
        """The verdict in a sentence."""
        return str(self._document.get("headline") or "")

    @property
    def accepted(self) -> list[str]:
        """Ids of the effects that were accepted, in their order."""
        return self._texts("accepted")

    @property
    def candidates(self) -> list[Candidate]:
        """Effects that were tried, the best first."""
        names = ("effect", "p_value", "heldout_rms", "parameters")
        return [Candidate(**{name: entry[name] for name in names}) for entry in self._document["candidates"]]

    @property
    def indistinguishable(self) -> list[str]:
        """The effects that these data cannot tell apart."""
        return self._texts("indistinguishable")

    @property
    def next_measurement(self) -> dict[str, Any] | None:
        """What to measure next: ``action``, ``value``, ``separates``, ``expected_sigma``."""
        following: dict[str, Any] | None = self._document["next_measurement"]
        return following

    @property
    def baseline_heldout_rms(self) -> float:
        """Error of held-out groups by the baseline alone, in `unit`."""
        return float(self._document["baseline"]["heldout_rms"])

    @property
    def noise_floor(self) -> float:
        """The noise, as it is known apart from the model, in `unit`."""
        return float(self._document["baseline"]["noise_floor"])

    @property
    def unit(self) -> str:
        """``arcsec``, ``relative``, ``mag`` or ``DN``."""
        return str(self._document["baseline"]["unit"])

    @property
    def steps(self) -> list[dict[str, Any]]:
        """How the held-out error falls: ``effects`` and ``heldout_rms`` of each step."""
        return list(self._document["steps"])

    @property
    def unexplained(self) -> dict[str, Any]:
        """Structure that no effect explains: ``p_value`` and ``covariates``."""
        return dict(self._document["unexplained"])

    def __repr__(self) -> str:
        return f"<Diagnosis: {self.verdict}{': ' if self.accepted else ''}{' and '.join(self.accepted)}>"

    def _repr_html_(self) -> str:
        steps = [(" + ".join(step["effects"]) or "baseline", f"{step['heldout_rms']:.4g} {self.unit}") for step in self.steps]
        tried = [(c.effect, f"{c.p_value:.2g}", f"{c.heldout_rms:.4g} {self.unit}") for c in self.candidates[:8]]
        return (
            f"<h4>{html.escape(self.verdict)}</h4><p>{html.escape(self.headline)}</p>"
            + table_html("held-out error", ("model", "rms"), steps)
            + table_html("candidates", ("effect", "p", "held-out rms"), tried)
        )


class Fit(_Findings):
    """Effects estimated together with the baseline."""

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """By name ``value`` and ``sigma``."""
        return dict(self._document["parameters"])

    @property
    def correlation(self) -> npt.NDArray[np.float64]:
        """Correlation of the parameters in `correlated`, shape (parameters, parameters)."""
        return np.array(self._document["correlation"]["matrix"], dtype=float)

    @property
    def correlated(self) -> list[str]:
        """Names of the parameters that `correlation` has; those chosen from lists have none."""
        return list(self._document["correlation"]["parameters"])

    @property
    def rms(self) -> float:
        """Weighted root mean square of the errors per axis, without outliers."""
        return float(self._document["rms"])

    @property
    def heldout_rms(self) -> float:
        """The same of held-out groups."""
        return float(self._document["heldout_rms"])

    @property
    def noise_floor(self) -> float:
        """The noise, as it is known apart from the model."""
        return float(self._document["noise_floor"])

    @property
    def predictions(self) -> dict[str, Any]:
        """Baseline, effect and error of every row, as columns; NaN of rows that were not fitted.

        Tables of points and frames also say where on the camera the row is: ``camera_x_px``, ``camera_y_px``.
        """
        return self._native.predictions()

    def write_model(self, path: PathLike) -> float:
        """Write the model as a calibration (tables of points only).

        Returns
        -------
        float
            How far the written polynomials are from the model, arcsec rms.
        """
        return self._native.write_model(os.fspath(path))

    def __repr__(self) -> str:
        return f"<Fit: {self.rms:.4g} rms, {self.heldout_rms:.4g} held out, noise {self.noise_floor:.4g}>"

    def _repr_html_(self) -> str:
        rows = ((name, shown(p["value"]), shown(p["sigma"])) for name, p in self.parameters.items())
        return table_html(f"fit, {self.heldout_rms:.4g} held out", ("parameter", "value", "sigma"), rows)


@dataclass(frozen=True)
class Formula:
    """A formula that was found, and held on exposures that the search has not seen.

    Attributes
    ----------
    name : str
        Its name.
    effect : str
        The text of an effect's file, which `effects=` takes after `write`.
    covariates : list of str
        The columns that it depends on.
    p_value : float
        Chance of as much agreement on unseen exposures where there is nothing.
    says : list of str
        What it says, in sentences.
    weak_beside : str or None
        A formula or effect that is so much stronger that this one may be only what it lacks.
    rivals : list of str
        Effects' files of formulas that these data cannot tell from it.
    """

    name: str
    effect: str
    covariates: list[str]
    p_value: float
    says: list[str]
    weak_beside: str | None
    rivals: list[str]

    def write(self, path: PathLike) -> None:
        """Write it as an effect's file."""
        Path(path).write_text(self.effect, encoding="utf-8")


class Investigation(_Findings):
    """Formulas of what a model leaves unexplained."""

    @property
    def verdict(self) -> str:
        """``found`` or ``nothing``."""
        return str(self._document["verdict"])

    @property
    def headline(self) -> str:
        """The verdict in a sentence."""
        return str(self._document["headline"])

    @property
    def known(self) -> list[str]:
        """Known effects that were found beside the formulas."""
        return self._texts("known")

    @property
    def known_weak(self) -> list[str]:
        """Known effects that may be only what a formula's laws lack: they are not in the model."""
        return [str(weak["effect"]) for weak in self._document["known_weak"]]

    @property
    def formulas(self) -> list[Formula]:
        """The formulas, in the order in which they were found."""
        return [
            Formula(
                name=term["name"],
                effect=term["effect_toml"],
                covariates=list(term["covariates"]),
                p_value=float(term["proof"]["p_value"]),
                says=list(term["says"]),
                weak_beside=term["weak_beside"],
                rivals=[rival["effect_toml"] for rival in term["rivals"]],
            )
            for term in self._document["terms"]
        ]

    @property
    def heldout_rms(self) -> float:
        """Error of held-out groups with all that was found."""
        return float(self._document["fit"]["heldout_rms"])

    @property
    def tried(self) -> int:
        """Number of formulas that were tried."""
        return int(self._document["tried"])

    def __repr__(self) -> str:
        found = "; ".join(", ".join(formula.covariates) for formula in self.formulas)
        return f"<Investigation: {self.verdict}{': ' if found else ''}{found}>"

    def _repr_html_(self) -> str:
        rows = [(f.name, ", ".join(f.covariates), f"{f.p_value:.2g}") for f in self.formulas]
        return f"<p>{html.escape(self.headline)}</p>" + table_html("formulas", ("name", "depends on", "p"), rows)
