"""Models of α_y, the stress per depth along e1, the horizontal direction in the plate (Treers et al. 2021, IV-B).

A model is a NamedTuple of at most four numbers, and a table called `values` where it has one, and a function
``f(model, sin_beta, cos_beta, sin_gamma, cos_gamma) -> [N/cm³]`` in plain arithmetic. Only to a model with `values` the
last two may come times a common length. To add a model, write both and name them in `_MODELS`.
"""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.arguments import numbers
from rft_ros.rft.grains import NO_TABLE, TREERS2021, PackedLaw, pack
from rft_ros.rft.kernel import chunk as layout
from rft_ros.rft.kernel.chunk import at, triple, wide_vectors
from rft_ros.rft.kernel.compilation import inlined
from rft_ros.rft.media import Medium


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

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Table)
            and self[:4] == other[:4]
            and np.array_equal(self.values, other.values)
        )

    def __ne__(self, other: object) -> bool:  # that of tuples would take the truth of an array
        return not self == other

    @classmethod
    def sampled(cls, beta: ArrayLike, gamma: ArrayLike, values: ArrayLike) -> "Table":
        """A table from values, shape [n_beta, n_gamma], at any ascending β, shape [n_beta], and γ, shape [n_gamma].

        β and γ [rad], α_y [N/cm³]. The grid is the coarsest with a node at every β and γ (to 1e-9 of its range); the
        table is then exact everywhere. If no grid of up to `MAX_STEP_COUNT` steps has one, the finest is used: its
        nodes miss the values by up to half a step, 0.25° in 360°, and α_y errs by up to a quarter of a step times the
        change of slope.

        Raises ValueError that names the argument that cannot be used.
        """
        b = numbers("beta", beta)
        g = numbers("gamma", gamma)
        v = numbers("values", values, (len(g),), rows=len(b))
        for name, knots in (("beta", b), ("gamma", g)):
            if len(knots) == 0 or not np.isfinite(knots).all() or not (np.diff(knots) > 0.0).all():
                raise ValueError(
                    f"{name} is {knots}; it must be finite and ascending, with at least one value"
                )
        if not np.isfinite(v).all():
            raise ValueError("values has a number that is not finite")
        beta_nodes, v = _uniform(b, v)
        gamma_nodes, v = _uniform(g, v.T)
        return cls(float(b[0]), beta_nodes, float(g[0]), gamma_nodes, np.ascontiguousarray(v.T))


MIN_V23_RATIO = math.sin(math.radians(5.0))
"""abs(v23) over abs(v) below which the refined rule fills v23 up along the normal, for the γ of a table."""

MAX_STEP_COUNT = 720
"""Steps of the finest grid of `Table.sampled` over the range of β, or of γ."""

PAPER_LINEAR = Linear(0.2035, -0.0015)
"""The paper's line, found in grains like the generic medium."""


def _uniform(
    knots: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """Nodes per radian of a uniform grid over the knots, and the rows of values there by linear interpolation."""
    if len(knots) == 1:
        return 0.0, np.repeat(values, 2, axis=0)
    span = knots[-1] - knots[0]
    place = (knots - knots[0]) / span
    on_nodes = (
        n
        for n in range(len(knots) - 1, MAX_STEP_COUNT)
        if np.abs(place - np.round(place * n) / n).max() < 1e-9
    )
    steps = next(on_nodes, MAX_STEP_COUNT)
    nodes = np.linspace(0.0, 1.0, steps + 1)
    return float(steps / span), np.column_stack(
        [np.interp(nodes, place, column) for column in values.T]
    )


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
        1.8181909718019935
        + t * (1.0484966104272653 + t * (0.2084748631867935 + t * 0.010064531527009144))
    )
    q = 1.0 + t * (
        2.151524305115005
        + t
        * (
            1.5656713797337238
            + t * (0.4429175882067973 + t * (0.04081911121290752 + t * 0.0005401519946349882))
        )
    )
    a = z * p / q
    a = 0.5 * math.pi - a if steep else a
    a = math.pi - a if x < 0.0 else a
    return -a if y < 0.0 else a


