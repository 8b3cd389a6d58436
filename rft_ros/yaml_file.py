"""Reads and writes YAML that means one thing: what ROS and YAML 1.1 read differently is refused.

ROS's parser (rcl_yaml_param_parser) follows the events of libyaml and reads numbers as C does: to it 0x1p3 is 8.0, `y`
is true, `~` and 12:30 are text. To PyYAML (YAML 1.1) they are text, text, nothing and 750. Both read 010 as eight.
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from itertools import takewhile
from pathlib import Path
from typing import Any, NoReturn

import yaml

from rft_ros.errors import InputError, reason_of, shown
from rft_ros.files import read_text, whole

_MOST_BYTES = 2**20
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the C one is libyaml, which ROS uses
_RESOLVER = yaml.resolver.Resolver()
_TEXT = "tag:yaml.org,2002:str"
_TRUE = {"true", "True", "TRUE"}
_FALSE = {"false", "False", "FALSE", "off"}
_NOTHING = {"", "~", "null", "Null", "NULL"}
_WHOLE = re.compile(r"[-+]?(0|[1-9][0-9]{0,17})")
_DECIMAL = re.compile(r"[-+]?(?!0[0-9]+$)([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]{1,2})?")
_NUMBER_TO_ROS = re.compile(
    r"[yYnN]|[-+]?([0-9]+|[0-9.]+[eE][-+]?[0-9]+|0[xX][0-9a-fA-F.]+([pP][-+]?[0-9]+)?|(?i:inf|infinity|nan)(\(.*\))?)"
)


def read_yaml(file: Path, what: str) -> Any:
    """The content of a YAML file: mappings, lists, text, bool, int, float, and None where there is no value.

    Raises InputError, which calls the file `what`, names the line and says what to write.
    """
    return yaml_content(read_text(file, what, limit=_MOST_BYTES), f"{what} '{file}'")


def yaml_content(text: str, named: str) -> Any:
    """The content of a YAML text. Raises InputError, which calls the text `named`."""
    reader = _Reader(text, named)
    try:
        return reader.document()
    except (yaml.YAMLError, RecursionError) as error:
        raise InputError(f"{named} is not YAML: {reason_of(error)}") from None


def yaml_text(tree: Mapping[str, Any]) -> str:
    """The YAML text of a tree, which ROS and `read_yaml` read back unchanged. A list of numbers stands on one line."""
    return yaml.dump(tree, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)


def write_yaml(
    file: Path,
    what: str,
    tree: Mapping[str, Any],
    comments: Iterable[str],
) -> None:
    """Write `yaml_text` below a line for each comment. Raises InputError, which calls the file `what`."""
    head = "".join(f"# {' '.join(comment.split())}\n" for comment in comments)
    with whole(file, what) as part:
        # a comment may name a file whose name is not UTF-8
        part.write_text(head + yaml_text(tree), encoding="utf-8", errors="backslashreplace")


class _Reader:
    """Follows the events of a YAML text. `named`: what an error calls it."""

    def __init__(self, text: str, named: str) -> None:
        self._events: Iterator[Any] = yaml.parse(text, Loader=_LOADER)
        self._named = named

    def document(self) -> Any:
        """The content of the only document; None if there is none."""
        contents: list[Any] = []
        for event in self._events:
            if isinstance(event, yaml.DocumentStartEvent):
                if contents:
                    self._refuse(event, "begins a second document (---); write one file for each")
                contents.append(self._node(next(self._events)))
        return contents[0] if contents else None

    def _refuse(self, event: Any, why: str) -> NoReturn:
        raise InputError(f"{self._named} line {event.start_mark.line + 1} {why}")

    def _node(self, event: Any) -> Any:
        """The content that begins with an event; the next events are the rest of it."""
        if isinstance(event, yaml.AliasEvent):
            self._refuse(event, "has an alias (*), which ROS does not read; write its values out")
        if event.tag:
            self._refuse(
                event,
                f"has the tag {shown(event.tag)}; write the value without it, text in quotes",
            )
        if isinstance(event, yaml.ScalarEvent):
            return self._scalar(event)
        within = takewhile(lambda e: not isinstance(e, yaml.CollectionEndEvent), self._events)
        if isinstance(event, yaml.SequenceStartEvent):
            return [self._node(item) for item in within]
        return self._mapping(within)

    def _mapping(self, keys: Iterator[Any]) -> dict[str, Any]:
        items: dict[str, Any] = {}
        for key in keys:
            name = getattr(key, "value", "")
            if not name or key.tag or "\0" in name:
                self._refuse(key, "has no text where a name is needed")
            if name == "<<":
                self._refuse(
                    key, "has a merge key (<<), which ROS reads as a name; write its values out"
                )
            if name in items:
                self._refuse(key, f"has '{name}' a second time; remove one")
            items[name] = self._node(next(self._events))
        return items

    def _scalar(self, event: Any) -> Any:
        text = event.value
        if event.style in ("|", ">"):
            self._refuse(event, "has a block of text (| or >); write it on one line, in quotes")
        if "\0" in text:
            self._refuse(event, "has a null character, at which ROS ends the text; remove it")
        if event.style:  # in quotes
            return text
        if text in _NOTHING:
            return None
        if text in _TRUE:
            return True
        if text in _FALSE:
            return False
        if _WHOLE.fullmatch(text):
            return int(text)
        if _DECIMAL.fullmatch(text) and math.isfinite(float(text)):
            return float(text)
        if not _is_text(text):
            self._refuse(
                event,
                f"has {shown(text)}, which is not one thing to every reader of YAML; "
                "write a decimal number, true or false, or put text in quotes",
            )
        return text


def _is_text(text: str) -> bool:
    """Whether a text without quotes is text to YAML 1.1 and to ROS."""
    is_text_to_yaml = _RESOLVER.resolve(yaml.ScalarNode, text, (True, False)) == _TEXT  # type: ignore[no-untyped-call]
    return is_text_to_yaml and _NUMBER_TO_ROS.fullmatch(text) is None


class _Dumper(yaml.SafeDumper):
    """Writes lists of numbers on one line and no aliases; quotes text that could be read as another type."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True

    def represent_sequence(
        self,
        tag: str,
        sequence: Any,
        flow_style: bool | None = None,  # noqa: ARG002
    ) -> yaml.SequenceNode:
        on_one_line = all(isinstance(v, int | float) for v in sequence)
        return super().represent_sequence(tag, sequence, on_one_line)

    def represent_text(self, data: str) -> yaml.ScalarNode:
        """Text, in quotes where it could be read as another type."""
        is_plain = data not in _NOTHING | _TRUE | _FALSE and _is_text(data)
        return self.represent_scalar(_TEXT, data, style=None if is_plain else '"')


_Dumper.add_representer(str, _Dumper.represent_text)
