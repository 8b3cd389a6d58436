"""Least squares and means with standard errors, also for serially correlated residuals.

Load-cell noise is filtered and grains slip in bursts, so neighbouring samples are correlated. The usual standard errors
assume independent samples and come out several times too small.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from rft_ros.errors import InputError
from rft_ros.parameters import checked, defaults

__all__ = [
    "Fit",
    "FittedValue",
    "NotIdentifiable",
    "ProfileFit",
    "error_of_mean",
    "fit_each",
    "fit_measurements",
    "fit_profile",
    "fit_series",
    "mean_of",
]

_GRID = 24  # values of the nonlinear parameter tried before the best one is refined

_Result = TypeVar("_Result")


class NotIdentifiable(Exception):  # noqa: N818 (a result, not an error)
    """The data do not determine the quantity. One sentence with the numbers that show it."""


@dataclass(frozen=True, slots=True)
class FittedValue:
    """A fitted quantity: `values` and their standard `errors` in `unit`.

    `name`: the node's parameter that takes the values, or "alpha_y (MODEL)". `goodness`: of the fit, in words and
    numbers. `source`: what it was fitted to. Raises NotIdentifiable for values that the parameter does not take.
    """

    name: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    unit: str
    goodness: str
    source: str

    def __post_init__(self) -> None:
        if self.name in defaults():
            try:
                checked(self.name, self.values if len(self.values) > 1 else self.values[0])
            except InputError as error:
                raise NotIdentifiable(f"the fitted {error}") from None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fit:
    """Coefficients, shape [k], their covariance, shape [k, k], and the residuals, shape [n], in the data's units."""

    coefficients: NDArray[np.float64]
    covariance: NDArray[np.float64]
    residuals: NDArray[np.float64]

    @property
    def errors(self) -> NDArray[np.float64]:
        """Standard errors of the coefficients, shape [k], in their units."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ProfileFit:
    """The nonlinear `parameter` with its standard `error`, and the `linear` fit at that value."""

    parameter: float
    error: float
    linear: Fit


def _lag_one(series: NDArray[np.float64]) -> float:
    """Lag-one correlation, clipped to ±0.97: at ±1 the variance of a mean is unbounded."""
    power = float(series @ series)
    return min(max(float(series[1:] @ series[:-1]) / power, -0.97), 0.97) if power > 0.0 else 0.0


def _covariance(design: NDArray[np.float64], residuals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Covariance of least-squares coefficients under serially correlated residuals, shape [k, k].

    `design`: shape [n, k], rows in time order. Newey and West's estimate (Econometrica 55, 1987) with Bartlett weights
    and Andrews' number of lags (Econometrica 59, 1991), on scores whitened by the residuals' lag-one correlation
    (Andrews and Monahan, Econometrica 60, 1992). Without whitening, errors from a few hundred samples of filtered noise
    are a third too small.
    """
    n, k = design.shape
    e = residuals - residuals.mean()
    scores = design * residuals[:, None]
    first = _lag_one(e)
    scores = scores[1:] - first * scores[:-1]
    rho = _lag_one(e[1:] - first * e[:-1])
    ratio = 4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2)
    lags = min(math.ceil(1.1447 * (ratio * n) ** (1.0 / 3.0)), n // 4)
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    bread = np.linalg.pinv(design.T @ design)
    # the coefficients and the kernel's width reduce the degrees of freedom
    return np.asarray(bread @ total @ bread / (1.0 - first) ** 2 * n / max(n - k - lags, 1))


def error_of_mean(series: NDArray[np.float64]) -> float:
    """Standard error of the mean of a time series, shape [n], in its unit."""
    return float(np.sqrt(_covariance(np.ones((len(series), 1)), series - series.mean())[0, 0]))


def mean_of(values: Sequence[float], errors: Sequence[float]) -> tuple[float, float]:
    """Mean of repeated measurements and its standard error.

    The error is the greater of the one from their scatter and the one from their own errors: a few repetitions may
    agree by chance, and a single one does not show how bed and packing vary.
    """
    n = len(values)
    own = float(np.sqrt(np.sum(np.square(errors)))) / n
    between = float(np.std(values, ddof=1)) / n**0.5 if n > 1 else 0.0
    return float(np.mean(values)), max(own, between)


def fit_each(fit: Callable[..., _Result], cases: Iterable[tuple[Any, ...]], *, none: str) -> list[_Result]:
    """`fit(*case)` for each case in which it is identifiable.

    Raises NotIdentifiable if there is none: with the first case's reason, or with `none` if there are no cases.
    """
    fits, reasons = [], []
    for case in cases:
        try:
            fits.append(fit(*case))
        except NotIdentifiable as reason:
            reasons.append(str(reason))
    if not fits:
        raise NotIdentifiable(reasons[0] if reasons else none)
    return fits


def fit_series(design: NDArray[np.float64], observed: NDArray[np.float64]) -> Fit:
    """Least squares of a time series, shape [n], any unit, on the columns of `design`, shape [n, k], in time order."""
    coefficients = np.asarray(np.linalg.lstsq(design, observed, rcond=None)[0], dtype=np.float64)
    residuals = observed - design @ coefficients
    return Fit(coefficients=coefficients, covariance=_covariance(design, residuals), residuals=residuals)


def fit_measurements(
    design: NDArray[np.float64], observed: NDArray[np.float64], errors: NDArray[np.float64]
) -> tuple[Fit, float]:
    """Least squares of independent measurements with standard errors of their own; the fit and R².

    `observed`, `errors`: shape [m, axes]; `design`: shape [m * axes, k]. The variance of a measurement is the greater
    of its axis' scatter about the fit and its own error squared.
    """
    y = observed.ravel()
    inverse = np.linalg.pinv(design)
    found = inverse @ y
    residuals = y - design @ found
    freedom = max(1.0 - design.shape[1] / len(y), 1.0 / len(y))
    scatter = (residuals.reshape(observed.shape) ** 2).mean(axis=0) / freedom
    variance = np.maximum(scatter, errors**2).ravel()
    spread = float(((observed - observed.mean(axis=0)) ** 2).sum())
    r2 = 1.0 - float((residuals**2).sum()) / spread if spread > 0.0 else 1.0
    return Fit(coefficients=found, covariance=(inverse * variance) @ inverse.T, residuals=residuals), r2


def fit_profile(
    observed: NDArray[np.float64],
    shape: Callable[[float], NDArray[np.float64]],
    *,
    low: float,
    high: float,
    offset: bool,
) -> ProfileFit:
    """Least squares of scale · shape(parameter), plus a constant with `offset`; the parameter between low and high.

    `observed` and what `shape` returns: shape [n], any unit. The linear coefficients are the scale and, with `offset`,
    the constant.
    """

    def design(parameter: float) -> NDArray[np.float64]:
        column = shape(parameter)
        return np.column_stack([column, np.ones_like(column)] if offset else [column])

    def misfit(parameter: float) -> float:
        x = design(parameter)
        # normal equations are fast and accurate enough for at most two columns
        xx, xy = x.T @ x, x.T @ observed
        return float(-(xy @ np.linalg.pinv(xx) @ xy))

    grid = np.linspace(low, high, _GRID)
    best = int(np.argmin([misfit(p) for p in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, _GRID - 1)]
    parameter = float(minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-9}).x)
    linear = fit_series(design(parameter), observed)
    step = 1e-4 * (high - low)
    slope = linear.coefficients[0] * (shape(parameter + step) - shape(parameter - step)) / (2.0 * step)
    both = _covariance(np.column_stack([slope, design(parameter)]), linear.residuals)
    return ProfileFit(parameter=parameter, error=float(np.sqrt(both[0, 0])), linear=linear)
