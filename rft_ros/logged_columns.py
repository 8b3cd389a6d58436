"""Columns of tables that other programs write: PlotJuggler's headings, and headings that the user maps.

The reader's names are t, px .. qw, vx .. wz, fx .. tz. In place of a quaternion a table may have a rotation vector
rx, ry, rz [rad] (RTDE of Universal Robots), or in place of a pose a matrix of 4 x 4 numbers by columns, m0 .. m15
(Franka's O_T_EE).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.errors import InputError, shown
from rft_ros.messages import TOPICS, Role
from rft_ros.rft import AXES, POSE, POSITION, QUATERNION, STATE, TWIST
from rft_ros.table_file import TableColumns

ROTATION_VECTOR = ("rx", "ry", "rz")
MATRIX = tuple(f"m{k}" for k in range(16))

_POSITION = tuple(STATE[POSITION])
_QUATERNION = tuple(STATE[QUATERNION])
_TWIST = tuple(STATE[TWIST])
_TIME = "__time"  # PlotJuggler's
_COLUMNS_OF_ROLE: dict[Role, tuple[str, ...]] = {
    "pose": tuple(STATE[POSE]),
    "twist": _TWIST,
    "wrench": AXES,
}
_FIELDS: dict[Role, tuple[dict[str, tuple[str, ...]], ...]] = {
    "pose": (
        {"/pose/position/": _POSITION, "/pose/orientation/": _QUATERNION},
        {"/transform/translation/": _POSITION, "/transform/rotation/": _QUATERNION},
    ),
    "twist": ({"/twist/linear/": _TWIST[:3], "/twist/angular/": _TWIST[3:]},),
    "wrench": ({"/wrench/force/": AXES[:3], "/wrench/torque/": AXES[3:]},),
}
"""For each role, the fields of its messages as PlotJuggler writes them behind the topic, and the reader's names."""

_SERIES: dict[str, dict[int, tuple[str, ...]]] = {
    "pose": {6: (*_POSITION, *ROTATION_VECTOR), 7: (*_POSITION, *_QUATERNION)},
    "twist": {6: _TWIST},
    "wrench": {6: AXES},
    "matrix": {16: MATRIX},
}
"""Names that stand for numbered headings, as actual_TCP_pose_0 to actual_TCP_pose_5, by how many there are."""

_NAMES = ("t", *STATE, *AXES, *ROTATION_VECTOR, *MATRIX)


def parse_columns(text: str) -> dict[str, str]:
    """The headings by the reader's names, from text such as ``t=timestamp,px [mm]=x,pose=actual_TCP_pose``.

    Raises InputError for an entry that is none, and for a name that the reader does not know.
    """
    headings: dict[str, str] = {}
    for entry in filter(str.strip, text.split(",")):
        name, _, heading = (part.strip() for part in entry.partition("="))
        if not heading or name in headings:
            raise InputError(
                f"columns entry {shown(entry)} is not of the form NAME=HEADING, each NAME once, such as t=timestamp"
            )
        if name.split("[")[0].strip() not in (*_NAMES, *_SERIES):
            column_names = "t, px to qw, rx to rz, vx to wz, fx to tz, pose, twist, wrench, matrix"
            raise InputError(f"columns entry {shown(entry)}: {name} is none of {column_names}")
        headings[name] = heading
    return headings


def renamed(
    headings: Sequence[str],
    columns: Mapping[str, str],
    topics: Mapping[Role, str],
    named: str,
) -> list[str]:
    """The headings of a table with the reader's names in place of those that `columns` maps, and PlotJuggler's.

    `topics`: of each role; it decides where PlotJuggler's table has several topics of one type. `named`: the table in
    an error. Raises InputError for a mapped heading that is missing, and for several topics of which none is meant.
    """
    names: dict[int, str] = {}
    if _TIME in headings:
        names[headings.index(_TIME)] = "t"
        for role, layouts in _FIELDS.items():
            if not any(name in _COLUMNS_OF_ROLE[role] for name in columns):
                names |= _places_of_topic(headings, role, layouts, topics.get(role, ""), named)
    for name, heading in columns.items():
        names |= _places_of(headings, name, heading, named)
    mapped_headings = {name.split("[")[0].strip() for name in names.values()}
    other_headings = [
        f"({heading})" if heading in mapped_headings else heading for heading in headings
    ]
    return [names.get(place, heading) for place, heading in enumerate(other_headings)]


