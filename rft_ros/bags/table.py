"""A CSV table of times, poses, velocities and wrenches, as the messages of a bag."""

import math
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from rft_ros.bags.sources import Messages, Source
from rft_ros.errors import InputError
from rft_ros.messages import TYPES, Role, stamped_cdr
from rft_ros.parameters import Config, FramesConfig
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
of the twist may be missing, and those of the wrench. A row without any number of a message has no such message.
"""

MAX_REPEATED_SHARE = 0.2
"""Of the rows in which the pose changes, the share that may have the time of the row before."""


def is_table(bag: Path) -> bool:
    """Whether a recording is a table and not a bag."""
    return bag.suffix.lower() == ".csv"


def read_recorded_table(
    file: Path, *, columns: Mapping[str, str], topics: Mapping[Role, str]
) -> TableColumns:
    """The columns of a table, as `read_motion` reads them. Raises InputError, which names the line."""
    wrench = columns_named(AXES, gaps=True)
    rows = read_motion(file, "table", wrench, columns=columns, topics=topics)
    _check_digits_of_times(rows, f"table '{file}'")
    return rows


def _check_digits_of_times(rows: TableColumns, named: str) -> None:
    """Raise InputError if rows with different poses have the same time, as where a logger writes six digits."""
    at_pose = rows.at(rows.has_any(STATE[POSE]))
    steps = np.diff(at_pose.columns["t"])
    has_moved = (np.diff(columns_of(at_pose, STATE[POSE]), axis=0) != 0.0).any(axis=1)
    is_repeat = has_moved & (steps == 0.0)
    if has_moved.any() and is_repeat.sum() > MAX_REPEATED_SHARE * has_moved.sum():
        line = at_pose.lines[1 + int(np.argmax(is_repeat))]
        sentence = (
            f"t is {at_pose.columns['t'][0]:.15g} again in line {line}, where the pose has changed"
        )
        raise InputError(
            f"{named}: {sentence}; write t with more digits, to the millisecond or finer"
        )


def config_of_tables(config: Config) -> Config:
    """The parameters with which a table's topics are named: it may have poses and velocities of its own."""
    return config.changed({"pose_source": "topic", "twist_source": "topic"})


def config_for_table(rows: TableColumns, config: Config) -> Config:
    """The parameters with which a table is read: velocities are found from the poses unless it has them."""
    has_twist = STATE[-1] in rows.columns and rows.has_any(STATE[TWIST]).any()
    twist_source = "topic" if has_twist else "pose_difference"
    return config.changed({"pose_source": "topic", "twist_source": twist_source})


def source_of_table(
    file: Path, rows: TableColumns, topics: Mapping[Role, str], frames: FramesConfig
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
    has_message: dict[Role, list[bool]] = {}
    for role, names in MESSAGE_COLUMNS.items():
        if role in topics and names[0] in rows.columns:
            columns[role] = columns_of(rows, names).tolist()
            has_message[role] = rows.has_any(names).tolist()

    def read(asked_topics: Collection[str], first: int, last: int) -> Messages:
        for k, stamp in enumerate(stamps):
            for role, numbers in columns.items():
                is_asked = first <= stamp <= last and topics[role] in asked_topics
                if is_asked and has_message[role][k]:
                    frame = frames.sensor if role == "wrench" else frames.world
                    serialise = stamped_cdr(frame, len(numbers[k]))
                    yield stamp, topics[role], serialise(stamp, numbers[k])

    return Source(
        name=file.name,
        types=[(topics[role], TYPES[role][0]) for role in columns],
        count=sum(map(sum, has_message.values())),
        first=stamps[0],
        last=stamps[-1],
        read=read,
        shift=shift * 1_000_000_000,
    )
