"""The velocity weights f1 and f23 from level runs of one plate over ψ (Treers et al. 2021, §IV-A, eqs. 5-6).

Normalised to 1 at 1, f1(u) = [tanh(A2 u - A3) + tanh A3] / [tanh(A2 - A3) + tanh A3] with u = sin ψ, and f23 the same
with atanh and w = cos ψ: A1 and B1 cancel, and two coefficients shape each curve.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rft_ros.calibration.findings import CannotTell, Finding
from rft_ros.calibration.plate_runs import PlateRun
from rft_ros.rft.velocity_weights import A2, A3, B2, B3

__all__ = ["Sigmoid", "fit_f1", "fit_f23", "runs_over_psi"]

_SAME_BETA = 10.0
_FEWEST = 5
_SPAN = 60.0

_Function = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Sigmoid:
    """Coefficients (A2, A3) or (B2, B3) and the stress at 1 [N/cm³], with standard errors; `published` coefficients.

    `misfit`: RMS residual over the greatest stress.
    """

    name: str
    values: tuple[float, float, float]
    errors: tuple[float, float, float]
    published: tuple[float, float]
    misfit: float
    runs: int

    def finding(self) -> Finding:
        """What it came to, for the record."""
        letter = "A" if self.name == "f1" else "B"
        a, b = self.published
        return Finding(
            name=f"{self.name} ({letter}2, {letter}3, stress at 1)",
            values=self.values,
            errors=self.errors,
            unit="-, -, N/cm³",
            goodness=f"RMS {100 * self.misfit:.1f} % of the greatest; published {a:.3f}, {b:.3f}",
            source=f"{self.runs} level runs over ψ",
        )


def runs_over_psi(runs: Sequence[PlateRun]) -> list[PlateRun]:
    """The runs at the β that has most of them; CannotTell if they do not span ψ."""
    if not runs:
        raise CannotTell("no level run of a plate; f1 and f23 need runs at 5 or more ψ over 60°")
    groups = [[other for other in runs if abs(other.beta - run.beta) <= 0.5 * _SAME_BETA] for run in runs]
    used = max(groups, key=len)
    psi = sorted(run.psi for run in used)
    steps = 1 + int((np.diff(psi) > 2.0).sum())
    if steps < _FEWEST or psi[-1] - psi[0] < _SPAN:
        raise CannotTell(
            f"{len(used)} level runs at β = {used[0].beta:.0f}° have {steps} ψ from {psi[0]:.0f}° to {psi[-1]:.0f}°;"
            f" f1 and f23 need {_FEWEST} over {_SPAN:g}°"
        )
    return used


def fit_f1(runs: Sequence[PlateRun], *, zeta: float) -> Sigmoid:
    """A2, A3 and α_y from the forces along e1."""
    u = np.sin(np.deg2rad([run.psi for run in runs]))
    scale = np.array([1e-6 / (zeta * run.load) for run in runs])
    stress, error = scale * [r.along for r in runs], scale * [r.along_error for r in runs]
    return _fit("f1", np.tanh, u, stress, error, published=(A2, A3), highest=10.0)


def fit_f23(runs: Sequence[PlateRun], *, zeta: float) -> Sigmoid:
    """B2, B3 and α_x(β, γ = 0) from the forces along e2."""
    w = np.cos(np.deg2rad([run.psi for run in runs]))
    scale = np.array([1e-6 / (zeta * run.load) for run in runs])
    stress, error = scale * [r.across for r in runs], scale * [r.across_error for r in runs]
    return _fit("f23", np.arctanh, w, stress, error, published=(B2, B3), highest=1.0 - 1e-6)


def _fit(
    name: str,
    function: _Function,
    x: NDArray[np.float64],
    stress: NDArray[np.float64],
    error: NDArray[np.float64],
    *,
    published: tuple[float, float],
    highest: float,
) -> Sigmoid:
    """Least squares in the function's arguments at both ends, low = third coefficient and high = second - third.

    Both lie in (0, highest), which keeps atanh where it is defined.
    """

    def residuals(p: NDArray[np.float64]) -> NDArray[np.float64]:
        low, high, top = p
        bracket = function(np.array([high]))[0] + function(np.array([low]))[0]
        return np.asarray(top * (function((low + high) * x - low) + function(np.array([low]))[0]) / bracket - stress)

    start = [published[1], published[0] - published[1], float(stress.max())]
    bounds = ([1e-3, 1e-3, 0.0], [highest, highest, np.inf])
    if not stress.max() > 0.0:
        raise CannotTell(f"{name}: the forces do not oppose the motion (greatest stress {stress.max():.4f} N/cm³)")
    found = least_squares(residuals, start, bounds=bounds, x_scale=np.array([1.0, 1.0, stress.max()]), xtol=1e-12)
    freedom = len(x) - 3
    variance = max(2.0 * float(found.cost) / freedom, float(np.mean(error**2)))
    jacobian = np.asarray(found.jac, dtype=np.float64)  # dense, as the residuals come without a sparsity
    cov = variance * np.linalg.pinv(jacobian.T @ jacobian)
    low, high, top = found.x
    to_coefficients = np.array([[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    errors = np.sqrt(np.diag(to_coefficients @ cov @ to_coefficients.T))
    if bool(np.any(found.active_mask)) or errors[0] > low + high or errors[1] > low:
        raise CannotTell(
            f"{name}: the {len(x)} runs do not fix the curve: its coefficients come out as {low + high:.3f} ±"
            f" {errors[0]:.3f} and {low:.3f} ± {errors[1]:.3f}"
        )
    return Sigmoid(
        name=name,
        values=(float(low + high), float(low), float(top)),
        errors=(float(errors[0]), float(errors[1]), float(errors[2])),
        published=published,
        misfit=float(np.sqrt(np.mean(found.fun**2)) / stress.max()),
        runs=len(x),
    )
