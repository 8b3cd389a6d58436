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
        self,
        name: str,
        value: float,
        error: float,
        *,
        unit: str,
        goodness: str,
        source: str,
        spread: float = 0.0,
    ) -> None:
        """Add a fitted number, or the reason why the parameter does not take it."""
        with self.or_reason(name):
            self.fitted.append(
                FittedValue(name, (value,), (error,), unit, goodness, source, spread)
            )

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
    columns: Callable[[Array], Array],
    parameters: Sequence[Parameter],
    observed: Array,
    starts: Iterable[Array],
) -> Fit:
    """Fit a curve to a time series, shape [n, axes], any unit, by least squares from the best of the `starts` on.

    `columns`: from the parameters to the columns of further coefficients, in which the curve is linear, shape
    [n, axes, k]. These follow the parameters (variable projection: Golub and Pereyra, SIAM Journal on Numerical
    Analysis 10, 1973).
    """
    # in units of the steps: in those of the parameters a weak one would be dropped, and its error be 0
    step = np.array([parameter.step for parameter in parameters])
    low = np.array([parameter.low for parameter in parameters]) / step
    high = np.array([parameter.high for parameter in parameters]) / step
    linear_at = cache(lambda *scaled: _linear(columns(np.array(scaled) * step), observed))

    def misfit(at: Array) -> Array:
        _, residuals = linear_at(*at)
        return np.asarray(-residuals.ravel())

    def slopes(at: Array, ahead: Array, back: Array) -> Array:
        """Derivatives of the misfit between two places along each parameter, within the limits."""
        columns_of_slopes = []
        for k in range(len(at)):
            after = at.copy()
            before = at.copy()
            after[k] = min(at[k] + ahead[k], high[k])
            before[k] = max(at[k] - back[k], low[k])
            columns_of_slopes.append((misfit(after) - misfit(before)) / (after[k] - before[k]))
        return np.stack(columns_of_slopes, axis=1)

    one = np.ones(len(step))
    none = np.zeros(len(step))

    def one_sided(at: Array) -> Array:
        has_room = at + one <= high
        return slopes(at, np.where(has_room, one, none), np.where(has_room, none, one))

    best = min(
        (start / step for start in starts), key=lambda start: float(np.sum(misfit(start) ** 2))
    )
    found = least_squares(
        misfit,
        np.clip(best, low, high),
        jac=one_sided,
        bounds=(low, high),
        method="dogbox",
        ftol=_CONVERGED,
        xtol=_CONVERGED,
        max_nfev=_MOST_STEPS,
    )
    linear, residuals = linear_at(*found.x)
    coefficients = np.append(found.x * step, linear)

    def fit_with(width: Array) -> Fit:
        """The fit, with slopes over this width to either side."""
        influence = (np.linalg.pinv(slopes(found.x, width, width))[0] * step[0]).reshape(
            observed.shape
        )
        return Fit(
            coefficients, _error(influence, residuals, len(coefficients)), residuals, influence
        )

    # With memory the curve is not smooth. The standard error needs the slope over a step as wide as itself.
    narrow = fit_with(one)
    width = np.clip(narrow.error / step[0], one, np.maximum(one, _WIDEST * (high - low)))
    if (width == one).all():
        return narrow
    return max(narrow, fit_with(width), key=lambda fit: fit.error)


def _error(influence: Array, residuals: Array, free: int) -> float:
    """Standard error of the sum of `influence` times the noise, both of shape [n, axes]: the greater of two estimates.

    One is by Newey and West (Econometrica 55, 1987), where each residual counts at its own moment, such as at a corner,
    on scores whitened by the residuals' lag-one correlation (Andrews, 60, 1992): else errors from a few hundred samples
    are a third too small. The other takes the residuals as a stationary process of first order, for misfits of real
    grains that stay alike over hundreds of samples. `free`: the number of coefficients.
    """
    noise = residuals - residuals.mean(axis=0)
    alike = (noise[1:] * noise[:-1]).sum(axis=0) / np.maximum((noise**2).sum(axis=0), 1e-300)
    return float(
        np.sqrt(
            max(
                _by_moment(influence, residuals, alike, free),
                _stationary(influence, residuals, alike, free),
            )
        )
    )


def _by_moment(influence: Array, residuals: Array, alike: Array, free: int) -> float:
    """The variance by Newey and West. `alike`: the residuals' lag-one correlation, shape [axes]."""
    n = len(residuals)
    lags = int(4.0 * (n / 100.0) ** (2.0 / 9.0))
    scores = influence * residuals
    whitening = np.clip(alike, -_MOST_ALIKE, _MOST_ALIKE)
    white = (scores[1:] - whitening * scores[:-1]) / (1.0 - whitening)
    total = np.sum(white**2)
    for lag in range(1, lags + 1):
        total += 2.0 * (1.0 - lag / (lags + 1.0)) * np.sum(white[lag:] * white[:-lag])
    # coefficients and the kernel's width reduce the degrees of freedom
    return float(total * n / max(n - free - lags, 1))


def _stationary(influence: Array, residuals: Array, alike: Array, free: int) -> float:
    """The variance where the residuals are a stationary process of first order."""
    variances = (residuals**2).sum(axis=0) / max(len(residuals) - free, 1)
    total = 0.0
    for rho, own, variance in zip(
        np.clip(alike, -0.5, _SMOOTH), influence.T, variances, strict=True
    ):
        after = lfilter([1.0], [1.0, -rho], own)
        before = lfilter([1.0], [1.0, -rho], own[::-1])[::-1]
        total += variance * float(own @ (after + before - own))
    return total


def fit_each(
    fit: Callable[..., _Result], parts: Iterable[tuple[Any, ...]], *, none: str
) -> list[_Result]:
    """`fit(*part)` for each part of the recordings in which it is identifiable.

    If there is none, raises NotIdentifiable with the first one's reason, or with `none` if there are no parts.
    """
    fits = []
    reasons = []
    for part in parts:
        try:
            fits.append(fit(*part))
        except NotIdentifiable as reason:
            reasons.append(reason)
    if not fits:
        raise reasons[0] if reasons else NotIdentifiable(none)
    return fits