@inlined
def _beta(sin_beta, cos_beta):
    """Attack angle β [rad], Eq. (3): atan2(n·E3, n·e2) + 90°, from -90° to 270°."""
    return 0.5 * math.pi + _atan2(-cos_beta, sin_beta)


def _constant(model, sin_beta, cos_beta, sin_gamma, cos_gamma):
    return model.value


def _linear(model, sin_beta, cos_beta, sin_gamma, cos_gamma):
    return model.intercept + model.slope * (_DEGREES * _beta(sin_beta, cos_beta))


def _table(model, sin_beta, cos_beta, sin_gamma, cos_gamma):
    v = model.values
    s = (_beta(sin_beta, cos_beta) - model.beta) * model.beta_nodes
    t = (_atan2(sin_gamma, cos_gamma) - model.gamma) * model.gamma_nodes
    # NaN becomes 0, so that every index lies inside
    s = min(s if s > 0.0 else 0.0, v.shape[0] - 1.0)
    t = min(t if t > 0.0 else 0.0, v.shape[1] - 1.0)
    i, j = min(np.int32(s), np.int32(v.shape[0] - 2)), min(np.int32(t), np.int32(v.shape[1] - 2))
    s, t = s - i, t - j
    a = np.uint64(i)
    b = np.uint64(j)  # unsigned: numba adds code for negative indices otherwise
    a1 = a + np.uint64(1)
    b1 = b + np.uint64(1)
    low = v[a, b] + t * (v[a, b1] - v[a, b])
    high = v[a1, b] + t * (v[a1, b1] - v[a1, b])
    return low + s * (high - low)


def _given(medium: Medium, table: Table | None) -> Table:
    if table is None:
        raise ValueError("alpha_y.model 'table' needs alpha_y.table to name a CSV file")
    return table


AlphaY = Constant | Linear | Table

# By the name in `alpha_y.model`: the model's type, its function, and its factory from a medium and a table.
_MODELS: dict[str, tuple[type, Callable[..., float], Callable[[Medium, Table | None], Any]]] = {
    "constant": (Constant, _constant, lambda medium, table: Constant(medium.alpha_x_flat)),
    "linear": (Linear, _linear, lambda medium, table: PAPER_LINEAR),
    "table": (Table, _table, _given),
}
_TYPES = [model for model, _, _ in _MODELS.values()]

ALPHA_Y_MODELS = tuple(_MODELS)
"""The names of the models."""


def alpha_y_model(name: str, medium: Medium, table: Table | None = None) -> AlphaY:
    """The model named by the parameter `alpha_y.model`, for a medium. Raises ValueError for other names.

    The model `table` needs a `table`.
    """
    if name not in _MODELS:
        raise ValueError(f"alpha_y.model '{name}' is none of {', '.join(ALPHA_Y_MODELS)}")
    _, _, make = _MODELS[name]
    return make(medium, table)


def alpha_y_name(model: AlphaY) -> str:
    """The name of a model's type, one of `ALPHA_Y_MODELS`. Raises TypeError for what is no model."""
    if type(model) not in _TYPES:
        raise TypeError(f"alpha_y model is {model!r}; create one with alpha_y_model")
    return ALPHA_Y_MODELS[_TYPES.index(type(model))]


def pack_treers2021(
    model: AlphaY, shared_numbers: Mapping[str, float], law_numbers: Mapping[str, float]
) -> PackedLaw:
    """The law `treers2021` with a model. The numbers: as for `pack`."""
    index = ALPHA_Y_MODELS.index(alpha_y_name(model))
    fields = model._asdict()
    table = fields.pop("values", NO_TABLE)
    numbers = {**shared_numbers, "alpha_y_model": index}
    return pack(TREERS2021, numbers, law_numbers, alpha_y=fields, table=table)


