"""The node's command line: its parameter files, and the parameters that ``-p`` sets."""

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
    """The arguments after ``--ros-args``, each with the one that follows it."""
    for_ros = False
    for argument, after in itertools.pairwise([*sys.argv, ""]):
        for_ros = (for_ros or argument == "--ros-args") and argument != "--"
        if for_ros:
            yield argument, after


def given_parameters(node: str) -> "dict[str, Given]":
    """The parameters that files and ``-p`` set for a node. `node`: its full name.

    As in ROS, sections of one name are merged, also across files, and stand in the place of the first; a later value
    overrides an earlier one. ``-p`` sets parameters of ``/**``.
    """
    from rft_ros.parameters.sections import Section  # here, since it imports numba: `main` handles signals first

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
            read = read_value(value)
            if read is not None:
                yield Section(key, key if key.startswith("/") else f"/{key}", {parameter: read})
