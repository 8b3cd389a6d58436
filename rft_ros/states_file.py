"""Reads states from a CSV file, computes the wrenches along them, and writes these to a CSV file."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.estimator import PoseDifference, PoseSample
from rft_ros.files import whole
from rft_ros.logged_columns import MATRIX, ROTATION_VECTOR, renamed, with_quaternions
from rft_ros.messages import Role
from rft_ros.parameters import Config, Model
from rft_ros.rft import (
    POSE,
    POSITION,
    QUATERNION,
    STATE,
    TWIST,
    VELOCITY,
    WRENCH,
    Memory,
    checked_states,
    wrenches,
    wrenches_in_time,
)
from rft_ros.table_file import Column, TableColumns, columns_named, open_table

_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_UNITS = [*_SECONDS][1:]
_METRES = {"": 1.0, "m": 1.0, "mm": 1e-3}
_TIME = Column("t", _SECONDS)
_PLACE = tuple(Column(name, _METRES, gaps=True) for name in STATE[POSITION])
_QUATERNION = columns_named(STATE[QUATERNION], gaps=True)
_ROTATION_VECTOR = columns_named(ROTATION_VECTOR, gaps=True)
_MATRIX = columns_named(MATRIX, gaps=True)
_TWIST = columns_named(STATE[TWIST], gaps=True)

_MAX_TIME_S = 2**31  # stamps of ROS have 32 bits
# of a tool in grains; under 0.1 mm/s another unit of time is likelier than a slow tool
_USUAL_SPEED_M_S = 0.003
# the quantile of the speeds that is compared, since a tool may rest most of the time
_SPEED_QUANTILE_SHARE = 0.9
# power of 1000 within which the speed by the poses and a velocity are of different units
_MAX_POWER_FACTOR = 0.15
_MIN_PERIOD_S = 1e-4  # between rows: no driver sends more often
_MAX_SPEED_M_S = 1.0  # no arm exceeds both this and the next extent [m] in grains
_MAX_EXTENT_M = 10.0

_MIN_POSE_COUNT = 3  # poses for a velocity
_ANY_GAP_NS = 10**18


def read_motion(
    file: Path,
    what: str,
    *optional: Sequence[Column],
    columns: Mapping[str, str] = MappingProxyType({}),
    topics: Mapping[Role, str] = MappingProxyType({}),
) -> TableColumns:
    """The columns t [s] and px .. qw [m] of a table, and if it has them vx .. wz and the groups `optional`.

    `columns`: the table's headings by the reader's names, as `parse_columns` gives them; `topics`: of each role, for a
    table of PlotJuggler. A unit may follow the name of a time or position: t [ms], px [mm]. A row may lack its pose or
    its velocity, whose numbers are NaN there. Raises InputError, which names the line, for a table without any pose,
    and for a time or position without a unit with which the tool would move implausibly.
    """
    table = open_table(file, what)
    headings = renamed(table.headings, columns, topics, table.named)
    pose = (*_PLACE, *_QUATERNION)
    if not _names_any(_QUATERNION, headings):
        if _names_any(_MATRIX, headings):
            pose = _MATRIX
        elif _names_any(_ROTATION_VECTOR, headings):
            pose = (*_PLACE, *_ROTATION_VECTOR)
    numbers = table.read((_TIME, *pose), _TWIST, *optional, headings=headings)
    rows = with_quaternions(numbers)
    label = table.named
    has_pose = rows.has_any(STATE[POSE])
    if not has_pose.any():
        raise InputError(f"{label} has no row with a pose, {', '.join(STATE[POSE])}")
    _check_units(rows.at(has_pose), label)
    times = rows.columns["t"]
    wrong = np.flatnonzero(~(np.abs(times) < _MAX_TIME_S))
    if len(wrong):
        line = rows.lines[wrong[0]]
        raise InputError(f"{label} line {line}: t is {times[wrong[0]]:.9g}; it must be a time [s]")
    return rows


def _names_any(columns: Sequence[Column], headings: Sequence[str]) -> bool:
    return any(column.places(headings) for column in columns)


def columns_of(rows: TableColumns, names: Sequence[str]) -> NDArray[np.float64]:
    """The named columns of a table side by side, shape [n, k]."""
    return np.column_stack([rows.columns[name] for name in names])


def _check_units(rows: TableColumns, label: str) -> None:
    """Raise InputError if the speed by the poses shows that a column without a unit is not in seconds or metres."""
    places = columns_of(rows, STATE[POSITION])
    with np.errstate(all="ignore"):
        seconds = np.diff(rows.columns["t"])
        speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / seconds
    moves = (speeds > 0.0) & (speeds < np.inf)
    if not moves.any():
        return
    speed = float(np.quantile(speeds[moves], _SPEED_QUANTILE_SHARE))
    usual = _USUAL_SPEED_M_S
    max_deviation = 0.5
    if STATE[-1] in rows.columns:
        with np.errstate(over="ignore"):
            velocities = np.linalg.norm(columns_of(rows, STATE[VELOCITY]), axis=1)[1:][moves]
        finite = velocities[np.isfinite(velocities)]  # a line with another one is named later
        if len(finite):
            usual = max(float(np.quantile(finite, _SPEED_QUANTILE_SHARE)), speed)
            max_deviation = _MAX_POWER_FACTOR
    power = math.log(usual / speed, 1000.0)
    thousands = round(power)
    shortest = float(np.median(seconds[moves])) / 1000.0**thousands
    is_other = 1 <= thousands < len(_UNITS) and abs(power - thousands) < max_deviation
    if is_other and shortest > _MIN_PERIOD_S and not rows.units["t"]:
        unit = _UNITS[thousands]
        why = f"in seconds, the tool would move at {1e3 * speed:.2g} mm/s"
        raise InputError(
            f"{label}: t looks like {unit} ({why}); name its unit in the first line, t [{unit}] or t [s]"
        )
    extent = float(np.ptp(places, axis=0).max())
    if speed > _MAX_SPEED_M_S and extent > _MAX_EXTENT_M and not rows.units["px"]:
        why = f"in metres, the tool would move at {speed:.2g} m/s over {extent:.3g} m"
        raise InputError(
            f"{label}: px, py and pz look like mm ({why}); name the unit in the first line, px [mm] or px [m]"
        )


def read_states(
    file: Path, columns: Mapping[str, str] = MappingProxyType({})
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times [s], shape [n], and checked states, shape [n, 13], from a table as `read_motion` reads it.

    Rows without a pose are left out. Unless each pose has a velocity vx .. wz, the velocities are found from the poses.
    Raises InputError that names the line.
    """
    what = "states file"
    table = read_motion(file, what, columns=columns)
    rows = table.at(table.has_any(STATE[POSE]))
    times = rows.columns["t"]
    has_twist = STATE[-1] in rows.columns and rows.has_any(STATE[TWIST]).all()
    try:
        if has_twist:
            return times, checked_states(columns_of(rows, STATE))
        poses = columns_of(rows, STATE[POSE])
        states = checked_states(np.pad(poses, ((0, 0), (0, len(STATE[TWIST])))))
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
    if len(times) < _MIN_POSE_COUNT:
        raise ValueError(
            f"row 0: velocities need {_MIN_POSE_COUNT} poses; give more, or the columns {','.join(STATE[TWIST])}"
        )
    window = Config().inputs.twist_window
    difference = PoseDifference()
    twists = np.empty((len(times), len(STATE[TWIST])))
    for row, (stamp, pose) in enumerate(zip(stamps.tolist(), poses.tolist(), strict=True)):
        difference.push(PoseSample(stamp, "", pose[:3], pose[3:]), window=window, gap=_ANY_GAP_NS)
        twists[row] = difference.twist
    twists[: _MIN_POSE_COUNT - 1] = twists[_MIN_POSE_COUNT - 1]
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
