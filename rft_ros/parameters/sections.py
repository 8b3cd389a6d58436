"""Reads the sections of a parameter file as ROS does, without ROS, and writes text that ROS reads back unchanged.

ROS's parser (rcl_yaml_param_parser) is no YAML loader. It follows the events of libyaml: sections are ordered by the
first appearance of their names, `<<` is a name, 010 is eight, `off` is false and `~` is text. A file that it does not
read, or that says something twice, is refused here. test/ros/test_parameter_files.py compares this parser with that of
ROS on random files.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from rft_ros.errors import InputError, reason_of, shown
from rft_ros.files import MAX_YAML, read_text

__all__ = ["Given", "Section", "flat", "parameter_file_text", "read_sections", "read_value"]

Given = bool | int | float | str | list[bool] | list[int] | list[float] | list[str]
"""A value in a parameter file, of the type that ROS reads."""

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the C one is libyaml, which ROS uses
_KEY = "ros__parameters"
_DEEPEST = 20  # levels of names
_TEXT = "tag:yaml.org,2002:str"
_TRUE = {"Y", "y", "yes", "Yes", "YES", "true", "True", "TRUE", "on", "On", "ON"}
_FALSE = {"N", "n", "no", "No", "NO", "false", "False", "FALSE", "off", "Off", "OFF"}
_SIGN = r"[ \t\n\v\f\r]*[-+]?"
_WHOLE = re.compile(rf"{_SIGN}(0[xX][0-9a-fA-F]+|(?P<octal>0[0-7]*)|[1-9][0-9]{{0,18}})")  # 64 bits: 19 digits
_DECIMAL = re.compile(rf"{_SIGN}([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?")
_HEXADECIMAL = re.compile(rf"{_SIGN}0[xX]([0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)([pP][-+]?[0-9]+)?")
_NOT_FINITE = re.compile(rf"{_SIGN}(?i:inf|infinity|nan|nan\([0-9A-Z_]*\))|\.(nan|NaN|NAN)|[-+]?\.(inf|Inf|INF)")
_WORD = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_LONGEST = 200  # characters of a part of a node's name


@dataclass(frozen=True, slots=True)
class Section:
    """The parameters that a file sets for the nodes of one name.

    `key`: the name as it is written. `name`: the full name with its namespace, which begins with "/"; ``/*`` stands for
    one part of any name and ``/**`` for any number of parts. `parameters`: by name with dots. `fault`: why ROS would
    read something else than the file says; empty where it does not.
    """

    key: str
    parameters: dict[str, Given]
    fault: str = ""

    @property
    def name(self) -> str:
        """The full name."""
        return self.key if self.key.startswith("/") else f"/{self.key}"

    def is_for(self, node: str) -> bool:
        """Whether the node with this full name takes the parameters."""
        return bool(re.fullmatch(self.name.replace("/*", r"(/\w+)"), node, re.ASCII))


def flat(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The names of a nested mapping, joined by dots, with their values."""
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def read_sections(file: Path) -> list[Section]:
    """The sections of a parameter file in ROS's order. Raises InputError for a file that ROS does not read."""
    text = read_text(file, "parameter file", limit=MAX_YAML)
    try:
        found = list(_Events(text).sections())
    except yaml.YAMLError as error:
        raise InputError(f"parameter file '{file}' is not YAML: {reason_of(error)}") from None
    except _UnreadableError as error:
        raise InputError(f"parameter file '{file}' {error}") from None
    merged: dict[str, Section] = {}
    for section in found:
        if section.key in merged:  # ROS would merge both into one, at the place of the first
            first, again = merged[section.key], f"'{section.key}' stands twice; put its parameters into one section"
            section = Section(first.key, first.parameters | section.parameters, again)
        merged[section.key] = section
    return list(merged.values())


def read_value(text: str) -> Given | None:
    """The value that ROS reads from ``-p NAME:=text``; None if ROS reads no value."""
    try:
        return _Events(text).value()
    except (yaml.YAMLError, _UnreadableError):
        return None


def parameter_file_text(tree: Mapping[str, Any]) -> str:
    """The YAML text of sections, which ROS and `read_sections` read back unchanged. A list stands on one line."""
    return yaml.dump(tree, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)


class _Dumper(yaml.SafeDumper):
    """Writes lists of numbers on one line and no aliases; quotes text that ROS would read as another type."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 - ROS reads none
        return True

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> yaml.SequenceNode:  # noqa: ARG002
        return super().represent_sequence(tag, sequence, all(isinstance(v, int | float) for v in sequence))

    def represent_str(self, data: str) -> yaml.ScalarNode:
        """Text in quotes if ROS would otherwise read another type."""
        is_text_to_ros = bool(data) and isinstance(_scalar(data), str)
        return self.represent_scalar(_TEXT, data, style=None if is_text_to_ros else '"')


_Dumper.add_representer(str, _Dumper.represent_str)


class _UnreadableError(Exception):
    """The reason why a file cannot be used, as the rest of a sentence that begins with the file's name."""


class _Events:
    """Parses a YAML text event by event, as ROS does, into sections or one value. `_event` is the next event."""

    def __init__(self, text: str) -> None:
        self._events: Iterator[Any] = yaml.parse(text, Loader=_LOADER)
        self._fault = ""
        self._flow = 0
        self._next()

    def _next(self) -> Any:
        """Take the next event and read the one after it."""
        taken = getattr(self, "_event", None)
        self._event = next(self._events, None)
        self._refuse_colon_in_flow()
        if isinstance(self._event, yaml.AliasEvent):
            raise _UnreadableError(
                f"is not YAML: line {self._line} has an alias (*), which ROS does not read; write its values out"
            )
        return taken

    def _refuse_colon_in_flow(self) -> None:
        """Refuse text without quotes between braces or brackets at which older versions of libyaml stop."""
        event = self._event
        if isinstance(event, yaml.CollectionStartEvent):
            self._flow += bool(event.flow_style) or self._flow > 0
        elif isinstance(event, yaml.CollectionEndEvent):
            self._flow = max(self._flow - 1, 0)
        elif self._flow and isinstance(event, yaml.ScalarEvent) and not event.style and {":", "?"} & {*event.value}:
            raise _UnreadableError(
                f"has {shown(str(event.value))} without quotes between braces or brackets in line {self._line}; not"
                " every ROS reads a colon or a question mark there, so put quotes around it"
            )

    @property
    def _line(self) -> int:
        return int(self._event.start_mark.line) + 1 if self._event else 0

    def _content(self) -> None:
        """Skip the events before the content of the document."""
        while isinstance(self._event, yaml.StreamStartEvent | yaml.DocumentStartEvent):
            self._next()

    def _end(self) -> None:
        self._next()
        if not isinstance(self._event, yaml.StreamEndEvent | None):
            raise _UnreadableError("has several documents (---); ROS mixes them up, so write one file for each")

    def sections(self) -> Iterator[Section]:
        """All sections, in the file's order."""
        self._content()
        if not isinstance(self._event, yaml.MappingStartEvent):
            raise _UnreadableError("has no node name at its top level, such as '/**'")
        self._next()
        yield from self._nodes("", 0)
        self._end()

    def value(self) -> Given | None:
        """The value of a text that has only one."""
        self._content()
        found = self._list("value") if isinstance(self._event, yaml.SequenceStartEvent) else self._value("value")
        self._end()
        return found

    def _name(self, of: str) -> str:
        if not isinstance(self._event, yaml.ScalarEvent):
            raise _UnreadableError(f"has a list or a mapping as the name {of} in line {self._line}; ROS needs text")
        name = str(self._next().value)
        if not name or "\0" in name:
            raise _UnreadableError(f"has an empty name {of} before line {self._line}, or one with a null character")
        return name

    def _nodes(self, parent: str, depth: int) -> Iterator[Section]:
        """The sections in the rest of a mapping whose keys are names of nodes and namespaces below `parent`."""
        while not isinstance(self._event, yaml.MappingEndEvent):
            line, name = self._line, self._name("of a node")
            if name.startswith(_KEY):
                raise _UnreadableError(
                    f"has '{name}' in line {line}, where the name of a node is needed, such as '/**'"
                )
            if depth and "/" in name:
                raise _UnreadableError(
                    f"has '{name}' in line {line} below '{parent}'; write both in one: '{parent}/{name}'"
                )
            full = f"{parent}{'' if not parent or parent.endswith('/') else '/'}{name}"
            if not isinstance(self._event, yaml.MappingStartEvent) or depth > _DEEPEST:
                raise _UnreadableError(_without_parameters(parent or full, line))
            yield from self._node(full, depth, line)
        self._next()

    def _node(self, full: str, depth: int, line: int) -> Iterator[Section]:
        """What the mapping of a name holds: parameters, or names of nodes."""
        self._next()
        if isinstance(self._event, yaml.MappingEndEvent):
            raise _UnreadableError(_without_parameters(full, line))
        key = self._event
        if not (isinstance(key, yaml.ScalarEvent) and key.value == _KEY):
            yield from self._nodes(full, depth + 1)
            return
        self._next()
        if not _is_node_name(full):
            raise _UnreadableError(f"has '{full}' in line {line}, which is no name of a node to ROS; correct it")
        if not isinstance(self._event, yaml.MappingStartEvent):
            raise _UnreadableError(f"'{full}' has a '{_KEY}' without names of parameters (line {self._line})")
        self._fault = ""
        parameters: dict[str, Given] = {}
        self._parameters("", parameters, set())
        if not isinstance(self._event, yaml.MappingEndEvent):
            raise _UnreadableError(
                f"'{full}' has more than '{_KEY}' (line {self._line}); write it as a section of its own"
            )
        self._next()
        yield Section(full, parameters, self._fault)

    def _parameters(self, group: str, found: dict[str, Given], groups: set[str]) -> None:
        """Add the parameters of a mapping to `found`, and the groups of names in it to `groups`."""
        self._next()
        if group and isinstance(self._event, yaml.MappingEndEvent):
            raise _UnreadableError(f"'{group[:-1]}' in line {self._line} has no parameters; remove it, ROS stops there")
        met = set[str]()
        while not isinstance(self._event, yaml.MappingEndEvent):
            line, key = self._line, self._name("of a parameter")
            name = f"{group}{key}"
            if key == "<<":
                self._refuse(f"line {line} has a merge key (<<), which ROS reads as a name; write its values out")
            if key in met or name in found or name in groups:
                self._refuse(f"'{name}' stands twice, again in line {line}; ROS would mix the values up, so remove one")
            met.add(key)
            if isinstance(self._event, yaml.MappingStartEvent):
                if name.count(".") > _DEEPEST:
                    raise _UnreadableError(f"has a name of more than {_DEEPEST} levels in line {line}: '{name[:80]}'")
                groups.add(name)
                self._parameters(f"{name}.", found, groups)
            elif isinstance(self._event, yaml.SequenceStartEvent):
                found[name] = self._list(name)
            else:
                found[name] = self._value(name)
        self._next()

    def _list(self, name: str) -> Given:
        line = self._line
        self._next()
        values: list[Any] = []
        while not isinstance(self._event, yaml.SequenceEndEvent):
            values.append(self._value(name))
        self._next()
        if len({type(v) for v in values}) > 1:
            one = "ROS takes lists of one type only, such as [0.0, 0.5]"
            raise _UnreadableError(f"line {line}: {name} is {shown(values)}; {one}")
        return values

    def _value(self, name: str) -> Any:
        line = self._line
        if not isinstance(self._event, yaml.ScalarEvent):
            raise _UnreadableError(
                f"line {line}: {name} has a list or a mapping in a list; ROS takes lists of values only"
            )
        event = self._next()
        quoted = event.style in ("'", '"')
        if not event.value and not quoted:
            raise _UnreadableError(f"line {line}: {name} has no value; ROS reads the file no further, so give it one")
        if "\0" in event.value:
            self._refuse(f"{name} has a null character in line {line}, at which ROS ends the text; remove it")
        if quoted or event.tag == _TEXT:
            return event.value
        return _scalar(event.value)

    def _refuse(self, why: str) -> None:
        self._fault = self._fault or why


def _without_parameters(name: str, line: int) -> str:
    return f"'{name}' has no '{_KEY}' (line {line}); write '{_KEY}:' below it, and the parameters below that"


def _scalar(text: str) -> bool | int | float | str:
    """The value of a text without quotes, as C's strtoll with base 0 and strtod read it."""
    if text in _TRUE or text in _FALSE:
        return text in _TRUE
    match = _WHOLE.fullmatch(text)
    if match:
        whole = int(text, 8 if match["octal"] else 0)
        if -(2**63) <= whole < 2**63:
            return whole
    if _DECIMAL.fullmatch(text):
        number = float(text)
        return number if math.isfinite(number) else text
    if _HEXADECIMAL.fullmatch(text):
        try:
            return float.fromhex(text.strip())
        except OverflowError:
            return text
    if _NOT_FINITE.fullmatch(text):
        number = math.nan if "nan" in text.lower() else math.inf
        return -number if "-" in text else number
    return text


def _is_node_name(full: str) -> bool:
    """Whether ROS takes this for the name of nodes, with its namespace."""
    parts = full.removeprefix("/").split("/")
    return all(part in ("*", "**") or (_WORD.fullmatch(part) and len(part) <= _LONGEST) for part in parts)
