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
from rft_ros.parameters import checked, defaults

__all__ = ["Curve", "Fit", "FitResults", "FittedValue", "Measurement", "NotIdentifiable", "best_start"]
__all__ += ["fit_curve", "fit_each", "fit_linear", "fit_measurements", "mean_of", "scatter_of_mean"]

Array = NDArray[np.float64]

_MOST_STEPS = 12  # of least squares
_CONVERGED = 1e-4  # relative change of the squares or the parameters at which least squares end
_WIDEST = 0.1  # greatest step for derivatives, relative to the range of a parameter
_MOST_ALIKE = 0.999  # greatest correlation of successive samples of noise

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
        if self.name in defaults():
            try:
                checked(self.name, self.values if len(self.values) > 1 else self.values[0])
            except InputError as error:
                raise NotIdentifiable(f"the fitted {error}") from None


@dataclass(slots=True)
class FitResults:
    """Fitted values; by name the reason why a value is not identifiable; warnings."""

    fitted: list[FittedValue] = field(default_factory=list)
    not_identifiable: dict[str, str] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)

    @contextmanager
    def or_reason(self, name: str) -> Iterator[None]:
        """Run the block; if it raises NotIdentifiable, record the reason under `name`."""
        try:
            yield
        except NotIdentifiable as reason:
            self.not_identifiable[name] = str(reason)


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
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return float(np.sqrt(np.mean(self.residuals**2)))


class Curve(NamedTuple):
    """A model with k coefficients: of parameters, which it is not linear in, to its columns for the linear ones.

    `columns`: from the parameters, shape [p], to shape [n, axes, k - p]. `steps`: changes of the parameters for
    derivatives. `low`, `high`: their limits. `expected`, `expected_error`: what is known of them, inf for nothing.
    """

    columns: Callable[[Array], Array]
    steps: Array
    low: Array
    high: Array
    expected: Array
    expected_error: Array

    def linear(self, parameters: Array, observed: Array) -> tuple[Array, Array, Array]:
        """The columns, the linear coefficients for these parameters, and the residuals, shape [n, axes]."""
        columns = self.columns(parameters)
        matrix = columns.reshape(observed.size, -1)
        linear = np.asarray(np.linalg.lstsq(matrix, observed.ravel(), rcond=None)[0], dtype=np.float64)
        return columns, linear, observed - (matrix @ linear).reshape(observed.shape)


def best_start(curve: Curve, observed: Array, starts: Iterable[Array]) -> Array:
    """The parameters among `starts` with the least residual."""
    return min(starts, key=lambda start: float(np.sum(curve.linear(start, observed)[2] ** 2)))


def fit_curve(curve: Curve, observed: Array, start: Array) -> Fit:
    """Fit a curve to a time series, shape [n, axes], any unit, by least squares from `start` on.

    Coefficients: the parameters, then that of each column. The residuals have the shape of `observed`.
    """
    size, known = len(start), np.isfinite(curve.expected_error)
    linear_at = cache(lambda *parameters: curve.linear(np.array(parameters), observed))

    def jacobian(at: Array, ahead: Array, back: Array) -> Array:
        columns, linear, _ = linear_at(*at)
        slopes = []
        for k in range(size):
            after, before = at.copy(), at.copy()
            after[k], before[k] = min(at[k] + ahead[k], curve.high[k]), max(at[k] - back[k], curve.low[k])
            change = curve.columns(after) - (curve.columns(before) if back[k] else columns)
            slopes.append(change @ linear / (after[k] - before[k]))
        return np.concatenate([np.stack(slopes, axis=-1), columns], axis=-1)

    def deviation(at: Array) -> float:
        columns, _, residuals = linear_at(*at)
        return float(max(_variances(columns, residuals)[1], 1e-300) ** 0.5)

    # in units of the steps; what is expected of a parameter counts as one more measurement
    parameters, low, high = (x / curve.steps for x in (start, curve.low, curve.high))
    for _ in range(1 + int(known.any())):  # the residuals of the first fit give the weight of what is expected
        weights = (deviation(parameters * curve.steps) / curve.expected_error)[known]

        def residuals_of(scaled: Array, weights: Array = weights) -> Array:
            at = scaled * curve.steps
            return np.append(-linear_at(*at)[2].ravel(), weights * (at - curve.expected)[known])

        def slopes_of(scaled: Array, weights: Array = weights) -> Array:
            at = scaled * curve.steps
            one_sided = np.where(at + curve.steps > curve.high, -1.0, 1.0) * curve.steps
            total = jacobian(at, one_sided, np.zeros(size)).reshape(observed.size, -1)
            slopes, basis = total[:, :size] * curve.steps, np.linalg.qr(total[:, size:])[0]
            slopes -= basis @ (basis.T @ slopes)  # the linear coefficients follow the parameters
            return np.vstack([slopes, weights[:, None] * np.diag(curve.steps)[known]])

        parameters = least_squares(
            residuals_of,
            np.clip(parameters, low, high),
            slopes_of,
            bounds=(low, high),
            method="dogbox",
            ftol=_CONVERGED,
            xtol=_CONVERGED,
            max_nfev=_MOST_STEPS,
        ).x
    at = parameters * curve.steps
    _, linear, residuals = linear_at(*at)
    weight = np.where(known, curve.expected_error, np.inf) ** -2.0

    def fit(steps: Array) -> Fit:
        slopes = jacobian(at, steps, steps)
        variance, total = deviation(at) ** 2, slopes.reshape(observed.size, -1)
        normal = total.T @ total / variance
        normal[range(size), range(size)] += weight
        # in units of the steps: in those of the parameters a weak one would be dropped, and its error be 0
        units = np.append(curve.steps, np.ones(len(linear)))
        scaled = np.linalg.pinv(normal * np.outer(units, units), hermitian=True)
        inverse = np.asarray(scaled * np.outer(units, units), dtype=np.float64)
        covariance = _covariance(slopes, residuals, inverse / variance)
        covariance += (inverse[:, :size] * weight) @ inverse[:size]
        return Fit(np.append(at, linear), covariance, residuals, inverse @ total.T / variance)

    found = fit(curve.steps)
    # With memory the curve is not smooth. The standard error needs the slope over a step as wide as itself.
    wide = np.minimum(found.errors[:size], _WIDEST * (curve.high - curve.low))
    if (wide > curve.steps).any():
        return max(found, fit(np.maximum(curve.steps, wide)), key=lambda one: float(one.errors[0]))
    return found


