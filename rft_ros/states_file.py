"""Reads states from a CSV file, computes the wrenches along them, and writes these to a CSV file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import read_columns, whole
from rft_ros.parameters import Model
from rft_ros.rft import STATE, WRENCH, Memory, checked_states, wrenches, wrenches_in_time

__all__ = ["read_states", "wrenches_along", "write_wrenches"]


def read_states(file: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [s], shape [n], and checked states, shape [n, 13], from a CSV file with the columns t, px .. wz.

    Raises InputError that names the line.
    """
    table, lines = read_columns(file, "states file", ("t", *STATE))
    times = table[:, 0]
    try:
        if not np.isfinite(times).all():
            k = int(np.argmin(np.isfinite(times)))
            raise ValueError(f"row {k}: t is {times[k]}; it must be a finite number")
        return times, checked_states(table[:, 1:])
    except ValueError as error:
        row, _, reason = str(error).removeprefix("row ").partition(":")  # counted from 0
        raise InputError(f"states file '{file}' line {lines[int(row)]}:{reason}") from None


def wrenches_along(
    model: Model,
    times: NDArray[np.float64],
    states: NDArray[np.float64],
    *,
    surface_height: float,
    where: str,
    threads: int | None = None,
) -> NDArray[np.float64]:
    """Wrench at each state as `rft_ros.rft.wrenches`, with the model's memory if it has one.

    `times` [s], shape [n]. `surface_height` [m]. `where`: how errors call the source of the states. `threads`: how many
    to use; a model with memory uses one. Raises InputError for times that go back, and for a wrench that is not finite.
    """
    plates, law, durations = model.tool.plates, model.law, np.diff(times, prepend=times[0])
    if not law.has_memory:
        result = wrenches(plates, law, states, surface_height=surface_height, threads=threads)
    elif durations.min() < 0.0:
        k = int(np.argmax(durations < 0.0))
        raise InputError(f"{where}: t goes back from {times[k - 1]:g} to {times[k]:g}; memory needs it in order")
    else:
        result = wrenches_in_time(plates, law, states, Memory(plates), surface_height=surface_height)
    finite = np.isfinite(result).all(axis=1)
    if not finite.all():
        why = "it is too far away, or the tool or the stress is too large"
        raise InputError(f"{where}: the state at t = {times[np.argmin(finite)]:g} has no finite wrench; {why}")
    return result


def write_wrenches(file: Path, times: NDArray[np.float64], wrenches: NDArray[np.float64]) -> None:
    """Write t [s] and the wrenches, shape [n, 6 or more] [N], [N m], with every digit that float64 holds."""
    with whole(file) as part, part.open("w", encoding="utf-8", newline="\n") as out:
        out.write("t,fx,fy,fz,tx,ty,tz\n")
        for t, row in zip(times.tolist(), wrenches[:, WRENCH].tolist(), strict=True):
            out.write(",".join(map(repr, (t, *row))) + "\n")
