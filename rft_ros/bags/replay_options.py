"""What a replay needs beside the node's parameters, from the same parameter file."""

from dataclasses import dataclass
from pathlib import Path

from rft_ros.errors import InputError
from rft_ros.estimator.parameter_file import node_parameters

__all__ = ["ReplayOptions", "read_replay_options"]

_SECTION = "rft_replay"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """Which topics and which part of a bag.

    `remap`: rules such as ``~/pose:=/tool_pose``. `tare`: take the load cell's bias from this many seconds at the
    beginning. `start`, `end`: use this part of the bag only [s]. Raises InputError for spans that cannot be.
    """

    remap: tuple[str, ...] = ()
    tare: float | None = None
    start: float | None = None
    end: float | None = None

    def __post_init__(self) -> None:
        for name, seconds in (("start", self.start), ("end", self.end), ("tare", self.tare)):
            if seconds is not None and not 0.0 <= seconds <= 1e9:
                raise InputError(f"{name} is {seconds} s; it must be a number of seconds from 0 on")
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise InputError(f"end is {self.end:g} s; it must be after start, {self.start:g} s")


def read_replay_options(file: Path) -> ReplayOptions:
    """The options under ``rft_replay: ros__parameters:`` of a parameter file, if any; the node passes them over."""
    section = node_parameters(file, (_SECTION,))
    remap = section.pop("remap", ())
    if not isinstance(remap, list | tuple) or not all(isinstance(rule, str) for rule in remap):
        raise InputError(f"parameter file '{file}': {_SECTION} remap is {remap!r}; it must be a list of strings")
    for name, value in section.items():
        if name not in ("tare", "start", "end"):
            raise InputError(f"parameter file '{file}': {_SECTION} has no '{name}'; it has remap, tare, start, end")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"parameter file '{file}': {_SECTION} {name} is {value!r}; it must be a number [s]")
    return ReplayOptions(remap=tuple(remap), **section)