def fit_linear(columns: Array, observed: Array) -> Fit:
    """Least squares of a time series, shape [n, axes], any unit, on columns of shape [n, axes, k]."""
    matrix = columns.reshape(observed.size, -1)
    coefficients = np.asarray(np.linalg.lstsq(matrix, observed.ravel(), rcond=None)[0], dtype=np.float64)
    residuals = observed - (matrix @ coefficients).reshape(observed.shape)
    inverse = np.asarray(np.linalg.pinv(matrix.T @ matrix, hermitian=True), dtype=np.float64)
    return Fit(coefficients, _covariance(columns, residuals, inverse), residuals, inverse @ matrix.T)


def _correlated(columns: Array, residuals: Array) -> tuple[Array, float]:
    """Covariance of `columns`.T @ noise, columns of shape [n, k]; the variance of a sample, times (1 + ρ) / (1 - ρ).

    The noise is a process of first order with the variance and the correlation of the residuals, shape [n].
    """
    n, power = len(residuals), float(residuals @ residuals)
    rho = float(residuals[1:] @ residuals[:-1]) / power if power > 0.0 else 0.0
    rho = float(np.clip(rho, -0.5, _MOST_ALIKE))
    before = lfilter([1.0], [1.0, -rho], columns, axis=0)
    after = lfilter([1.0], [1.0, -rho], columns[::-1], axis=0)[::-1]
    one = power / max(n - columns.shape[1], 1)
    return one * columns.T @ (before + after - columns), one * (1.0 + rho) / (1.0 - rho)


def _variances(jacobian: Array, residuals: Array) -> tuple[Array, float]:
    """Sum over the axes of `_correlated`, and the mean over the axes of its second number."""
    each = [_correlated(jacobian[:, k], residuals[:, k]) for k in range(residuals.shape[1])]
    return np.sum([variance for variance, _ in each], axis=0), float(np.mean([one for _, one in each]))


def _correlated_anyhow(columns: Array, residuals: Array) -> Array:
    """Covariance of `columns`.T @ noise, columns of shape [n, k], where each residual counts at its own moment.

    Newey and West's estimate (Econometrica 55, 1987) on scores whitened by the residuals' lag-one correlation (Andrews,
    60, 1992): else errors from a few hundred samples are a third too small.
    """
    n, k = columns.shape
    e = residuals - residuals.mean()
    power = float(e @ e)
    # at a correlation of 1 the variance of a mean is unbounded
    rho = float(np.clip(e[1:] @ e[:-1] / power, -0.97, 0.97)) if power > 0.0 else 0.0
    scores = columns * residuals[:, None]
    scores = scores[1:] - rho * scores[:-1]
    lags = int(4.0 * (n / 100.0) ** (2.0 / 9.0))
    total = scores.T @ scores
    for lag in range(1, lags + 1):
        product = scores[lag:].T @ scores[:-lag]
        total += (1.0 - lag / (lags + 1.0)) * (product + product.T)
    # the coefficients and the kernel's width reduce the degrees of freedom
    return np.asarray(total / (1.0 - rho) ** 2 * n / max(n - k - lags, 1))


def _covariance(jacobian: Array, residuals: Array, inverse: Array) -> Array:
    """Covariance of coefficients: the greater of two estimates, by the error of the first coefficient.

    One takes the residuals as a stationary process. The other takes each residual at its own moment, such as at a
    corner.
    """
    axes = range(residuals.shape[1])
    anyhow = np.sum([_correlated_anyhow(jacobian[:, axis], residuals[:, axis]) for axis in axes], axis=0)
    found = [inverse @ total @ inverse for total in (_variances(jacobian, residuals)[0], anyhow)]
    return max(found, key=lambda covariance: float(covariance[0, 0]))


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


def scatter_of_mean(values: Sequence[float]) -> float:
    """Standard error of a mean, from the scatter of the values; 0 for one value."""
    return float(np.std(values, ddof=1)) / len(values) ** 0.5 if len(values) > 1 else 0.0


def mean_of(
    name: str,
    measurements: Sequence[Measurement],
    unit: str,
    goodness: str,
    *,
    error: float,
    spread: float = 0.0,
) -> FittedValue:
    """Mean of repeated measurements, with its standard error."""
    values = [m.value for m in measurements]
    each = ", ".join(f"{m.bag} {m.value:.3g} ± {m.error:.2g}" for m in measurements)
    return FittedValue(name, (float(np.mean(values)),), (error,), unit, goodness, each, spread)


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
