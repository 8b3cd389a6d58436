"""States in a CSV file, their wrenches, and the CSV file of those."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import read_columns, whole
from rft_ros.rft import STATE, Law, Memory, Plates, checked_states, wrenches, wrenches_in_time

__all__ = ["WRENCH_HEADER", "read_states", "wrenches_along", "write_wrenches"]

WRENCH_HEADER = ("t", "fx", "fy", "fz", "tx", "ty", "tz")
"""Header of a file of wrenches: time [s], force [N], torque [N m]."""


def read_states(file: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [s], shape [n], and checked states, shape [n, 13], of a CSV with the columns t, px .. wz in any order.

    Raises InputError that names the file, line and column.
    """
    table, lines = read_columns(file, "states file", ("t", *STATE), pipes=True)
    if not np.isfinite(table[:, 0]).all():
        k = int(np.argmin(np.isfinite(table[:, 0])))
        raise InputError(f"states file '{file}' line {lines[k]}: t is {table[k, 0]}; it must be a finite number")
    try:
        return table[:, 0], checked_states(table[:, 1:])
    except ValueError as error:
        row, _, reason = str(error).removeprefix("row ").partition(":")  # counted from 0
        raise InputError(f"states file '{file}' line {lines[int(row)]}:{reason}") from None


def wrenches_along(
    plates: Plates,
    law: Law,
    times: NDArray[np.float64],
    states: NDArray[np.float64],
    *,
    mobilization_length: float,
    surface_height: float,
    where: str,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Wrench at each state as `rft_ros.rft.wrenches`; with memory if `mobilization_length` [m] is over 0.

    `times` [s], shape [n]. `surface_height` [m]. `where`: what has the states, for errors. `threads`: without memory.
    Raises InputError for a length or an order of times that cannot be used, and for a wrench that is not finite.
    """
    length, height, durations = mobilization_length, surface_height, np.diff(times, prepend=times[0])
    if not 0.0 <= length < np.inf:
        raise InputError(f"mobilization_length is {length:g}; it must be finite and not negative")
    if length == 0.0:
        result = wrenches(plates, law, states, surface_height=height, threads=threads)
    elif durations.min() < 0.0:
        k = int(np.argmax(durations < 0.0))
        raise InputError(f"{where}: t goes back from {times[k - 1]:g} to {times[k]:g}; memory needs it in order")
    else:
        result = wrenches_in_time(
            plates, law, states, durations, Memory(plates), mobilization_length=length, surface_height=height
        )
    finite = np.isfinite(result).all(axis=1)
    if not finite.all():
        why = "it is too far away, or the tool or the stress is too large"
        raise InputError(f"{where}: the state at t = {times[np.argmin(finite)]:g} has no finite wrench; {why}")
    return result


def write_wrenches(file: Path, times: NDArray[np.float64], wrenches: NDArray[np.float64]) -> None:
    """Write t [s] and the wrenches, shape [n, 6 or more] [N], [N m], with every digit that float64 holds."""
    with whole(file) as part, part.open("w", encoding="utf-8", newline="\n") as out:
        out.write(",".join(WRENCH_HEADER) + "\n")
        for t, row in zip(times.tolist(), wrenches[:, :6].tolist(), strict=True):
            out.write(",".join(repr(value) for value in (t, *row)) + "\n")