@inlined
def _directed(sin_beta, cos_beta, ex, ey, vx, vy, vz):
    """Sine and cosine of γ times a common length, for a motion that has a direction across e1 although v23 may vanish.

    A part of v23 that trails does not count. Where the rest is shorter than `MIN_V23_RATIO`, it is filled up along the
    plate's normal, so that rounding decides nothing: not between 0 and 180° where a plate moves along e1, and not
    between 180° and -180° in level motion backwards.
    """
    v2 = vx * ex + vy * ey
    back = min(v2 * sin_beta - vz * cos_beta, 0.0)
    v2, vz = v2 - back * sin_beta, vz + back * cos_beta
    fill = max(MIN_V23_RATIO - math.sqrt(v2 * v2 + vz * vz), 0.0)
    return -(vz - fill * cos_beta), v2 + fill * sin_beta


@inlined
def _directed_unit(sin_beta, cos_beta, ex, ey, vx, vy, vz):
    """`_directed` of unit length."""
    sine, cosine = _directed(sin_beta, cos_beta, ex, ey, vx, vy, vz)
    per_length = 1.0 / math.sqrt(max(sine * sine + cosine * cosine, 1e-290))
    return sine * per_length, cosine * per_length


def _step_of(model: Any, function: Any) -> Any:
    """The step `add_alpha_y` for laws with one model."""
    alpha_y_of = inlined(function)
    has_values = "values" in model._fields
    count = len(model._fields) - has_values
    # a table takes the angle by `_atan2`, which does without the unit length
    gamma_of = _directed if has_values else _directed_unit

    @inlined
    def add_to(chunk, n, fields, is_refined):
        wide_vectors()
        for i in range(n):
            sin_b, cos_b, sin_g = triple(chunk, layout.SIN_B, i)
            cos_g = chunk[at(layout.COS_G, i)]
            ex, ey = chunk[at(layout.E2_X, i)], chunk[at(layout.E2_Y, i)]
            if is_refined:  # a model that does not use γ leaves no code of this
                vx, vy, vz = triple(chunk, layout.VELOCITY, i)
                sin_g, cos_g = gamma_of(sin_b, cos_b, ex, ey, vx, vy, vz)
            alpha_y = alpha_y_of(fields, sin_b, cos_b, sin_g, cos_g)
            size = chunk[at(layout.E1_FACTOR, i)] * (max(alpha_y, 0.0) if is_refined else alpha_y)
            # e1 = e2 x E3
            chunk[at(layout.TRACTION, i)] += size * ey
            chunk[at(layout.TRACTION + layout.LENGTH, i)] -= size * ex

    @inlined
    def add(law, chunk, n, is_refined):
        constants = law.numbers[0].alpha_y
        numbers = (constants[0], constants[1], constants[2], constants[3])[:count]
        fields = model(*numbers, law.table) if has_values else model(*numbers)
        if is_refined:  # two loops: LLVM would else test the rule in each turn of one
            add_to(chunk, n, fields, True)
        else:
            add_to(chunk, n, fields, False)

    return add


def _choice(place: int, step: Any, otherwise: Any) -> Any:
    """The step `add_alpha_y` with one more model, at this place in `ALPHA_Y_MODELS`."""

    @inlined
    def choose(law, chunk, n, is_refined):
        if law.numbers[0].alpha_y_model == place:
            step(law, chunk, n, is_refined)
        else:
            otherwise(law, chunk, n, is_refined)

    return choose


# Compiled code has no table of functions, so this nests choices. Of the three models here it makes
#     if alpha_y_model == 2: step of Table
#     elif alpha_y_model == 1: step of Linear
#     else: step of Constant
_steps = [_step_of(model, function) for model, function, _ in _MODELS.values()]
add_alpha_y = _steps[0]
"""Add the traction along e1 to the n plates of a chunk; `law`: of `pack_treers2021`.

`is_refined`: by the refined rule α_y is never negative, since grains do not push a plate in its direction of motion;
and γ is `_directed`."""
for _place in range(1, len(_steps)):
    add_alpha_y = _choice(_place, _steps[_place], otherwise=add_alpha_y)
