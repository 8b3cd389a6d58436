"""Reads states from a CSV file, computes the wrenches along them, and writes these to a CSV file."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.estimator import PoseDifference, PoseSample
from rft_ros.files import whole
from rft_ros.parameters import Model, defaults
from rft_ros.rft import (
    POSE,
    STATE,
    TWIST,
    WRENCH,
    Memory,
    checked_states,
    wrenches,
    wrenches_in_time,
)
from rft_ros.table_file import columns_named, read_table

_FEWEST = 3  # poses for a velocity
_ANY_GAP = 10**18  # ns


def read_states(file: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [s], shape [n], and checked states, shape [n, 13], from a CSV file with the columns t, px .. wz.

    Without the columns vx .. wz the velocities are found from the poses. Raises InputError that names the line.
    """
    what = "states file"
    rows = read_table(file, what, columns_named(("t", *STATE[POSE])), columns_named(STATE[TWIST]))
    times = rows.column("t")
    given = np.zeros((len(times), len(STATE)))
    given[:, : len(rows.factors) - 1] = rows.numbers[:, 1:]
    try:
        unknown = np.flatnonzero(~np.isfinite(times))
        if len(unknown):
            raise ValueError(
                f"row {unknown[0]}: t is {times[unknown[0]]}; it must be a finite number"
            )
        states = checked_states(given)
        if STATE[-1] not in rows.factors:
            states[:, TWIST] = _velocities(times, states[:, POSE])
        return times, states
    except ValueError as error:
        row, _, reason = str(error).removeprefix("row ").partition(":")  # counted from 0
        raise InputError(f"{what} '{file}' line {rows.lines[int(row)]}:{reason}") from None


def _velocities(times: NDArray[np.float64], poses: NDArray[np.float64]) -> NDArray[np.float64]:
    """Twist at each pose as in the node with `twist_source` pose_difference, shape [n, 6]; at the first two the third.

    Raises ValueError, which names the row, if there are fewer than three poses or times do not increase.
    """
    with np.errstate(invalid="ignore"):
        stamps = 1 + np.round((times - times[0]) * 1e9).astype(np.int64)
    back = np.flatnonzero(np.diff(stamps) <= 0)
    if len(back):
        k = int(back[0]) + 1
        raise ValueError(
            f"row {k}: t is {times[k]:g} after {times[k - 1]:g}; without velocities it must increase"
        )
    if len(times) < _FEWEST:
        raise ValueError(
            f"row 0: velocities need {_FEWEST} poses; give more, or the columns {','.join(STATE[TWIST])}"
        )
    window: float = defaults()["twist_window"]
    difference = PoseDifference()
    twists = np.empty((len(times), len(STATE[TWIST])))
    for row, (stamp, pose) in enumerate(zip(stamps.tolist(), poses.tolist(), strict=True)):
        difference.push(PoseSample(stamp, "", pose[:3], pose[3:]), window=window, gap=_ANY_GAP)
        twists[row] = difference.twist
    twists[: _FEWEST - 1] = twists[_FEWEST - 1]
    return twists


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
    plates = model.tool.plates
    law = model.law
    back = np.flatnonzero(np.diff(times) < 0.0)
    if not law.has_memory:
        result = wrenches(plates, law, states, surface_height=surface_height, threads=threads)
    elif len(back):
        k = back[0]
        raise InputError(
            f"{where}: t goes back from {times[k]:g} to {times[k + 1]:g}; memory needs it in order"
        )
    else:
        result = wrenches_in_time(
            plates, law, states, Memory(plates), surface_height=surface_height
        )
    finite = np.isfinite(result).all(axis=1)
    if not finite.all():
        why = "it is too far away, or the tool or the stress is too large"
        raise InputError(
            f"{where}: the state at t = {times[np.argmin(finite)]:g} has no finite wrench; {why}"
        )
    return result


def write_wrenches(file: Path, times: NDArray[np.float64], wrenches: NDArray[np.float64]) -> None:
    """Write t [s] and the wrenches, shape [n, 6 or more] [N], [N m], with every digit that float64 holds."""
    with whole(file) as part, part.open("w", encoding="utf-8", newline="\n") as out:
        out.write("t,fx,fy,fz,tx,ty,tz\n")
        for t, row in zip(times.tolist(), wrenches[:, WRENCH].tolist(), strict=True):
            out.write(",".join(map(repr, (t, *row))) + "\n")
