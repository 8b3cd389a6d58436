"""The row of one variant: peaks and means of the wrench, and the work; or the reason why there are none."""

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import trapezoid

from rft_ros.errors import InputError, reason_of
from rft_ros.rft import Law, alpha_y_model, law_named, medium_named
from rft_ros.states_file import read_states, wrenches_along
from rft_ros.sweeps.design import Variant
from rft_ros.sweeps.motions import FAMILIES, Array, sample
from rft_ros.tool import Tool, ToolRequest

__all__ = ["RESULTS", "Work", "evaluate", "row_of", "work"]

RESULTS = (
    *(f"peak_{axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz")),
    *(f"mean_{axis}" for axis in ("fx", "fy", "fz", "tx", "ty", "tz")),
    "peak_force",
    "vertical_work",
    "total_work",
    "path",
    "plates",
)
"""Columns of results: wrench on the tool [N], [N m], world axes, peaks by magnitude, signed; work on the grains [J];
path of the tool frame's origin [m]; number of plates."""

_SAMPLES, _MOST_SAMPLES = 200, 1_000_000


class Work(NamedTuple):
    """Work done on the grains [J], positive where they resist.

    `vertical`: by the vertical force over the vertical displacement of the tool frame's origin. `total`: by the whole
    wrench, including rotation and horizontal motion.
    """

    vertical: float
    total: float


def work(times: Array, states: Array, wrenches: Array) -> Work:
    """Vertical and total work over a motion, by the trapezoidal rule.

    `times` [s], shape [n]. `states`: shape [n, 13], columns `rft_ros.rft.STATE`. `wrenches`: shape [n, 6 or more],
    force on the tool [N] and torque about its frame's origin [N m], world axes.
    """
    power = -wrenches[:, :6] * states[:, 7:13]  # [W], positive where the grains resist
    return Work(float(trapezoid(power[:, 2], times)), float(trapezoid(power.sum(axis=1), times)))


# `_fingerprint` is part of the caches' keys.
@lru_cache(maxsize=64)
def _loaded(request: ToolRequest, _fingerprint: int) -> Tool:
    return request.load()


def _tool(entry: dict[str, Any], fingerprint: int) -> Tool:
    numbers = {name: float(entry[name]) for name in ("scale", "tolerance") if name in entry}
    x, y, z = map(float, entry.get("origin", (0.0, 0.0, 0.0)))
    request = ToolRequest(entry["mesh"], origin=(x, y, z), integration=entry.get("integration"), **numbers)
    return _loaded(request, fingerprint)


@lru_cache(maxsize=4096)
def _motion(entry: tuple[tuple[str, Any], ...], _fingerprint: int) -> tuple[Array, Array]:
    """Times and states of a motion, from the items of its entry."""
    parameters = dict(entry)
    if "states_file" in parameters:
        return read_states(Path(parameters["states_file"]))
    family, samples = parameters.pop("family"), parameters.pop("samples", _SAMPLES)
    if not 2 <= samples <= _MOST_SAMPLES:
        raise InputError(f"samples is {samples}; it must be from 2 to {_MOST_SAMPLES:,}")
    return sample(FAMILIES[family](**{name: float(value) for name, value in parameters.items()}), int(samples))


def _law(medium: dict[str, Any]) -> Law:
    named = medium_named(medium.get("medium", "generic"))
    model = alpha_y_model(medium.get("alpha_y", "constant"), named)
    given = ("zeta", "surface_friction", "density", "inertia")
    numbers = {name: float(medium[name]) for name in given if name in medium}
    return law_named(medium.get("law", "treers2021"), named, model, **numbers)


def evaluate(variant: Variant, fingerprint: int = 0) -> dict[str, float]:
    """The results of a variant by column. Raises InputError or ValueError if it cannot be computed.

    Files are read once for each `fingerprint`, that of the design.
    """
    tool = _tool(variant["tool"], fingerprint)
    times, states = _motion(tuple(variant["motion"].items()), fingerprint)
    medium = variant["medium"]
    lengths = {name: float(medium.get(name, 0.0)) for name in ("mobilization_length", "surface_height")}
    wrench = wrenches_along(tool.plates, _law(medium), times, states, **lengths, where="motion", threads=1)[:, :6]
    peak = wrench[np.abs(wrench).argmax(axis=0), np.arange(6)]
    spent = work(times, states, wrench)
    path = np.linalg.norm(np.diff(states[:, :3], axis=0), axis=1).sum()
    force = np.linalg.norm(wrench[:, :3], axis=1).max()
    numbers = [*peak, *wrench.mean(axis=0), force, spent.vertical, spent.total, path, len(tool.plates)]
    if not np.isfinite(numbers).all():
        raise InputError("its forces, work or path are too large")
    return dict(zip(RESULTS, map(float, numbers), strict=True))


def row_of(variant: Variant, columns: Sequence[str], fingerprint: int = 0) -> list[str]:
    """A row of the table: the variant's values, then its results or the reason why it has none."""
    own = {f"{part}.{key}": value for part, values in variant.items() for key, value in values.items()}
    numbers: dict[str, float] = {}
    reason = ""
    try:
        numbers = evaluate(variant, fingerprint)
    except (ValueError, TypeError, ArithmeticError, MemoryError) as error:
        reason = reason_of(error)
    cells = {**own, **numbers, "reason": reason}
    return [str(cells.get(name, "")) for name in columns]
