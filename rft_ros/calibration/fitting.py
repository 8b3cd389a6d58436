"""Least squares and means with standard errors, also of time series.

Load-cell noise is filtered and grains slip in bursts: errors for independent samples would be several times too small.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from rft_ros.errors import InputError
from rft_ros.parameters import checked, defaults

__all__ = ["Fit", "FittedValue", "Measurement", "NotIdentifiable", "fit_curve", "fit_each", "fit_measurements"]
__all__ += ["fit_series", "mean_of"]

Array = NDArray[np.float64]

_GRID = 24  # values of the nonlinear parameter tried before the best one is refined

_Result = TypeVar("_Result")


class NotIdentifiable(Exception):  # noqa: N818 (a result, not an error)
    """The data do not determine the quantity. One sentence with the numbers that show it."""


class Measurement(NamedTuple):
    """A quantity measured once, in one bag: `value` and standard `error`; `misfit`: RMS residual over the force."""

    bag: str
    value: float
    error: float
    misfit: float


@dataclass(frozen=True, slots=True)
class FittedValue:
    """A fitted quantity with its standard errors, named as the parameter that takes it or "alpha_y (MODEL)".

    Raises NotIdentifiable for values that the parameter does not take.
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


class Fit(NamedTuple):
    """Coefficients, shape [k], their covariance, and the residuals, shape [n].

    `inverse`, shape [k, n], times a change of the data is the change of the coefficients.
    """

    coefficients: Array
    covariance: Array
    residuals: Array
    inverse: Array

    @property
    def errors(self) -> Array:
        """Standard errors of the coefficients, shape [k], in their units."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def _series_fit(coefficients: Array, jacobian: Array, residuals: Array) -> Fit:
    """A fit to a time series, with the covariance under serially correlated residuals; `jacobian`: shape [n, k].

    Newey and West's estimate (Econometrica 55, 1987) on scores whitened by the residuals' lag-one correlation (Andrews,
    60, 1992): else errors from a few hundred samples are a third too small.
    """
    n, k = jacobian.shape
    e = residuals - residuals.mean()
    power = float(e @ e)
    # at a correlation of 1 the variance of a mean is unbounded
    rho = float(np.clip(e[1:] @ e[:-1] / power, -0.97, 0.97)) if power > 0.0 else 0.0
    scores = jacobian * residuals[:, None]
    scores = scores[1:] - rho * scores[:-1]
    lags = int(4.0 * (n / 100.0) ** (2.0 / 9.0))
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    bread = np.linalg.pinv(jacobian.T @ jacobian)
    # the coefficients and the kernel's width reduce the degrees of freedom
    covariance = bread @ total @ bread / (1.0 - rho) ** 2 * n / max(n - k - lags, 1)
    return Fit(coefficients, covariance, residuals, bread @ jacobian.T)


def fit_series(design: Array, observed: Array) -> Fit:
    """Least squares of a time series, shape [n], any unit, on the columns of `design`, shape [n, k]."""
    coefficients = np.asarray(np.linalg.lstsq(design, observed, rcond=None)[0], dtype=np.float64)
    return _series_fit(coefficients, design, observed - design @ coefficients)


def fit_curve(observed: Array, columns: Callable[[float], Array], *, low: float, high: float) -> Fit:
    """Least squares of a time series, shape [n], any unit, on `columns` of a parameter from low to high, shape [n, k].

    Coefficients: the parameter, then that of each column.
    """

    def misfit(parameter: float) -> float:
        x = columns(parameter)
        # normal equations are fast and accurate enough for at most two columns
        xx, xy = x.T @ x, x.T @ observed
        return float(-(xy @ np.linalg.pinv(xx) @ xy))

    grid = np.linspace(low, high, _GRID)
    best = int(np.argmin([misfit(p) for p in grid]))
    bounds = grid[max(best - 1, 0)], grid[min(best + 1, _GRID - 1)]
    parameter = float(minimize_scalar(misfit, bounds=bounds, method="bounded", options={"xatol": 1e-9}).x)
    x = columns(parameter)
    linear = np.linalg.lstsq(x, observed, rcond=None)[0]
    step = 1e-4 * (high - low)
    slope = (columns(parameter + step) - columns(parameter - step)) @ linear / (2.0 * step)
    return _series_fit(np.append(parameter, linear), np.column_stack([slope, x]), observed - x @ linear)


def fit_measurements(design: Array, observed: Array, errors: Array) -> Fit:
    """Least squares of independent measurements and their errors, shape [m, axes], on a design, shape [m * axes, k].

    The variance of one is the greater of its axis' scatter about the fit and its own error squared.
    """
    y = observed.ravel()
    inverse = np.asarray(np.linalg.pinv(design), dtype=np.float64)
    found = inverse @ y
    residuals = y - design @ found
    freedom = max(1.0 - design.shape[1] / len(y), 1.0 / len(y))
    scatter = (residuals.reshape(observed.shape) ** 2).mean(axis=0) / freedom
    variance = np.maximum(scatter, errors**2).ravel()
    return Fit(found, (inverse * variance) @ inverse.T, residuals, inverse)


def mean_of(name: str, measurements: Sequence[Measurement], unit: str, goodness: str) -> FittedValue:
    """Mean of repeated measurements; its error is the greater of that from their scatter and of their own."""
    values, n = [m.value for m in measurements], len(measurements)
    own = float(np.linalg.norm([m.error for m in measurements])) / n
    between = float(np.std(values, ddof=1)) / n**0.5 if n > 1 else 0.0
    each = ", ".join(f"{m.bag} {m.value:.3g} ± {m.error:.2g}" for m in measurements)
    return FittedValue(name, (float(np.mean(values)),), (max(own, between),), unit, goodness, each)


def fit_each(fit: Callable[..., _Result], parts: Iterable[tuple[Any, ...]], *, none: str) -> list[_Result]:
    """`fit(*part)` for each part of the recordings in which it is identifiable.

    If there is none, raises NotIdentifiable with the first one's reason, or with `none` if there are no parts.
    """
    fits, reasons = [], []
    for part in parts:
        try:
            fits.append(fit(*part))
        except NotIdentifiable as reason:
            reasons.append(reason)
    if not fits:
        raise reasons[0] if reasons else NotIdentifiable(none)
    return fits
