"""Models of α_y, the stress per depth along e1, the horizontal direction in the plate (Treers et al. 2021, IV-B).

A model is a NamedTuple of numbers and arrays plus a function ``alpha_y(model, sin_beta, cos_beta, sin_gamma,
cos_gamma) -> [N/cm³]``. numba compiles one kernel for each model's type, so a model costs only what it computes. To add
one: write the NamedTuple, write its function in plain arithmetic, and give both a name in `_MODELS`.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import overload
from numpy.typing import NDArray

from rft_ros.rft.compiled import OPTIONS, inlined
from rft_ros.rft.media import Medium

__all__ = ["ALPHA_Y_MODELS", "AlphaY", "Constant", "Linear", "Table", "alpha_y", "alpha_y_model", "as_table"]


class Constant(NamedTuple):
    """The same α_y [N/cm³] at every attitude; the paper takes α_x(γ = 0, β = 0)."""

    value: float


class Linear(NamedTuple):
    """α_y = intercept + slope β, with β in degrees: [N/cm³], [N/cm³/deg] (the paper's second model)."""

    intercept: float
    slope: float


class Table(NamedTuple):
    """α_y [N/cm³] on a grid of β and γ [rad, ascending], shape [n_beta, n_gamma]; bilinear, held beyond the edges."""

    beta: NDArray[np.float64]
    gamma: NDArray[np.float64]
    values: NDArray[np.float64]


AlphaY = Constant | Linear | Table

PAPER_LINEAR = Linear(0.2035, -0.0015)


_DEGREES = 180.0 / math.pi


@inlined
def _atan2(y: float, x: float) -> float:
    """atan2 by a rational fit (1e-13 rad) with selects instead of branches, so that it vectorises; atan2(0, 0) = 0."""
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
    """Attack angle β [rad] as the method has it, atan2(n·E3, n·e2) + 90°: from -90° to 270°."""
    return 0.5 * math.pi + _atan2(-cos_beta, sin_beta)


@inlined
def _bracket(grid, x):  # type: ignore[no-untyped-def]
    """Index i and weight t so that x lies at grid[i] (1 - t) + grid[i + 1] t; t = 0 beyond the edges."""
    n = len(grid)
    if n == 1 or x <= grid[0]:
        return 0, 0.0
    if x >= grid[n - 1]:
        return n - 2, 1.0
    i = np.searchsorted(grid, x, side="right") - 1
    return i, (x - grid[i]) / (grid[i + 1] - grid[i])


def _constant(model, sin_beta, cos_beta, sin_gamma, cos_gamma):  # type: ignore[no-untyped-def]
    return model.value


def _linear(model, sin_beta, cos_beta, sin_gamma, cos_gamma):  # type: ignore[no-untyped-def]
    return model.intercept + model.slope * (_DEGREES * _beta(sin_beta, cos_beta))


def _table(model, sin_beta, cos_beta, sin_gamma, cos_gamma):  # type: ignore[no-untyped-def]
    i, s = _bracket(model.beta, _beta(sin_beta, cos_beta))
    j, t = _bracket(model.gamma, _atan2(sin_gamma, cos_gamma))
    i1 = min(i + 1, len(model.beta) - 1)
    j1 = min(j + 1, len(model.gamma) - 1)
    v = model.values
    return (1.0 - s) * ((1.0 - t) * v[i, j] + t * v[i, j1]) + s * ((1.0 - t) * v[i1, j] + t * v[i1, j1])


def _given(medium: Medium, table: Table | None) -> Table:
    if table is None:
        raise ValueError("alpha_y.model 'table' needs alpha_y.table to name a CSV file")
    return table


# The name that `alpha_y.model` takes: the model's type, its function, and what makes one from a medium and a table.
_MODELS: dict[str, tuple[type, Callable[..., float], Callable[[Medium, Table | None], Any]]] = {
    "constant": (Constant, _constant, lambda medium, table: Constant(medium.alpha_x_flat)),
    "linear": (Linear, _linear, lambda medium, table: PAPER_LINEAR),
    "table": (Table, _table, _given),
}
_FUNCTIONS = {model: function for model, function, _ in _MODELS.values()}

ALPHA_Y_MODELS = tuple(_MODELS)
"""The names of the models."""


def alpha_y_model(name: str, medium: Medium, table: Table | None = None) -> AlphaY:
    """The model that the parameter `alpha_y.model` names, for a medium."""
    if name not in _MODELS:
        raise ValueError(f"alpha_y.model '{name}' is none of {', '.join(ALPHA_Y_MODELS)}")
    make = _MODELS[name][2]
    model: AlphaY = make(medium, table)
    return model


def as_table(model: AlphaY) -> AlphaY:
    """A line in β as a table, exactly: for what is worth one compiled kernel but not one for each model."""
    if not isinstance(model, Constant | Linear):
        return model
    beta = np.deg2rad([-90.0, 270.0])  # where atan2 + 90° can lie
    slope, intercept = (model.slope, model.intercept) if isinstance(model, Linear) else (0.0, model.value)
    return Table(beta, np.zeros(1), (intercept + slope * np.rad2deg(beta))[:, None])


def alpha_y(model: AlphaY, sin_beta: float, cos_beta: float, sin_gamma: float, cos_gamma: float) -> float:
    """α_y of a plate [N/cm³] from its attack angle β and intrusion angle γ."""
    function = _FUNCTIONS[type(model)]
    return function(model, sin_beta, cos_beta, sin_gamma, cos_gamma)


@overload(alpha_y, jit_options={"forceinline": True, **OPTIONS})
def _compiled_alpha_y(model, sin_beta, cos_beta, sin_gamma, cos_gamma):  # type: ignore[no-untyped-def]
    if isinstance(model, types.BaseNamedTuple):
        return _FUNCTIONS.get(model.instance_class)
    return None