def _places_of_topic(
    headings: Sequence[str],
    role: Role,
    layouts: Sequence[Mapping[str, tuple[str, ...]]],
    topic: str,
    named: str,
) -> dict[int, str]:
    """Names by the places of one topic's columns."""
    names_by_topic: dict[str, dict[int, str]] = {}
    for place, heading in enumerate(headings):
        prefix, _, axis = heading.rpartition("/")
        for layout in layouts:
            for field, names in layout.items():
                names_by_axis = dict(zip("xyzw", names, strict=False))
                if f"{prefix}/".endswith(field) and axis in names_by_axis:
                    topic_of_column = f"{prefix}/".removesuffix(field)
                    names_by_topic.setdefault(topic_of_column, {})[place] = names_by_axis[axis]
    if len(names_by_topic) > 1 and topic not in names_by_topic:
        choice = f"choose one by --remap {TOPICS[role]}:={next(iter(names_by_topic))}"
        raise InputError(
            f"{named} has several topics of a {role}: {', '.join(names_by_topic)}; {choice}"
        )
    return names_by_topic.get(topic) or next(iter(names_by_topic.values()), {})


def _places_of(headings: Sequence[str], name: str, heading: str, named: str) -> dict[int, str]:
    """Names by the places of a heading that the user maps, or of a series of numbered ones."""
    if name not in _SERIES:
        if headings.count(heading) == 1:
            return {headings.index(heading): name}
        raise InputError(
            f"{named} has no single column {shown(heading)} for {name}; {_has(headings)}"
        )
    pattern = re.compile(rf"{re.escape(heading)}[_.\[ /]*(\d+)\]?")
    matches = [
        (int(match[1]), place)
        for place, text in enumerate(headings)
        if (match := pattern.fullmatch(text))
    ]
    names = _SERIES[name].get(len(matches))
    if names is None:
        count = " or ".join(map(str, _SERIES[name]))
        count_text = f"{len(matches)} numbered columns {shown(heading)}"
        raise InputError(
            f"{named} has {count_text} for {name}; it needs {count}; {_has(headings)}"
        )
    return {place: names[k] for k, (_, place) in enumerate(sorted(matches))}


def _has(headings: Sequence[str]) -> str:
    return f"its first line has {shown(', '.join(headings))}"


def with_quaternions(rows: TableColumns) -> TableColumns:
    """The rows with px .. qw in place of rotation vectors or matrices. A number that is no rotation becomes NaN."""
    columns = dict(rows.columns)
    units = dict(rows.units)
    if MATRIX[0] in columns:
        numbers = np.column_stack([columns.pop(name) for name in MATRIX]).reshape(-1, 4, 4)
        matrices = np.swapaxes(numbers, 1, 2)
        columns |= zip(_POSITION, matrices[:, :3, 3].T, strict=True)
        units |= dict.fromkeys(_POSITION, "m")
        columns |= _quaternion_columns(matrices[:, :3, :3], Rotation.from_matrix)
    elif ROTATION_VECTOR[0] in columns:
        vectors = np.column_stack([columns.pop(name) for name in ROTATION_VECTOR])
        columns |= _quaternion_columns(vectors, Rotation.from_rotvec)
    return replace(rows, columns=columns, units=units)


def _quaternion_columns(
    numbers: NDArray[np.float64], rotation: object
) -> dict[str, NDArray[np.float64]]:
    """Columns qx .. qw of finite rotations that `rotation` makes of numbers, shape [n, ...]; NaN elsewhere."""
    finite = np.isfinite(numbers).reshape(len(numbers), -1).all(axis=1)
    quaternions = np.full((len(numbers), 4), np.nan)
    if finite.any():
        quaternions[finite] = rotation(numbers[finite]).as_quat()  # type: ignore[operator]
    return dict(zip(_QUATERNION, quaternions.T, strict=True))
