"""α_y from plates dragged along e1, in themselves, at several β: constant, linear in β, or a table (paper, §IV-B).

The force along e1 is ζ α_y f1 d A with f1(1) = 1. The face that counts is one of the two: the model has one plate
element there, and the paper divides by one face's area.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rft_ros.calibration.findings import CannotTell, Finding, mean_of
from rft_ros.calibration.plate_runs import PlateRun
from rft_ros.rft.velocity_weights import exact_f1

__all__ = ["AlphaYFit", "AlphaYModel", "fit_alpha_y"]

AlphaYModel = Literal["auto", "constant", "linear", "table"]
"""Which model of α_y to fit; "auto": linear where the data are sure of a slope, else constant."""

_ALONG = 80.0
"""ψ [deg] from which on a plate counts as moved along e1: f1 is within 1 % of 1 there."""

_SAME_BETA = 5.0
_BETA_SPAN = 20.0
_SURE = 3.0
"""A slope in β that is less than this many standard errors from 0 is left out."""

_WRITTEN = np.arange(0.0, 91.0, 15.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class AlphaYFit:
    """What the runs say of α_y.

    `model` chosen; its `values` and standard `errors`: α_y [N/cm³], or intercept [N/cm³] and slope [N/cm³/deg], or α_y
    at each β of `rows`. `rows`: β [deg] and α_y [N/cm³] as the node's table takes them.
    """

    model: Literal["constant", "linear", "table"]
    values: tuple[float, ...]
    errors: tuple[float, ...]
    rows: tuple[tuple[float, float], ...]
    goodness: str
    runs: int

    def finding(self) -> Finding:
        """What it came to, for the record."""
        return Finding(
            name=f"alpha_y ({self.model})",
            values=self.values,
            errors=self.errors,
            unit="N/cm³, N/cm³/deg" if self.model == "linear" else "N/cm³",
            goodness=self.goodness,
            source=f"{self.runs} level runs along e1",
        )


def _ols(
    design: NDArray[np.float64], y: NDArray[np.float64], errors: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Coefficients, covariance and residuals; the variance is that of the scatter or of the runs' own errors."""
    inverse = np.linalg.pinv(design)
    found = inverse @ y
    residuals = y - design @ found
    freedom = len(y) - design.shape[1]
    scatter = float(residuals @ residuals) / freedom if freedom > 0 else 0.0
    return found, (inverse * np.maximum(errors**2, scatter)) @ inverse.T, residuals


def fit_alpha_y(
    runs: Sequence[PlateRun],
    *,
    zeta: float,
    zeta_error: float = 0.0,
    surface_error: float = 0.0,
    model: AlphaYModel = "auto",
) -> AlphaYFit:
    """Fit α_y to the runs along e1; the errors of ζ and of the surface height [m] are in those of the result.

    `auto`: linear if β spans 20° in three or more steps and its slope is sure, else constant.

    Raises CannotTell for too few runs or directions, and for an α_y that is not positive.
    """
    used = [run for run in runs if run.psi >= _ALONG]
    if not used:
        angles = ", ".join(f"{run.psi:.0f}°" for run in runs) or "none"
        raise CannotTell(f"no level run of a plate along e1 (ψ of {_ALONG:g}° or more); ψ of the runs: {angles}")
    beta = np.array([run.beta for run in used])
    factor = np.array([1e-6 / (zeta * run.load * exact_f1(np.sin(np.deg2rad(run.psi)))) for run in used])
    alpha = factor * [run.along for run in used]
    errors = factor * [run.along_error for run in used]
    shared = float(np.hypot(zeta_error / zeta, surface_error / np.mean([run.depth for run in used])))
    steps = _grouped(beta)
    span = float(np.ptp(beta))
    if model in ("linear", "table") and (len(steps) < 2 or span < _BETA_SPAN):
        raise CannotTell(
            f"the {len(used)} runs along e1 span {span:.0f}° of β in {len(steps)} steps; α_y {model} in β needs"
            f" {_BETA_SPAN:g}° and two steps"
        )
    if float(alpha.mean()) <= 0.0:
        raise CannotTell(
            f"α_y comes out as {alpha.mean():.4f} N/cm³: the grains oppose the motion; check sensor.sign,"
            " sensor.quaternion and medium.zeta (the edges' force is taken off)"
        )

    line, line_cov, line_rest = _ols(np.column_stack([np.ones_like(beta), beta]), alpha, errors)
    if model == "auto":
        sure = len(steps) >= 3 and span >= _BETA_SPAN and abs(line[1]) > _SURE * np.sqrt(line_cov[1, 1])
        model = "linear" if sure else "constant"
    if model == "table":
        groups = [(float(beta[g].mean()), *mean_of(alpha[g].tolist(), errors[g].tolist())) for g in steps]
        rows = tuple((round(b, 1), max(a, 0.0)) for b, a, _ in groups)
        values, own = np.array([a for _, a, _ in groups]), np.array([e for _, _, e in groups])
        goodness = f"{len(used)} runs at {len(groups)} β"
    elif model == "linear":
        values, own = line, np.sqrt(np.diag(line_cov))
        rows = tuple((float(b), max(float(line[0] + line[1] * b), 0.0)) for b in _WRITTEN)
        spread = float(((alpha - alpha.mean()) ** 2).sum())
        goodness = f"R² {1.0 - float(line_rest @ line_rest) / spread:.3f} over {len(used)} runs" if spread else ""
    else:
        found, cov, rest = _ols(np.ones((len(alpha), 1)), alpha, errors)
        values, own = found, np.sqrt(np.diag(cov))
        rows = ((90.0, float(found[0])),)
        goodness = f"scatter {100 * float(np.sqrt(np.mean(rest**2))) / found[0]:.1f} % over {len(used)} runs"
    return AlphaYFit(
        model=model,
        values=tuple(float(v) for v in values),
        errors=tuple(float(e) for e in np.hypot(own, shared * values)),
        rows=rows,
        goodness=goodness,
        runs=len(used),
    )


def _grouped(beta: NDArray[np.float64]) -> list[NDArray[np.int64]]:
    """Indices of runs at the same β, in ascending order."""
    order = np.argsort(beta, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(beta[order]) > _SAME_BETA) + 1)
