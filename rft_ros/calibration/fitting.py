"""Least squares and means with standard errors, also of time series.

Load-cell noise is filtered and grains slip in bursts: errors for independent samples would be several times too small.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.signal import lfilter

from rft_ros.errors import InputError
from rft_ros.parameters import checked

__all__ = ["Estimates", "Fit", "FitResults", "FittedValue", "Measurement", "MotionFit", "NotIdentifiable"]
__all__ += ["Parameter", "fit_curve", "fit_each", "fit_linear", "fit_measurements", "listed"]

Array = NDArray[np.float64]

_MOST_STEPS = 12  # of least squares
_CONVERGED = 1e-4  # relative change of the squares or the parameters at which least squares end
_WIDEST = 0.1  # greatest step for derivatives, relative to the range of a parameter
_MOST_ALIKE = 0.97  # greatest correlation of successive samples of noise; at 1 the variance of a mean is unbounded
_SMOOTH = 0.999  # the same, where the whole series is one misfit

_Result = TypeVar("_Result")


class NotIdentifiable(Exception):  # noqa: N818 (a result, not an error)
    """The data do not determine the quantity. One sentence with the numbers that show it."""


class Measurement(NamedTuple):
    """A quantity measured once, in one bag: `value` and standard `error`."""

    bag: str
    value: float
    error: float


def listed(measurements: Iterable[Measurement]) -> str:
    """The measurements in words."""
    return ", ".join(f"{m.bag} {m.value:.3g} ± {m.error:.2g}" for m in measurements)


@dataclass(frozen=True, slots=True)
class FittedValue:
    """A fitted quantity with its standard errors, named as the parameter that takes it.

    `spread`: how far the mean is from what the tools or recordings gave by themselves, relative to that.

    Raises NotIdentifiable for values that the parameter does not take.
    """

    name: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    unit: str
    goodness: str
    source: str
    spread: float = 0.0

    def __post_init__(self) -> None:
        try:
            checked(self.name, self.values if len(self.values) > 1 else self.values[0])
        except InputError as error:
            raise NotIdentifiable(f"the fitted {error}") from None


@dataclass(frozen=True, slots=True, eq=False)
class MotionFit:
    """A kind of motion: the ζ that it alone would have, and the error of the force with the written ζ.

    `own_error`: standard error of this ζ by itself. `by_causes`: its changes by a standard error of what all kinds
    share, such as the surface. `rms`: of the force [N]. `peak`: greatest measured force in this kind of motion [N].
    """

    kind: str
    zeta: float
    own_error: float
    by_causes: Array
    rms: float
    peak: float

    @property
    def error(self) -> float:
        """Standard error of this ζ."""
        return float(np.linalg.norm([self.own_error, *self.by_causes]))

    def __str__(self) -> str:
        return f"{self.kind}: ζ {self.zeta:.3g} ± {self.error:.2g} alone; RMS {self.rms:.2g} N of {self.peak:.3g} N"


@dataclass(slots=True)
class FitResults:
    """Fitted values; by name the reason why a value is not identifiable; kinds of motion in the grains; warnings."""

    fitted: list[FittedValue] = field(default_factory=list)
    not_identifiable: dict[str, str] = field(default_factory=dict)
    motions: list[MotionFit] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)

    def add(
        self, name: str, value: float, error: float, *, unit: str, goodness: str, source: str, spread: float = 0.0
    ) -> None:
        """Add a fitted number, or the reason why the parameter does not take it."""
        with self.or_reason(name):
            self.fitted.append(FittedValue(name, (value,), (error,), unit, goodness, source, spread))

    @contextmanager
    def or_reason(self, name: str) -> Iterator[None]:
        """Run the block; if it raises NotIdentifiable, record the reason under `name`."""
        try:
            yield
        except NotIdentifiable as reason:
            self.not_identifiable[name] = str(reason)


class Fit(NamedTuple):
    """Least squares of a time series, shape [n, axes].

    `coefficients`: the parameters of a curve, then those that it is linear in. `error`: standard error of the first
    coefficient, in its unit. `influence`, shape [n, axes], times a change of the data is the change of the first one.
    """

    coefficients: Array
    error: float
    residuals: Array
    influence: Array

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))


class Parameter(NamedTuple):
    """A parameter of a curve, in its unit: the change for derivatives, and the limits."""

    step: float
    low: float
    high: float


def _linear(columns: Array, observed: Array) -> tuple[Array, Array]:
    """The coefficients of columns, shape [n, axes, k], by least squares, and the residuals, shape [n, axes]."""
    matrix = columns.reshape(observed.size, -1)
    found = np.asarray(np.linalg.lstsq(matrix, observed.ravel(), rcond=None)[0], dtype=np.float64)
    return found, observed - (matrix @ found).reshape(observed.shape)


def fit_linear(columns: Array, observed: Array) -> Fit:
    """Least squares of a time series, shape [n, axes], any unit, on columns of shape [n, axes, k]."""
    coefficients, residuals = _linear(columns, observed)
    influence = np.linalg.pinv(columns.reshape(observed.size, -1))[0].reshape(observed.shape)
    return Fit(coefficients, _error(influence, residuals, len(coefficients)), residuals, influence)


def fit_curve(
    columns: Callable[[Array], Array], parameters: Sequence[Parameter], observed: Array, starts: Iterable[Array]
) -> Fit:
    """Fit a curve to a time series, shape [n, axes], any unit, by least squares from the best of the `starts` on.

    `columns`: from the parameters to the columns of further coefficients, in which the curve is linear, shape
    [n, axes, k]. These follow the parameters (variable projection: Golub and Pereyra, SIAM Journal on Numerical
    Analysis 10, 1973).
    """
    # in units of the steps: in those of the parameters a weak one would be dropped, and its error be 0
    step, low, high = np.array(parameters).T
    low, high = low / step, high / step
    linear_at = cache(lambda *scaled: _linear(columns(np.array(scaled) * step), observed))
    start = min((start / step for start in starts), key=lambda start: float(np.sum(linear_at(*start)[1] ** 2)))
    one, free = np.ones(len(step)), len(step) + len(linear_at(*start)[0])

    def misfit(at: Array) -> Array:
        return np.asarray(-linear_at(*at)[1].ravel())

    def slopes(at: Array, ahead: Array, back: Array) -> Array:
        after, before = np.clip(at + ahead, low, high), np.clip(at - back, low, high)
        moved = [[np.where(own, end, at) for end in (after, before)] for own in np.eye(len(at), dtype=np.bool_)]
        return np.stack([misfit(above) - misfit(below) for above, below in moved], axis=1) / (after - before)

    def slopes_of(at: Array) -> Array:
        return slopes(at, np.where(at + one > high, -one, one), 0.0 * one)

    limits: dict[str, Any] = {"ftol": _CONVERGED, "xtol": _CONVERGED, "max_nfev": _MOST_STEPS}
    at = least_squares(misfit, np.clip(start, low, high), slopes_of, (low, high), "dogbox", **limits).x
    linear, residuals = linear_at(*at)

    def fit_with(width: Array) -> Fit:
        """The fit, with slopes over this width to either side."""
        influence = (np.linalg.pinv(slopes(at, width, width))[0] * step[0]).reshape(observed.shape)
        return Fit(np.append(at * step, linear), _error(influence, residuals, free), residuals, influence)

    found = fit_with(one)
    # With memory the curve is not smooth. The standard error needs the slope over a step as wide as itself.
    wide = np.clip(found.error / step[0], one, np.maximum(one, _WIDEST * (high - low)))
    return max(found, fit_with(wide), key=lambda fit: fit.error) if (wide > one).any() else found


def _error(influence: Array, residuals: Array, free: int) -> float:
    """Standard error of the sum of `influence` times the noise, both of shape [n, axes]: the greater of two estimates.

    One is by Newey and West (Econometrica 55, 1987), where each residual counts at its own moment, such as at a corner,
    on scores whitened by the residuals' lag-one correlation (Andrews, 60, 1992): else errors from a few hundred samples
    are a third too small. The other takes the residuals as a stationary process of first order, for misfits of real
    grains that stay alike over hundreds of samples. `free`: the number of coefficients.
    """
    n, scores = len(residuals), influence * residuals
    noise = residuals - residuals.mean(axis=0)
    rho = (noise[1:] * noise[:-1]).sum(axis=0) / np.maximum((noise**2).sum(axis=0), 1e-300)
    whitening = np.clip(rho, -_MOST_ALIKE, _MOST_ALIKE)
    scores = (scores[1:] - whitening * scores[:-1]) / (1.0 - whitening)
    lags = int(4.0 * (n / 100.0) ** (2.0 / 9.0))
    total = np.sum(scores**2)
    for lag in range(1, lags + 1):
        total += 2.0 * (1.0 - lag / (lags + 1.0)) * np.sum(scores[lag:] * scores[:-lag])
    by_moment = total * n / max(n - free - lags, 1)  # coefficients and the kernel's width reduce the degrees of freedom
    stationary = 0.0
    for alike, own, power in zip(np.clip(rho, -0.5, _SMOOTH), influence.T, (residuals**2).sum(axis=0), strict=True):
        after, before = (lfilter([1.0], [1.0, -alike], way) for way in (own, own[::-1]))
        stationary += power / max(n - free, 1) * float(own @ (after + before[::-1] - own))
    return float(np.sqrt(max(by_moment, stationary)))


class Estimates(NamedTuple):
    """Coefficients, shape [k], their covariance, and the residuals of m measurements, shape [m, axes].

    `inverse`, shape [k, m * axes], times a change of the measurements is the change of the coefficients.
    """

    coefficients: Array
    covariance: Array
    residuals: Array
    inverse: Array

    @property
    def errors(self) -> Array:
        """Standard errors of the coefficients, shape [k], in their units."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


def fit_measurements(design: Array, observed: Array, errors: Array) -> Estimates:
    """Least squares of independent measurements and their errors, shape [m, axes], on a design, shape [m, axes, k].

    The variance of one is the greater of its axis' scatter about the fit and its own error squared.
    """
    matrix = design.reshape(observed.size, -1)
    inverse = np.asarray(np.linalg.pinv(matrix), dtype=np.float64)
    found = inverse @ observed.ravel()
    residuals = observed - (matrix @ found).reshape(observed.shape)
    freedom = np.sum(1.0 - np.einsum("nk,kn->n", matrix, inverse).reshape(observed.shape), axis=0)
    scatter = np.sum(residuals**2, axis=0) / np.maximum(freedom, 1.0)
    variance = np.maximum(scatter, errors**2).ravel()
    return Estimates(found, (inverse * variance) @ inverse.T, residuals, inverse)


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
