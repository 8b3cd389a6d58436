"""The node's command line: its parameter files, and the parameters that ``-p`` sets."""

import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rft_ros.parameters.sections import Given

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


def given_parameters(node: str) -> "dict[str, tuple[Given, Path | None]]":
    """The parameters that files and ``-p`` set for a node, each with its file. `node`: its full name.

    As in ROS, sections of one name are merged, also across files, and stand in the place of the first; a later value
    overrides an earlier one. ``-p`` sets parameters of ``/**``.
    """
    from rft_ros.parameters.sections import Section, read_sections, read_value  # numba; `main` handles signals first

    by_section: dict[str, dict[str, tuple[Given, Path | None]]] = {}
    for option, text in _options():
        file, sections = None, list[Section]()
        if option == "--params-file":
            file = Path(text)
            sections = read_sections(file)
        elif option in ("-p", "--param"):
            name, _, value = text.partition(":=")
            of_node, separator, parameter = name.rpartition(":")
            read = read_value(value)
            if read is not None:
                sections = [Section(of_node if separator else "/**", {parameter: read})]
        for section in sections:
            found = by_section.setdefault(section.key, {})
            if section.is_for(node):
                found.update({name: (value, file) for name, value in section.parameters.items()})
    return {name: given for found in by_section.values() for name, given in found.items()}
