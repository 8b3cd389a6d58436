"""Arguments of public functions: converted to the types of the compiled loops, or refused with a sentence."""

from math import inf, isfinite
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST = 1_000_000
"""The greatest number of bodies, or of threads."""

_FLOAT = np.dtype(np.float64)  # of all numbers in the compiled loops, in native byte order


def number(name: str, value: float, *, positive: bool = False, least: float = -inf) -> float:
    """A finite number as float, of at least `least`, in the unit of `value`. Raises ValueError that names it."""
    if (
        value.__class__ is float
        and isfinite(value)
        and value >= least
        and (value > 0.0 or not positive)
    ):
        return value
    try:
        x = float("nan" if isinstance(value, str | bytes) else value)
    except (TypeError, ValueError, OverflowError):
        x = float("nan")
    if not isfinite(x) or x < least or (positive and x <= 0.0):
        requirement = "a finite number" if least == -inf else f"at least {least:g}"
        if positive:
            requirement = "a positive number"
        raise ValueError(f"{name} is {value!r}; it must be {requirement}")
    return x


def whole_number(name: str, value: float, *, least: int = 1, most: int) -> int:
    """A whole number from `least` to `most`, and no bool. Raises ValueError that names it."""
    # as float, an integer over 2^53 would be rounded
    exact = value if isinstance(value, int | np.integer) else number(name, value)
    is_bool = isinstance(value, bool | np.bool_)
    if is_bool or not least <= exact <= most or exact % 1:
        requirement = f"a whole number from {least} to {most:,}"
        raise ValueError(f"{name} is {value!r}; it must be {requirement}")
    return int(exact)


def real_numbers(name: str, values: ArrayLike) -> NDArray[Any]:
    """Real numbers as an array of any shape and type. Raises ValueError that names the argument."""
    try:
        real_array = np.asarray(values)
    except ValueError:
        raise ValueError(
            f"{name} has rows of different lengths; it must be an array of numbers"
        ) from None
    if real_array.dtype.kind not in "fiub":
        raise ValueError(
            f"{name} has values of type {real_array.dtype}; they must be real numbers"
        )
    return real_array


def numbers(
    name: str, values: ArrayLike, row: tuple[int, ...] = (), *, rows: int | None = None
) -> NDArray[np.float64]:
    """Values as a C-contiguous float64 array, shape [n, *row], in the unit of `values`; not copied if already one.

    `row`: shape of one row; a single row becomes shape [1, *row]. `rows`: the required n. Raises ValueError
    that names the argument.
    """
    if values.__class__ is np.ndarray and values.dtype is _FLOAT and values.flags.carray:
        shape = values.shape
        if shape and shape[1:] == row and (rows is None or shape[0] == rows):
            return values
    real_array = real_numbers(name, values)
    array = np.array(real_array, dtype=_FLOAT, order="C", ndmin=1 + len(row))
    if array.shape[1:] != row or (rows is not None and len(array) != rows):
        requirement = ", ".join(str(size) for size in ("n" if rows is None else rows, *row))
        raise ValueError(f"{name} has shape {list(real_array.shape)}; it must be [{requirement}]")
    return array


def finite_numbers(
    name: str, values: ArrayLike, row: tuple[int, ...] = (), *, rows: int | None = None
) -> NDArray[np.float64]:
    """`numbers` that are finite. Raises ValueError that names the argument, and the first row of another."""
    array = numbers(name, values, row, rows=rows)
    is_finite = np.isfinite(array)
    if not is_finite.all():
        place = np.argwhere(~is_finite)[0].tolist()
        raise ValueError(
            f"{name} has the value {array[tuple(place)]:g} at {place}; it must be finite"
        )
    return array
