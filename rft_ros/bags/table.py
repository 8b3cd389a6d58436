"""A CSV table of times, poses, velocities and wrenches, as the messages of a bag."""

import math
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.sources import Messages, Source
from rft_ros.errors import InputError
from rft_ros.messages import TYPES, Role, stamped_cdr
from rft_ros.parameters import Values
from rft_ros.rft import AXES, POSE, STATE, TWIST
from rft_ros.table_file import Rows, columns_named, read_table

_GROUPS: dict[Role, tuple[str, ...]] = {
    "pose": tuple(STATE[POSE]),
    "twist": tuple(STATE[TWIST]),
    "wrench": AXES,
}
_TIME_AND_POSE = columns_named(("t", *_GROUPS["pose"]))
_TWIST = columns_named(_GROUPS["twist"])
_WRENCH = columns_named(_GROUPS["wrench"])

COLUMNS = ("t", *STATE[POSE], *STATE[TWIST], *AXES)
"""Columns of a table: [s], [m], quaternion, [m/s], [rad/s], [N], [N m].

Pose and twist of the tool frame are in world axes, the wrench in sensor axes, as the load cell's driver gives it. The
six columns of the twist may be missing, and those of the wrench.
"""

_LAST = 2**31  # s: stamps of ROS have 32 bits
_UNITS = {"ns": 5e5, "µs": 500.0, "ms": 0.5}
"""Least time between rows, taken for seconds, of a table whose times are in each unit. None is slower than 2 Hz."""


def is_table(bag: Path) -> bool:
    """Whether a recording is a table and not a bag."""
    return bag.suffix.lower() == ".csv"


def read_recorded_table(file: Path) -> Rows:
    """Those of `COLUMNS` that a table has, in their order. Raises InputError, which names the line."""
    return read_table(file, "table", _TIME_AND_POSE, _TWIST, _WRENCH)


def values_for_table(rows: Rows, values: Values) -> Values:
    """The parameters with which a table is read: velocities are found from the poses unless it has them."""
    twist_source = "topic" if "vx" in rows.factors else "pose_difference"
    return {**values, "pose_source": "topic", "twist_source": twist_source}


def source_of_table(
    file: Path, rows: Rows, topics: Mapping[Role, str], values: Values
) -> tuple[Source, int]:
    """The samples of a table as messages on the topics of their roles, and how much their stamps are shifted [ns].

    In ROS a stamp of 0 means none: stamps that begin at 0 or below are shifted by whole seconds. Raises InputError,
    which names the line.
    """
    times = rows.column("t")
    _check_times(times, rows.lines, f"table '{file}'")
    shift = 0 if times[0] > 0.0 else 1 + math.ceil(-times[0])
    stamps = np.round((times + shift) * 1e9).astype(np.int64).tolist()
    columns: dict[Role, list[list[float]]] = {}
    for role, names in _GROUPS.items():
        if role in topics and names[0] in rows.factors:
            columns[role] = np.column_stack([rows.column(name) for name in names]).tolist()

    def read(wanted: Collection[str], first: int, last: int) -> Messages:
        for k, stamp in enumerate(stamps):
            for role, numbers in columns.items():
                if first <= stamp <= last and topics[role] in wanted:
                    frame = values["sensor_frame" if role == "wrench" else "world_frame"]
                    serialised = stamped_cdr(frame, len(_GROUPS[role]))
                    yield stamp, topics[role], serialised(stamp, numbers[k])

    source = Source(
        name=file.name,
        types=[(topics[role], TYPES[role][0]) for role in columns],
        count=len(columns) * len(stamps),
        first=stamps[0],
        last=stamps[-1],
        read=read,
    )
    return source, shift * 1_000_000_000


def _check_times(times: NDArray[np.float64], lines: NDArray[np.int64], named: str) -> None:
    """Raise InputError for times that are not in seconds, too large, or go back."""
    step = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    for unit, least in _UNITS.items():
        if step >= least:
            raise InputError(
                f"{named}: t looks like {unit} ({step:.3g} s between rows); give seconds"
            )
    wrong = np.flatnonzero(~(np.abs(times) < _LAST) | (np.diff(times, prepend=-np.inf) < 0.0))
    if len(wrong):
        must = "it must be a time [s] that does not go back; write a file for each run"
        raise InputError(f"{named} line {lines[wrong[0]]}: t is {times[wrong[0]]:.9g}; {must}")
