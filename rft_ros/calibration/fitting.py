"""Least squares and means with standard errors, also of time series.

Load-cell noise is filtered and grains slip in bursts: errors for independent samples would be several times too small.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import Bounds, minimize
from scipy.signal import lfilter

from rft_ros.errors import InputError
from rft_ros.parameters import checked

Array = NDArray[np.float64]

_SIMPLEX_SIZE_FACTOR = 2.0
"""Steps of the search ranges from the best start to the other corners of the first simplex."""

_SIMPLEX_TOLERANCE_SHARE = 0.2
"""Of a step: the search ends when the corners of the simplex are this close."""

_MAX_NOISE_CORRELATION_FACTOR = 0.97
"""Greatest correlation of successive samples of noise; at 1 the variance of a mean is unbounded."""

_MAX_MISFIT_CORRELATION_FACTOR = 0.999
"""The same, where the whole series is one misfit."""

_Result = TypeVar("_Result")


class NotIdentifiable(Exception):  # noqa: N818 (a result, not an error)
    """The data do not determine the quantity. One sentence with the numbers that show it."""


class Measurement(NamedTuple):
    """A quantity measured once, in one bag at a `time` since its beginning [s]: `value` and standard `error`."""

    bag: str
    value: float
    error: float
    time: float


def listed(measurements: Iterable[Measurement]) -> str:
    """The measurements in words, with their times where a bag has several."""
    listed_measurements = list(measurements)
    count = Counter(m.bag for m in listed_measurements)
    places = [
        f"{m.bag} at {m.time:.1f} s" if count[m.bag] > 1 else m.bag for m in listed_measurements
    ]
    numbers = [f"{m.value:.3g} ± {m.error:.2g}" for m in listed_measurements]
    return ", ".join(f"{place} {words}" for place, words in zip(places, numbers, strict=True))


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

    @property
    def taken(self) -> float | tuple[float, ...]:
        """As the parameter takes it."""
        return self.values if len(self.values) > 1 else self.values[0]

    def __post_init__(self) -> None:
        try:
            checked(self.name, self.taken)
        except InputError as error:
            raise NotIdentifiable(f"the fitted {error}") from None


@dataclass(frozen=True, slots=True, eq=False)
class MotionFit:
    """A kind of motion: the ζ that it alone would have, and the error of the force with the written ζ.

    `own_error`: standard error of this ζ by itself. `changes_by_cause`: its changes by a standard error of what all
    kinds share, such as the surface. `rms`: of the force [N]. `peak`: greatest measured force in this kind of motion
    [N].
    """

    kind: str
    zeta: float
    own_error: float
    changes_by_cause: Array
    rms: float
    peak: float

    @property
    def error(self) -> float:
        """Standard error of this ζ."""
        return float(np.linalg.norm([self.own_error, *self.changes_by_cause]))

    def __str__(self) -> str:
        return f"{self.kind}: ζ {self.zeta:.3g} ± {self.error:.2g} alone; RMS {self.rms:.2g} N of {self.peak:.3g} N"


@dataclass(slots=True)
class FitResults:
    """Fitted values; by name the reason why a value is not identifiable; kinds of motion in the grains; warnings.

    `refusals`: sentences on why the values must not be used, although they were fitted.
    """

    fitted_values: list[FittedValue] = field(default_factory=list)
    not_identifiable: dict[str, str] = field(default_factory=dict)
    motions: list[MotionFit] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)

    def add(
        self,
        name: str,
        value: float,
        error: float,
        *,
        goodness: str,
        source: str,
        unit: str = "m",
        spread: float = 0.0,
    ) -> None:
        """Add a fitted number, or the reason why the parameter does not take it."""
        with self.or_reason(name):
            fit = FittedValue(name, (value,), (error,), unit, goodness, source, spread)
            self.fitted_values.append(fit)

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


class SearchRange(NamedTuple):
    """Where a parameter of a curve is searched, in its unit: the change for derivatives, and the limits."""

    step: float
    low: float
    high: float


def _linear(columns: Array, series: Array) -> tuple[Array, Array]:
    """The coefficients of columns, shape [n, axes, k], by least squares, and the residuals, shape [n, axes]."""
    matrix = columns.reshape(series.size, -1)
    coefficients, *_ = np.linalg.lstsq(matrix, series.ravel(), rcond=None)
    return np.asarray(coefficients, float), series - (matrix @ coefficients).reshape(series.shape)


def fit_linear(columns: Array, series: Array) -> Fit:
    """Least squares of a time series, shape [n, axes], any unit, on columns of shape [n, axes, k]."""
    coefficients, residuals = _linear(columns, series)
    inverse = np.linalg.pinv(columns.reshape(series.size, -1))
    return _fit(coefficients, residuals, inverse[0])


def fit_curve(
    columns: Callable[[Array], Array],
    ranges: Sequence[SearchRange],
    series: Array,
    starts: Iterable[Array],
) -> Fit:
    """Fit a curve to a time series, shape [n, axes], any unit, by least squares from the best of the `starts` on.

    `columns`: from the parameters to the columns of further coefficients, in which the curve is linear, shape
    [n, axes, k]. These follow the parameters (variable projection: Golub and Pereyra, SIAM Journal on Numerical
    Analysis 10, 1973).
    """
    # in units of the steps: in those of the parameters a weak one would be dropped, and its error be 0
    step = np.array([search_range.step for search_range in ranges])
    low = np.array([search_range.low for search_range in ranges]) / step
    high = np.array([search_range.high for search_range in ranges]) / step
    linear_at = cache(
        lambda *scaled_parameters: _linear(columns(np.array(scaled_parameters) * step), series)
    )

    def residuals_at(scaled_parameters: Array) -> Array:
        _, residuals = linear_at(*scaled_parameters)
        return np.asarray(residuals.ravel())

    def squares(scaled_parameters: Array) -> float:
        return float(np.sum(residuals_at(scaled_parameters) ** 2))

    start = min((start / step for start in starts), key=squares)
    best = np.clip(start, low, high)
    # without derivatives: with memory the curve is not smooth
    simplex = best + _SIMPLEX_SIZE_FACTOR * np.eye(len(step) + 1, len(step), k=-1)
    optimum = minimize(
        squares,
        best,
        method="Nelder-Mead",
        bounds=Bounds(low, high),
        options={"initial_simplex": simplex, "xatol": _SIMPLEX_TOLERANCE_SHARE, "fatol": np.inf},
    ).x
    linear, residuals = linear_at(*optimum)
    coefficients = np.append(optimum * step, linear)

    slopes = []
    for offset in np.eye(len(step)):
        upper_point = np.minimum(optimum + offset, high)
        lower_point = np.maximum(optimum - offset, low)
        change = residuals_at(lower_point) - residuals_at(upper_point)
        slopes.append(change / (upper_point - lower_point).sum())
    inverse = np.linalg.pinv(np.stack(slopes, axis=1))
    return _fit(coefficients, residuals, inverse[0] * step[0])


def _fit(coefficients: Array, residuals: Array, flat_influence: Array) -> Fit:
    """The fit with the standard error of its first coefficient: the greater of two estimates.

    `flat_influence`, shape [n * axes], times a change of the data is the change of the first coefficient.

    One estimate is by Newey and West (Econometrica 55, 1987), where each residual counts at its own moment, such as at
    a corner, on scores whitened by the residuals' lag-one correlation (Andrews, 60, 1992): else errors from a few
    hundred samples are a third too small. The other takes the residuals as a stationary process of first order, for
    misfits of real grains that stay alike over hundreds of samples.
    """
    influence = flat_influence.reshape(residuals.shape)
    noise = residuals - residuals.mean(axis=0)
    neighbours = (noise[1:] * noise[:-1]).sum(axis=0)
    squares = (noise**2).sum(axis=0)
    lag_correlations = neighbours / np.maximum(squares, 1e-300)
    # those of short series are too small on average (Marriott and Pope, Biometrika 41, 1954)
    lag_correlations += (1.0 + 3.0 * lag_correlations) / len(residuals)
    free = len(coefficients)
    variance = max(
        _by_moment(influence, residuals, lag_correlations, free),
        _stationary(influence, residuals, lag_correlations, free),
    )
    # a curve that does not change with the coefficient does not determine it
    error = float(np.sqrt(variance)) if influence.any() else np.inf
    return Fit(coefficients, error, residuals, influence)


def _by_moment(influence: Array, residuals: Array, lag_correlations: Array, free: int) -> float:
    """The variance by Newey and West.

    `lag_correlations`: the residuals' lag-one correlation, shape [axes]. `free`: the number of coefficients.
    """
    n = len(residuals)
    lags = int(4.0 * (n / 100.0) ** (2.0 / 9.0))
    scores = influence * residuals
    whitening = np.clip(
        lag_correlations, -_MAX_NOISE_CORRELATION_FACTOR, _MAX_NOISE_CORRELATION_FACTOR
    )
    new = scores[1:] - whitening * scores[:-1]
    white = new / (1.0 - whitening)
    total = np.sum(white**2)
    for lag in range(1, lags + 1):
        weight = 1.0 - lag / (lags + 1.0)
        total += 2.0 * weight * np.sum(white[lag:] * white[:-lag])
    # coefficients and the kernel's width reduce the degrees of freedom
    return float(total * n / max(n - free - lags, 1))


def _stationary(influence: Array, residuals: Array, lag_correlations: Array, free: int) -> float:
    """The variance where the residuals are a stationary process of first order."""
    variances = (residuals**2).sum(axis=0) / max(len(residuals) - free, 1)
    correlations = np.clip(lag_correlations, -0.5, _MAX_MISFIT_CORRELATION_FACTOR)
    total = 0.0
    for rho, axis_influence, variance in zip(correlations, influence.T, variances, strict=True):
        earlier = lfilter([1.0], [1.0, -rho], axis_influence)
        total += variance * float(axis_influence @ (2.0 * earlier - axis_influence))
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
