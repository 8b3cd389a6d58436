"""Models of α_y, the stress per depth along e1, the horizontal direction in the plate (Treers et al. 2021, IV-B).

A model is a NamedTuple of numbers and arrays and a function ``alpha_y(model, sin_beta, cos_beta, sin_gamma, cos_gamma)
-> [N/cm³]``. numba compiles a kernel for each model's type. To add a model, write the NamedTuple and its function in
plain arithmetic, and name both in `_MODELS`.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.arguments import number, numbers
from rft_ros.rft.compilation import OPTIONS, inlined
from rft_ros.rft.media import Medium

__all__ = [
    "ALPHA_Y_MODELS",
    "AlphaY",
    "Constant",
    "Linear",
    "Table",
    "alpha_y",
    "alpha_y_model",
    "checked_alpha_y",
]


class Constant(NamedTuple):
    """The same α_y [N/cm³] at every attitude; the paper uses α_x(γ = 0, β = 0)."""

    value: float


class Linear(NamedTuple):
    """α_y = intercept + slope β, with β in degrees: [N/cm³], [N/cm³/deg] (the paper's second model)."""

    intercept: float
    slope: float


class Table(NamedTuple):
    """α_y [N/cm³] on a uniform grid of β and γ, bilinear between nodes, constant beyond the edges; see `sampled`.

    `values`: shape [n_beta, n_gamma], at least [2, 2]. The first node lies at `beta`, `gamma` [rad]; `beta_nodes` and
    `gamma_nodes` are nodes per radian.
    """

    beta: float
    beta_nodes: float
    gamma: float
    gamma_nodes: float
    values: NDArray[np.float64]

    @classmethod
    def sampled(cls, beta: ArrayLike, gamma: ArrayLike, values: ArrayLike) -> "Table":
        """A table from values, shape [n_beta, n_gamma], at any ascending β, shape [n_beta], and γ, shape [n_gamma].

        β and γ [rad], α_y [N/cm³]. The grid is the coarsest with a node at every β and γ (to 1e-9 of its range); the
        table is then exact everywhere. If no grid of up to `FINEST` steps has one, the finest is used: its nodes miss
        the values by up to half a step, 0.25° in 360°, and α_y errs by up to a quarter of a step times the change of
        slope.

        Raises ValueError that names the argument that cannot be used.
        """
        b, g = numbers("beta", beta), numbers("gamma", gamma)
        v = numbers("values", values, (len(g),), rows=len(b))
        for name, knots in (("beta", b), ("gamma", g)):
            if len(knots) == 0 or not np.isfinite(knots).all() or not (np.diff(knots) > 0.0).all():
                raise ValueError(f"{name} is {knots}; it must be finite and ascending, with at least one value")
        if not np.isfinite(v).all():
            raise ValueError("values has a number that is not finite")
        beta_nodes, v = _uniform(b, v)
        gamma_nodes, v = _uniform(g, v.T)
        return cls(float(b[0]), beta_nodes, float(g[0]), gamma_nodes, np.ascontiguousarray(v.T))


AlphaY = Constant | Linear | Table

FINEST = 720
"""Steps of the finest grid of `Table.sampled` over the range of β, or of γ."""

PAPER_LINEAR = Linear(0.2035, -0.0015)


def _uniform(knots: NDArray[np.float64], values: NDArray[np.float64]) -> tuple[float, NDArray[np.float64]]:
    """Nodes per radian of a uniform grid over the knots, and the rows of values there by linear interpolation."""
    if len(knots) == 1:
        return 0.0, np.repeat(values, 2, axis=0)
    span = knots[-1] - knots[0]
    place = (knots - knots[0]) / span
    on_nodes = (n for n in range(len(knots) - 1, FINEST) if np.abs(place - np.round(place * n) / n).max() < 1e-9)
    steps = next(on_nodes, FINEST)
    nodes = np.linspace(0.0, 1.0, steps + 1)
    return float(steps / span), np.column_stack([np.interp(nodes, place, column) for column in values.T])


_DEGREES = 180.0 / math.pi


@inlined
def _atan2(y: float, x: float) -> float:
    """atan2 by a rational fit (1e-13 rad), with selects instead of branches so that it vectorises; atan2(0, 0) = 0."""
    ax, ay = abs(x), abs(y)
    steep = ay > ax
    high = ay if steep else ax
    z = (ax if steep else ay) / (high if high > 0.0 else 1.0)
    t = z * z
    p = 0.9999999999999283 + t * (
        1.8181909718019935 + t * (1.0484966104272653 + t * (0.2084748631867935 + t * 0.010064531527009144))
    )
    q = 1.0 + t * (
        2.151524305115005
        + t * (1.5656713797337238 + t * (0.4429175882067973 + t * (0.04081911121290752 + t * 0.0005401519946349882)))
    )
    a = z * p / q
    a = 0.5 * math.pi - a if steep else a
    a = math.pi - a if x < 0.0 else a
    return -a if y < 0.0 else a


@inlined
def _beta(sin_beta, cos_beta):  # type: ignore[no-untyped-def]
    """Attack angle β [rad], Eq. (3): atan2(n·E3, n·e2) + 90°, from -90° to 270°."""
    return 0.5 * math.pi + _atan2(-cos_beta, sin_beta)


def _constant(model, sin_beta, cos_beta, sin_gamma, cos_gamma):  # type: ignore[no-untyped-def]
    return model.value


def _linear(model, sin_beta, cos_beta, sin_gamma, cos_gamma):  # type: ignore[no-untyped-def]
    return model.intercept + model.slope * (_DEGREES * _beta(sin_beta, cos_beta))


def _table(model, sin_beta, cos_beta, sin_gamma, cos_gamma):  # type: ignore[no-untyped-def]
    v = model.values
    s = (_beta(sin_beta, cos_beta) - model.beta) * model.beta_nodes
    t = (_atan2(sin_gamma, cos_gamma) - model.gamma) * model.gamma_nodes
    # NaN becomes 0, so that every index lies inside
    s = min(s if s > 0.0 else 0.0, v.shape[0] - 1.0)
    t = min(t if t > 0.0 else 0.0, v.shape[1] - 1.0)
    i, j = min(np.int32(s), np.int32(v.shape[0] - 2)), min(np.int32(t), np.int32(v.shape[1] - 2))
    s, t = s - i, t - j
    a, b = np.uint64(i), np.uint64(j)  # unsigned: numba adds code for negative indices otherwise
    a1, b1 = a + np.uint64(1), b + np.uint64(1)
    low = v[a, b] + t * (v[a, b1] - v[a, b])
    high = v[a1, b] + t * (v[a1, b1] - v[a1, b])
    return low + s * (high - low)


def _given(medium: Medium, table: Table | None) -> Table:
    if table is None:
        raise ValueError("alpha_y.model 'table' needs alpha_y.table to name a CSV file")
    return table


# By the name in `alpha_y.model`: the model's type, its function, and its factory from a medium and a table.
_MODELS: dict[str, tuple[type, Callable[..., float], Callable[[Medium, Table | None], Any]]] = {
    "constant": (Constant, _constant, lambda medium, table: Constant(medium.alpha_x_flat)),
    "linear": (Linear, _linear, lambda medium, table: PAPER_LINEAR),
    "table": (Table, _table, _given),
}
_FUNCTIONS = {model: function for model, function, _ in _MODELS.values()}

ALPHA_Y_MODELS = tuple(_MODELS)
"""The names of the models."""


def alpha_y_model(name: str, medium: Medium, table: Table | None = None) -> AlphaY:
    """The model named by the parameter `alpha_y.model`, for a medium. Raises ValueError for other names.

    The model `table` needs a `table`.
    """
    if name not in _MODELS:
        raise ValueError(f"alpha_y.model '{name}' is none of {', '.join(ALPHA_Y_MODELS)}")
    make = _MODELS[name][2]
    model: AlphaY = make(medium, table)
    return model


def checked_alpha_y(model: AlphaY) -> AlphaY:
    """The model with float64 fields: an integer field would compile another kernel.

    Raises TypeError for anything but a model, ValueError for a field that is not finite or has the wrong shape.
    """
    if type(model) not in _FUNCTIONS:
        raise TypeError(f"alpha_y model is {model!r}; create one with alpha_y_model")
    fields: list[Any] = []
    for name, value in model._asdict().items():
        if isinstance(value, np.ndarray) and value.ndim > 0:
            array = np.array(numbers(name, value, value.shape[1:]))  # a copy that no caller can change
            if not np.isfinite(array).all():
                raise ValueError(f"{name} of the alpha_y model has a value that is not finite")
            array.flags.writeable = False
            fields.append(array)
        else:
            fields.append(number(f"{name} of the alpha_y model", value))
    if isinstance(model, Table) and (np.ndim(model.values) != 2 or min(np.shape(model.values)) < 2):
        raise ValueError(f"values of the table have shape {np.shape(model.values)}; create one with Table.sampled")
    made: AlphaY = type(model)(*fields)
    return made


def alpha_y(model: AlphaY, sin_beta: float, cos_beta: float, sin_gamma: float, cos_gamma: float) -> float:
    """α_y of a plate [N/cm³] from its attack angle β and intrusion angle γ."""
    function = _FUNCTIONS[type(model)]
    return function(model, sin_beta, cos_beta, sin_gamma, cos_gamma)


@overload(alpha_y, jit_options={"forceinline": True, **OPTIONS})
def _compiled_alpha_y(model, sin_beta, cos_beta, sin_gamma, cos_gamma):  # type: ignore[no-untyped-def]
    if isinstance(model, types.BaseNamedTuple):
        return _FUNCTIONS.get(model.instance_class)
    return None
