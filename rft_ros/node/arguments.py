"""What the node's command line gives it: parameter files, and parameters with ``-p``."""

import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rft_ros.parameters.sections import Given, Section

__all__ = ["given_parameters", "parameter_files"]


def parameter_files() -> list[Path]:
    """The parameter files on the command line."""
    return [Path(value) for option, value in _options() if option == "--params-file"]


def _options() -> Iterator[tuple[str, str]]:
    """ROS's arguments, each with the one after it."""
    for_ros = False
    for argument, after in itertools.pairwise([*sys.argv, ""]):
        for_ros = (for_ros or argument == "--ros-args") and argument != "--"
        if for_ros:
            yield argument, after


def given_parameters(node: str) -> "dict[str, Given]":
    """What files and ``-p`` give the node of this full name, by parameter: the last value of a section counts.

    Sections of one name are one, in the place of the first, also across files; ``-p`` gives to ``/**``, as in ROS.
    """
    from rft_ros.parameters.sections import Section  # loads numba, while this module is read before the signals are

    found: dict[str, Section] = {}
    for section in _sections():
        first = found.setdefault(section.key, Section(section.key, section.name))
        first.parameters.update(section.parameters)
    return {name: value for s in found.values() if s.is_for(node) for name, value in s.parameters.items()}


def _sections() -> "Iterator[Section]":
    from rft_ros.parameters.sections import Section, read_sections, read_value

    for option, text in _options():
        if option == "--params-file":
            yield from read_sections(Path(text))
        elif option in ("-p", "--param"):
            name, _, value = text.partition(":=")
            node, separator, parameter = name.rpartition(":")
            key = node if separator else "/**"
            if (read := read_value(value)) is not None:
                yield Section(key, key if key.startswith("/") else f"/{key}", {parameter: read})
