"""A CSV table of times, poses, velocities and wrenches, as the messages of a bag."""

import math
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from rft_ros.bags.sources import Messages, Source
from rft_ros.errors import InputError
from rft_ros.messages import TYPES, Role, stamped_cdr
from rft_ros.parameters import Config, Settings
from rft_ros.rft import AXES, POSE, STATE, TWIST
from rft_ros.states_file import columns_of, read_motion
from rft_ros.table_file import TableColumns, columns_named

MESSAGE_COLUMNS: dict[Role, tuple[str, ...]] = {
    "pose": tuple(STATE[POSE]),
    "twist": tuple(STATE[TWIST]),
    "wrench": AXES,
}
"""Columns of the messages of a row, beside its time t.

Pose and twist of the tool frame are in world axes, the wrench in sensor axes, as the load cell's driver gives it. Those
of the twist may be missing, and those of the wrench.
"""


def is_table(bag: Path) -> bool:
    """Whether a recording is a table and not a bag."""
    return bag.suffix.lower() == ".csv"


def read_recorded_table(file: Path) -> TableColumns:
    """The columns of a table. Raises InputError, which names the line."""
    return read_motion(file, "table", columns_named(AXES))


def config_for_table(rows: TableColumns, config: Config) -> Config:
    """The parameters with which a table is read: velocities are found from the poses unless it has them."""
    twist_source = "topic" if "vx" in rows.columns else "pose_difference"
    return config.changed({"pose_source": "topic", "twist_source": twist_source})


def source_of_table(
    file: Path, rows: TableColumns, topics: Mapping[Role, str], settings: Settings
) -> Source:
    """The samples of a table as messages on the topics of their roles.

    In ROS a stamp of 0 means none: stamps that begin at 0 or below are shifted by whole seconds. Raises InputError,
    which names the line.
    """
    times = rows.columns["t"]
    back = np.flatnonzero(np.diff(times) < 0.0)
    if len(back):
        k = back[0] + 1
        must = "it must be a time [s] that does not go back; write a file for each run"
        raise InputError(f"table '{file}' line {rows.lines[k]}: t is {times[k]:.9g}; {must}")
    shift = 0 if times[0] > 0.0 else 1 + math.ceil(-times[0])
    stamps = np.round((times + shift) * 1e9).astype(np.int64).tolist()
    columns: dict[Role, list[list[float]]] = {}
    for role, names in MESSAGE_COLUMNS.items():
        if role in topics and names[0] in rows.columns:
            columns[role] = columns_of(rows, names).tolist()

    def read(wanted: Collection[str], first: int, last: int) -> Messages:
        for k, stamp in enumerate(stamps):
            for role, numbers in columns.items():
                if first <= stamp <= last and topics[role] in wanted:
                    frame = settings.sensor_frame if role == "wrench" else settings.world_frame
                    serialised = stamped_cdr(frame, len(numbers[k]))
                    yield stamp, topics[role], serialised(stamp, numbers[k])

    return Source(
        name=file.name,
        types=[(topics[role], TYPES[role][0]) for role in columns],
        count=len(columns) * len(stamps),
        first=stamps[0],
        last=stamps[-1],
        read=read,
        shift=shift * 1_000_000_000,
    )
