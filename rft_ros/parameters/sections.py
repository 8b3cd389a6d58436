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
        pattern = self.name.replace("/**", r"(/\w+)*").replace("/*", r"/\w+")
        return bool(re.fullmatch(pattern, node, re.ASCII))


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
        node = _tree(text)
        if not isinstance(node, yaml.MappingNode):
            raise _UnreadableError("has no node name at its top level, such as '/**'")
        found = [*_sections(node, "", 0)]
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
        value: Given = _value("value", _tree(text))[0]
    except _UnreadableError:
        return None
    return value


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


def _tree(text: str) -> Any:
    """The nodes of a YAML text, with the tags that it gives; None if there are none. Raises _UnreadableError."""
    node = None
    try:
        events = yaml.parse(text, Loader=_LOADER)
        for event in events:
            if isinstance(event, yaml.DocumentStartEvent):
                if node is not None:
                    raise _UnreadableError("has several documents (---); ROS mixes them up, so write one file for each")
                node = _node(next(events), events, in_flow=False)
    except (yaml.YAMLError, RecursionError) as error:
        raise _UnreadableError(f"is not YAML: {reason_of(error)}") from None
    return node


def _node(event: Any, events: Iterator[Any], *, in_flow: bool) -> Any:
    """The node that begins with an event; the next events are its content. `in_flow`: between braces or brackets."""
    mark = event.start_mark
    if isinstance(event, yaml.AliasEvent):
        why = f"line {mark.line + 1} has an alias (*), which ROS does not read; write its values out"
        raise _UnreadableError(f"is not YAML: {why}")
    if isinstance(event, yaml.ScalarEvent):
        if in_flow and not event.style and {":", "?"} & {*event.value}:  # at which older versions of libyaml stop
            raise _UnreadableError(
                f"has {shown(event.value)} without quotes between braces or brackets in line {mark.line + 1}; not every"
                " ROS reads a colon or a question mark there, so put quotes around it"
            )
        return yaml.ScalarNode(event.tag or "", event.value, mark, style=event.style)
    items = []
    while not isinstance(inner := next(events), yaml.CollectionEndEvent):
        items.append(_node(inner, events, in_flow=in_flow or bool(event.flow_style)))
    if isinstance(event, yaml.SequenceStartEvent):
        return yaml.SequenceNode(event.tag or "", items, mark)
    return yaml.MappingNode(event.tag or "", [*zip(items[::2], items[1::2], strict=True)], mark)


def _line(node: yaml.Node) -> int:
    return int(node.start_mark.line) + 1


def _name(node: Any, of: str) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise _UnreadableError(f"has a list or a mapping as the name {of} in line {_line(node)}; ROS needs text")
    if not node.value or "\0" in node.value:
        raise _UnreadableError(f"has an empty name {of} in line {_line(node)}, or one with a null character")
    return str(node.value)


def _sections(mapping: yaml.MappingNode, parent: str, depth: int) -> Iterator[Section]:
    """The sections in a mapping whose keys are names of nodes and namespaces below `parent`."""
    for key, content in mapping.value:
        line, name = _line(key), _name(key, "of a node")
        if name.startswith(_KEY):
            raise _UnreadableError(f"has '{name}' in line {line}, where the name of a node is needed, such as '/**'")
        if depth and "/" in name:
            raise _UnreadableError(
                f"has '{name}' in line {line} below '{parent}'; write both in one: '{parent}/{name}'"
            )
        full = f"{parent}{'' if not parent or parent.endswith('/') else '/'}{name}"
        is_mapping = isinstance(content, yaml.MappingNode)
        if not is_mapping or not content.value or depth > _DEEPEST:
            where = f"'{full if is_mapping else parent or full}' has no '{_KEY}' (line {line})"
            raise _UnreadableError(f"{where}; write '{_KEY}:' below it, and the parameters below that")
        (first, parameters), *others = content.value
        if first.value != _KEY:
            yield from _sections(content, full, depth + 1)
            continue
        if not _is_node_name(full):
            raise _UnreadableError(f"has '{full}' in line {line}, which is no name of a node to ROS; correct it")
        if not isinstance(parameters, yaml.MappingNode):
            raise _UnreadableError(f"'{full}' has a '{_KEY}' without names of parameters (line {_line(parameters)})")
        found: dict[str, Given] = {}
        faults = [*_add_parameters(parameters, "", found, set())]
        if others:
            where = f"line {_line(others[0][0])}"
            raise _UnreadableError(f"'{full}' has more than '{_KEY}' ({where}); write it as a section of its own")
        yield Section(full, found, faults[0] if faults else "")


def _add_parameters(mapping: yaml.MappingNode, group: str, found: dict[str, Given], groups: set[str]) -> Iterator[str]:
    """Add the parameters of a mapping to `found`, and the groups of names in it to `groups`. Yields faults."""
    if group and not mapping.value:
        raise _UnreadableError(f"'{group[:-1]}' in line {_line(mapping)} has no parameters; remove it, ROS stops there")
    met = set[str]()
    for node, content in mapping.value:
        line, key = _line(node), _name(node, "of a parameter")
        name = f"{group}{key}"
        if key == "<<":
            yield f"line {line} has a merge key (<<), which ROS reads as a name; write its values out"
        if key in met or name in found or name in groups:
            yield f"'{name}' stands twice, again in line {line}; ROS would mix the values up, so remove one"
        met.add(key)
        if not isinstance(content, yaml.MappingNode):
            found[name], faults = _value(name, content)
            yield from faults
            continue
        if name.count(".") > _DEEPEST:
            raise _UnreadableError(f"has a name of more than {_DEEPEST} levels in line {line}: '{name[:80]}'")
        groups.add(name)
        yield from _add_parameters(content, f"{name}.", found, groups)


def _value(name: str, node: Any) -> tuple[Any, list[str]]:
    """A value, and its faults."""
    is_list = isinstance(node, yaml.SequenceNode)
    values: list[Any] = []
    faults = []
    for item in node.value if is_list else [node]:
        if not isinstance(item, yaml.ScalarNode):
            where = f"line {_line(node)}: " if node else ""
            raise _UnreadableError(f"{where}{name} has a list or a mapping in a list; ROS takes lists of values only")
        line, quoted = _line(item), item.style in ("'", '"')
        if not item.value and not quoted:
            raise _UnreadableError(f"line {line}: {name} has no value; ROS reads the file no further, so give it one")
        if "\0" in item.value:
            faults.append(f"{name} has a null character in line {line}, at which ROS ends the text; remove it")
        values.append(item.value if quoted or item.tag == _TEXT else _scalar(item.value))
    if len({type(value) for value in values}) > 1:
        one = "ROS takes lists of one type only, such as [0.0, 0.5]"
        raise _UnreadableError(f"line {_line(node)}: {name} is {shown(values)}; {one}")
    return (values if is_list else values[0]), faults


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
