"""A design study read from YAML: its variants, in a fixed order."""

import itertools
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from rft_ros.errors import InputError
from rft_ros.files import read_file, read_yaml
from rft_ros.installation import release
from rft_ros.parameters import TOOL_PARAMETERS, Value, Values, checked, defaults
from rft_ros.sweeps.motions import FAMILIES, Motion
from rft_ros.tool import locate_mesh

__all__ = ["Design", "Variant", "motion_of", "parameters_of", "read_design"]

_TOOL = {("mesh" if field == "file" else field): name for field, name in TOOL_PARAMETERS.items()}
_OF_MEDIUM = ("zeta", "surface_friction", "density", "inertia", "mobilization_length")
_MEDIUM = {"law": "law", "medium": "medium.name", "alpha_y": "alpha_y.model", "surface_height": "surface_height"}
_MEDIUM |= {name: f"medium.{name}" for name in _OF_MEDIUM}
_MOST = 1_000_000  # values in a range, and samples

Variant = dict[str, dict[str, Any]]
"""One point of a design: `tool`, `motion` and `medium`, each a dict of plain values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """Lists of tools, motions and media. Every combination is a variant; `picked`: their numbers, all or a sample."""

    file: Path
    tools: Sequence[dict[str, Any]]
    motions: Sequence[dict[str, Any]]
    media: Sequence[dict[str, Any]]
    picked: Sequence[int]

    def __len__(self) -> int:
        return len(self.picked)

    def files(self) -> list[Path]:
        """Its meshes and states files."""
        states = (Path(entry["states_file"]) for entry in self.motions if "states_file" in entry)
        return [*(locate_mesh(entry["mesh"]) for entry in self.tools), *states]

    def fingerprint(self) -> int:
        """Checksum of the study, its meshes and states files, and the version of rft_ros."""
        checksum = zlib.crc32(release().encode())
        for file in dict.fromkeys((self.file, *self.files())):
            try:
                checksum = zlib.crc32(read_file(file, "file"), checksum)
            except InputError:  # its variants' rows will say so
                checksum = zlib.crc32(b"missing", checksum)
        return checksum

    def variant(self, index: int) -> Variant:
        """Variant number `index`, from 0."""
        k, medium = divmod(self.picked[index], len(self.media))
        tool, motion = divmod(k, len(self.motions))
        return {"tool": self.tools[tool], "motion": self.motions[motion], "medium": self.media[medium]}


def parameters_of(*, tool: Mapping[str, Any] | None = None, medium: Mapping[str, Any] | None = None) -> Values:
    """The node's parameters for a variant's tool and medium. Raises InputError for a name or a value."""
    values: dict[str, Value] = {**defaults(), "tolerance": 0.0}
    for entry, names in ((tool or {}, _TOOL), (medium or {}, _MEDIUM)):
        for key, value in entry.items():
            name = _known(key, names)
            values[name] = checked(name, value)
    return values


def motion_of(entry: Mapping[str, Any]) -> tuple[Motion, int]:
    """The motion of a variant without a states file, and how often it is sampled. Raises InputError."""
    family = entry.get("family")
    if not isinstance(family, str) or family not in FAMILIES:
        raise InputError(f"family is {family!r}; it must be one of {', '.join(FAMILIES)}, or a states_file")
    known = {name: name for name in ("family", "samples", *(field.name for field in fields(FAMILIES[family])))}
    numbers = {_known(key, known): value for key, value in entry.items() if key != "family"}
    samples = numbers.pop("samples", 200)
    if not isinstance(samples, int | float) or not 2 <= samples <= _MOST:
        raise InputError(f"samples is {samples!r}; it must be from 2 to {_MOST:,}")
    return FAMILIES[family](**numbers), int(samples)


def _known(key: str, names: Mapping[str, str]) -> str:
    if key not in names:
        raise InputError(f"there is no '{key}'; use {', '.join(names)}")
    return names[key]


def read_design(file: Path) -> Design:
    """Read a study. Raises InputError, which names file, entry and value."""
    content = read_yaml(file, "study")
    if not isinstance(content, Mapping):
        raise InputError(f"study '{file}' has no entries; it needs tools, motions and media")
    known = ("media", "motions", "sample", "seed", "tools")
    for name in content:
        if name not in known:
            raise InputError(f"study '{file}': '{name}' is not an entry of a study; use {', '.join(known)}")
    tools, motions, media = (tuple(_expanded(file, name, content.get(name))) for name in ("tools", "motions", "media"))
    total = len(tools) * len(motions) * len(media)
    sample, seed = content.get("sample", total), content.get("seed", 0)
    for name, value, low, high in (("sample", sample, 1, total), ("seed", seed, 0, 2**63)):
        if type(value) is not int or not low <= value <= high:
            raise InputError(f"study '{file}': {name} is {value!r}; it must be a whole number from {low} to {high:,}")
    picked = sorted(map(int, np.random.default_rng(seed).permutation(total)[:sample]))
    return Design(file=file, tools=tools, motions=motions, media=media, picked=picked)


def _expanded(file: Path, name: str, entries: object) -> Iterator[dict[str, Any]]:
    """One dict for each combination of the values in an entry's lists and ranges."""
    if not isinstance(entries, list) or not entries:
        raise InputError(f"study '{file}': {name} is {entries!r}; it must be a list of entries")
    for number, entry in enumerate(entries, start=1):
        try:
            if not isinstance(entry, Mapping) or (name == "tools" and "mesh" not in entry):
                raise InputError(f"it is {entry!r}; it must have names and values{', mesh' * (name == 'tools')}")
            for combination in itertools.product(*(_values(key, value) for key, value in entry.items())):
                point = dict(zip(entry, combination, strict=True))
                if name != "motions":
                    parameters_of(**{"tool" if name == "tools" else "medium": point})
                elif list(point) != ["states_file"] or not isinstance(point["states_file"], str):
                    motion_of(point)
                yield point
        except InputError as error:
            raise InputError(f"study '{file}' {name} {number}: {error}") from None


def _values(key: str, value: object) -> list[Any]:
    if isinstance(value, Mapping):
        try:
            low, high, count = float(value["from"]), float(value["to"]), int(value["count"])
        except (KeyError, TypeError, ValueError, OverflowError):
            raise InputError(f"{key} is {dict(value)!r}; a range has from, to and count") from None
        if not (np.isfinite([low, high]).all() and 0 < count <= _MOST):
            raise InputError(f"{key} is {dict(value)!r}; from and to must be finite, count from 1 to {_MOST:,}")
        return list(np.linspace(low, high, count).tolist())
    if not isinstance(value, list) or (key == "origin" and not any(isinstance(v, list) for v in value)):
        return [value]
    if not value:
        raise InputError(f"{key} is an empty list")
    return value
