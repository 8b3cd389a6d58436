"""The node's command line: its parameter files, the parameters that ``-p`` sets, and what is not for ROS."""

import itertools
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rft_ros.parameters.sections import Section

__all__ = ["given_sections", "not_for_ros"]


def _arguments(*, for_ros: bool) -> list[str]:
    """The arguments between ``--ros-args`` and ``--``, or the others."""
    found, inside = [], False
    for argument in sys.argv[1:]:
        if argument == ("--" if inside else "--ros-args"):
            inside = not inside
        elif inside == for_ros:
            found.append(argument)
    return found


def not_for_ros() -> list[str]:
    """The arguments that ROS would ignore."""
    return _arguments(for_ros=False)


def given_sections() -> "list[tuple[Path | None, list[Section]]]":
    """The sections of each parameter file, and of each parameter that ``-p`` sets, which has no file."""
    from rft_ros.parameters import Section, read_sections, read_value  # numba; `main` handles signals first

    found: list[tuple[Path | None, list[Section]]] = []
    for option, text in itertools.pairwise(_arguments(for_ros=True)):
        if option == "--params-file":
            found.append((Path(text), read_sections(Path(text))))
        elif option in ("-p", "--param"):
            name, _, value = text.partition(":=")
            of_node, separator, parameter = name.rpartition(":")
            read = read_value(value)
            if read is not None:
                found.append((None, [Section(of_node if separator else "/**", {parameter: read})]))
    return found
