"""A design study read from YAML: its variants, in a fixed order."""

import itertools
import math
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from rft_ros.errors import InputError, shown
from rft_ros.files import read_file
from rft_ros.installation import release
from rft_ros.parameters import OPTIONS, MeshConfig, config_of_options, is_medium_file
from rft_ros.parameters.parameter import parameter_fields
from rft_ros.rft.arguments import number, whole_number
from rft_ros.sweeps.motions import FAMILIES, Trajectory
from rft_ros.tool import files_of_mesh, locate_mesh
from rft_ros.yaml_file import read_yaml

Kind = Literal["release", "mesh", "file"]

_PARTS = ("tools", "motions", "media")
_TOOL_NAMES = tuple(parameter.option for parameter in parameter_fields(MeshConfig).values())
_MEDIUM_NAMES = tuple(name for name in OPTIONS if name not in _TOOL_NAMES)
_VECTORS = ("origin", "rotate")  # a list of numbers is one value of these
_MAX_COUNT = 1_000_000  # variants, values in a range, samples, and the greatest number in a motion
_SEED_LIMIT = 10**18 - 1  # YAML readers round integers of more digits
_LEAST = {"samples": 2, "speed": 1e-9, "travel": 1e-9, "pitch": 1e-9}


class Variant(NamedTuple):
    """One variant of a design: a tool, a motion and a medium, each as a dict of plain values."""

    tool: Mapping[str, Any]
    motion: Mapping[str, Any]
    medium: Mapping[str, Any]


class Design(NamedTuple):
    """The variants of a study: every combination of its tools, motions and media, or a sample of them."""

    file: Path
    variants: Sequence[Variant]

    def files(self) -> set[Path]:
        """The meshes, states files and medium files that the study names."""
        return {
            locate_mesh(name) if kind == "mesh" else Path(name) for kind, name in self._named()
        }

    def contents(self) -> tuple["Content", ...]:
        """What the results depend on beside the variants: the release of rft_ros, and each of `files`."""
        sources: list[tuple[Kind, str]] = [("release", "rft_ros"), *sorted(self._named())]
        return tuple(Content(kind, name, checksum_of(kind, name)) for kind, name in sources)

    def fingerprint(self) -> int:
        """Checksum of the study and its `contents`."""
        return zlib.crc32(
            repr(self.contents()).encode(), zlib.crc32(read_file(self.file, "study"))
        )

    def _named(self) -> set[tuple[Kind, str]]:
        sources = set[tuple[Kind, str]]()
        for tool, motion, medium in self.variants:
            sources.add(("mesh", tool["mesh"]))
            if "states_file" in motion:
                sources.add(("file", motion["states_file"]))
            if is_medium_file(str(medium.get("medium", ""))):
                sources.add(("file", medium["medium"]))
        return sources


class Content(NamedTuple):
    """What the results of a study depend on. `checksum`: None if there is no such file."""

    kind: Kind
    name: str
    checksum: int | None


def checksum_of(kind: Kind, name: str) -> int | None:
    """Checksum of a content as this process finds it. A relative path may name another file in another process."""
    if kind == "release":
        return zlib.crc32(release().encode())
    try:
        files = files_of_mesh(name) if kind == "mesh" else [Path(name)]
        return zlib.crc32(b"".join(read_file(file, "file") for file in files))
    except InputError:  # the rows of its variants will give the reason
        return None


def motion_of(entry: Mapping[str, Any]) -> tuple[Trajectory, int]:
    """The motion of a variant without a states file, and its number of samples. Raises ValueError."""
    numbers = {"samples": 200, **entry}
    family = numbers.pop("family", None)
    if not isinstance(family, str) or family not in FAMILIES:
        raise InputError(
            f"family is {shown(family)}; it must be one of {', '.join(FAMILIES)}, or a states_file"
        )
    _check_names(numbers, ("family", "samples", *signature(FAMILIES[family]).parameters))
    for name, value in numbers.items():
        least = _LEAST.get(name, -_MAX_COUNT)
        if type(value) not in (int, float) or not least <= value <= _MAX_COUNT:
            raise InputError(
                f"{name} is {shown(value)}; it must be a number from {least:g} to {_MAX_COUNT:,}"
            )
    samples = whole_number("samples", numbers.pop("samples"), least=2, most=_MAX_COUNT)
    return FAMILIES[family](**numbers), samples


def _check_names(entry: Mapping[str, Any], allowed: Collection[str]) -> None:
    for name in entry:
        if name not in allowed:
            raise InputError(f"there is no '{name}'; use {', '.join(allowed)}")


def read_design(file: Path) -> Design:
    """Read a study. Raises InputError, which names file, entry and value."""
    content = read_yaml(file, "study")
    if not isinstance(content, Mapping):
        raise InputError(f"study '{file}' has no entries; it needs tools, motions and media")
    try:
        _check_names(content, (*_PARTS, "sample", "seed"))
        parts = [list(_expanded(name, content.get(name))) for name in _PARTS]
        total = math.prod(map(len, parts))
        if total > _MAX_COUNT:
            raise InputError(f"it has {total:,} variants; the limit is {_MAX_COUNT:,}")
        sample = whole_number("sample", content.get("sample", total), most=total)
        seed = whole_number("seed", content.get("seed", 0), least=0, most=_SEED_LIMIT)
    except ValueError as error:
        raise InputError(f"study '{file}': {error}") from None
    variants = list(itertools.starmap(Variant, itertools.product(*parts)))
    picks = np.random.default_rng(seed).permutation(total)[:sample]
    return Design(file, [variants[k] for k in sorted(picks)])


def _expanded(name: str, entries: object) -> Iterator[dict[str, Any]]:
    """One dict for each combination of the values in an entry's lists and ranges."""
    if not isinstance(entries, list) or not entries:
        raise InputError(f"{name} is {shown(entries)}; it must be a list of entries")
    for place, entry in enumerate(entries, start=1):
        try:
            if not isinstance(entry, Mapping):
                raise InputError(f"it is {shown(entry)}; it must have names and values")
            values = [_values(key, value) for key, value in entry.items()]
            for combination in itertools.product(*values):
                point = dict(zip(entry, combination, strict=True))
                _check_point(name, point)
                yield point
        except ValueError as error:
            raise InputError(f"{name} {place}: {error}") from None


def _check_point(name: str, point: Mapping[str, Any]) -> None:
    """Refuse values of a tool, a motion or a medium that cannot be used."""
    if name == "motions":
        if list(point) != ["states_file"] or not isinstance(point["states_file"], str):
            motion_of(point)
        return
    _check_names(point, _TOOL_NAMES if name == "tools" else _MEDIUM_NAMES)
    config_of_options(point)
    if name == "tools":
        locate_mesh(point.get("mesh", ""))


def _values(key: str, value: object) -> list[Any]:
    if isinstance(value, Mapping):
        try:
            count = whole_number("count", value["count"], most=_MAX_COUNT)
            first = number("from", value["from"])
            last = number("to", value["to"])
            return list(np.linspace(first, last, count).tolist())
        except (KeyError, TypeError, ValueError):
            needed = f"a range has from, to and count, of 1 to {_MAX_COUNT:,}"
            raise InputError(f"{key} is {shown(dict(value))}; {needed}") from None
    if not isinstance(value, list) or (
        key in _VECTORS and not any(isinstance(v, list) for v in value)
    ):
        return [value]
    if not value:
        raise InputError(f"{key} is an empty list; give at least one value")
    return value
