"""A law in the form that the compiled loop takes: which law it is, its model of α_y, and all their numbers."""

from collections.abc import Mapping
from math import isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rft_ros.rft.arguments import number, numbers
from rft_ros.rft.grains import LENGTH_OF_LAW

__all__ = ["AGARWAL2023", "NO_ALPHA_Y", "NO_TABLE", "TREERS2021", "PackedLaw", "packed"]

TREERS2021, AGARWAL2023 = 0, 1
"""The laws, for `PackedLaw.law`."""

NO_ALPHA_Y = -1
"""`PackedLaw.alpha_y` of a law that has no model of α_y."""

NO_TABLE = np.zeros((2, 2))
"""`PackedLaw.table` where a model has none."""


class PackedLaw(NamedTuple):
    """A law for the compiled loop.

    `law`: which, for example `TREERS2021`. `alpha_y`: the place of its model in `ALPHA_Y_MODELS`, or `NO_ALPHA_Y`.
    `numbers`: at the places of `InLaw`. `table`: the values of a model that has them.
    """

    law: int
    alpha_y: int
    numbers: NDArray[np.float64]
    table: NDArray[np.float64]


def packed(
    law: int, fields: Mapping[str, float], *, alpha_y: int = NO_ALPHA_Y, table: ArrayLike = NO_TABLE
) -> PackedLaw:
    """A law for the compiled loop, in arrays of the types that it takes, which no caller can change.

    `fields`: its numbers by name, in the order of `InLaw`. Raises ValueError or TypeError for what is not finite, or is
    no table.
    """
    values = np.array(numbers("alpha_y.values of the law", table, np.shape(table)[1:]))
    if not all(type(value) is float and isfinite(value) for value in fields.values()):
        fields = {name: number(f"{name} of the law", value) for name, value in fields.items()}  # names a bad one
    given = np.zeros(LENGTH_OF_LAW)
    given[: len(fields)] = list(fields.values())
    if values.ndim != 2 or min(values.shape) < 2 or not np.isfinite(values).all():
        raise ValueError(f"a table of shape {values.shape} is not finite, or not [2, 2] or larger: use Table.sampled")
    given.flags.writeable = values.flags.writeable = False
    return PackedLaw(law, alpha_y, given, values)
