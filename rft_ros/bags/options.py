"""What a replay takes of a recording: its part, its tare, and the topic of each role."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rft_ros.errors import InputError, shown
from rft_ros.logged_columns import parse_columns
from rft_ros.messages import TOPICS, Role
from rft_ros.parameters import NODE, Config, Values, section_parameters

REPLAY_SECTION = "rft_replay"
"""The section of a parameter file that has the options of a replay."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """Options of a replay. `remap`: rules such as ``~/pose:=/tool_pose``. `tare`: its length, at the beginning [s].

    `columns`: headings of a table by the reader's names, such as ``t=timestamp,pose=actual_TCP_pose``. `node`: the
    full name of the node that subscribed to the topics.
    `start`, `end`: the part of the bag that is replayed [s]. Raises InputError for values that are no times, and if
    `end` is not after `start`.
    """

    remap: Sequence[str] = ()
    tare: float | None = None
    start: float | None = None
    end: float | None = None
    node: str = NODE
    columns: str = ""

    def __post_init__(self) -> None:
        if not isinstance(self.columns, str):
            raise InputError(f"columns is {shown(self.columns)}; it must be text, t=timestamp,...")
        parse_columns(self.columns)
        if not isinstance(self.remap, list | tuple) or not all(
            isinstance(rule, str) for rule in self.remap
        ):
            raise InputError(f"remap is {shown(self.remap)}; it must be a list of strings")
        for name in ("start", "end", "tare"):
            seconds = getattr(self, name)
            is_number = type(seconds) in (int, float)
            if seconds is not None and not (is_number and 0.0 <= seconds <= 1e9):
                raise InputError(
                    f"{name} is {shown(seconds)}; it must be a number from 0 to 1e9 [s]"
                )
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise InputError(f"end is {self.end:g} s; it must be after start, {self.start:g} s")


def read_replay_options(file: Path) -> ReplayOptions:
    """The options under ``rft_replay: ros__parameters:`` of a parameter file, if any; the node ignores them."""
    section: dict[str, Any] = {**section_parameters(file, REPLAY_SECTION)}
    try:
        for name, value in section.items():
            if name not in ("remap", "columns", "tare", "start", "end"):
                raise InputError(
                    f"{name} is {shown(value)}; it has remap, columns, and the numbers tare, start and end [s]"
                )
        return ReplayOptions(**section)
    except InputError as error:
        raise InputError(f"parameter file '{file}': {REPLAY_SECTION} {error}") from None


def merged_rules(rules: Sequence[str], later_rules: Sequence[str]) -> list[str]:
    """The rules of both, but for those that a later one overrides."""
    by_topic: dict[str, str] = {}
    for rule in (*rules, *later_rules):
        left = rule.partition(":=")[0].strip()
        by_topic.pop(left, None)
        by_topic[left] = rule
    return list(by_topic.values())


def topics_of(
    parameters: Config | Values, remap: Sequence[str] = (), node: str = NODE
) -> dict[Role, str]:
    """The topic of each role that the parameters need: NODE/pose and so on, unless a rule of `remap` gives another.

    A later rule overrides an earlier one. With `pose_source` tf, /tf takes the place of the topic of poses. Raises
    InputError for a rule that cannot be used.
    """
    config = Config.of(parameters)
    topics = {role: _resolved(name, node) for role, name in TOPICS.items()}
    roles = {topic: role for role, topic in topics.items()}
    for rule in remap:
        left, _, right = (part.strip() for part in rule.partition(":="))
        if not right:
            raise InputError(
                f"remap '{rule}' is not of the form FROM:=TO, such as ~/pose:=/tool_pose"
            )
        role = roles.get(_resolved(left, node))
        if role is None or not left.startswith(("/", "~")):
            raise InputError(
                f"remap '{rule}': '{left}' is none of {', '.join(TOPICS[role] for role in topics)}"
            )
        topics[role] = _resolved(right, node)
    is_used: dict[Role, bool] = {
        "pose": config.inputs.pose_source != "tf",
        "tf": config.inputs.pose_source == "tf",
        "twist": config.inputs.twist_source == "topic",
        "surface": config.ground.cell > 0.0,
    }
    return {role: topic for role, topic in topics.items() if is_used.get(role, True)}


def _resolved(name: str, node: str) -> str:
    """A topic's full name, as ROS resolves it for the node."""
    if name.startswith("~"):
        return node + name[1:]
    return name if name.startswith("/") else f"{node.rpartition('/')[0]}/{name}"
