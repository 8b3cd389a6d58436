"""A design study read from YAML: its variants, in a fixed order."""

import itertools
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from rft_ros.errors import InputError
from rft_ros.files import read_file, read_yaml
from rft_ros.installation import release
from rft_ros.rft import ALPHA_Y_MODELS, INTEGRATIONS, LAWS, MEDIA
from rft_ros.sweeps.motions import FAMILIES
from rft_ros.tool import locate_mesh

__all__ = ["Design", "Variant", "read_design"]

# By name: the values that are allowed, or their kind; origin is a list of three numbers.
_Kinds = Mapping[str, tuple[str, ...] | type]
_TOOL: _Kinds = {"mesh": str, "scale": float, "origin": list, "integration": INTEGRATIONS, "tolerance": float}
_ALPHA_Y = tuple(name for name in ALPHA_Y_MODELS if name != "table")  # a study cannot name a table's file
_NUMBERS = ("zeta", "surface_friction", "density", "inertia", "mobilization_length", "surface_height")
_MEDIUM: _Kinds = {"law": LAWS, "medium": tuple(MEDIA), "alpha_y": _ALPHA_Y, **dict.fromkeys(_NUMBERS, float)}

_MOST = 1_000_000  # values in a range

Variant = dict[str, Any]
"""One point of a design: `tool`, `motion` and `medium`, each a dict of plain values."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """Lists of tools, motions and media. Every combination is a variant.

    `picked`: numbers of the combinations in a random sample; None: all. `fingerprint`: checksum of the study, its
    meshes and states files, and the version of rft_ros.
    """

    file: Path
    tools: tuple[dict[str, Any], ...]
    motions: tuple[dict[str, Any], ...]
    media: tuple[dict[str, Any], ...]
    picked: tuple[int, ...] | None
    fingerprint: int

    def __len__(self) -> int:
        return len(self.picked) if self.picked is not None else len(self.tools) * len(self.motions) * len(self.media)

    def files(self) -> list[Path]:
        """Its meshes and states files."""
        states = (Path(entry["states_file"]) for entry in self.motions if "states_file" in entry)
        return [*(locate_mesh(entry["mesh"]) for entry in self.tools), *states]

    def variant(self, index: int) -> Variant:
        """Variant number `index`, from 0."""
        k = self.picked[index] if self.picked is not None else index
        k, medium = divmod(k, len(self.media))
        tool, motion = divmod(k, len(self.motions))
        return {"tool": self.tools[tool], "motion": self.motions[motion], "medium": self.media[medium]}


def read_design(file: Path) -> Design:
    """Read a study. Raises InputError, which names file, entry and value."""
    content = read_yaml(file, "study")
    if not isinstance(content, Mapping):
        raise InputError(f"study '{file}' has no entries; it needs tools, motions and media")
    known = {"tools", "motions", "media", "sample", "seed"}
    for name in content:
        if name not in known:
            raise InputError(f"study '{file}': '{name}' is not an entry of a study; use {', '.join(sorted(known))}")
    lists = {name: tuple(_expanded(file, name, content.get(name))) for name in ("tools", "motions", "media")}
    total = len(lists["tools"]) * len(lists["motions"]) * len(lists["media"])
    sample = content.get("sample")
    picked = None
    if sample is not None:
        if isinstance(sample, bool) or not isinstance(sample, int) or not 0 < sample <= total:
            raise InputError(f"study '{file}': sample is {sample!r}; it must be a whole number from 1 to {total}")
        seed = content.get("seed", 0)
        if isinstance(seed, bool) or not isinstance(seed, int) or seed < 0:
            raise InputError(f"study '{file}': seed is {seed!r}; it must be a whole number of at least 0")
        picked = tuple(sorted(np.random.default_rng(seed).choice(total, sample, replace=False).tolist()))
    return Design(file=file, picked=picked, fingerprint=_fingerprint(file, lists), **lists)


def _fingerprint(file: Path, lists: Mapping[str, Iterable[Mapping[str, Any]]]) -> int:
    checksum = zlib.crc32(release().encode(), zlib.crc32(read_file(file, "study")))
    files = {entry["mesh"]: locate_mesh for entry in lists["tools"]}
    files |= {entry["states_file"]: Path for entry in lists["motions"] if "states_file" in entry}
    for name, locate in files.items():
        try:
            checksum = zlib.crc32(read_file(locate(name), "file"), checksum)
        except InputError:
            checksum = zlib.crc32(b"missing", checksum)
    return checksum


def _expanded(file: Path, name: str, entries: object) -> Iterator[dict[str, Any]]:
    """One dict for each combination of the values in an entry's lists and ranges."""
    if not isinstance(entries, Sequence) or isinstance(entries, str) or not entries:
        raise InputError(f"study '{file}': {name} is {entries!r}; it must be a list of entries")
    for number, entry in enumerate(entries, start=1):
        where = f"study '{file}' {name} {number}"
        if not isinstance(entry, Mapping):
            raise InputError(f"{where} is {entry!r}; it must have names and values")
        values = [_values(f"{where}: {key}", key, value) for key, value in entry.items()]
        for combination in itertools.product(*values):
            point = dict(zip(entry, combination, strict=True))
            _check(where, name, point)
            yield point


def _kinds_of_motion(where: str, entry: Mapping[str, object]) -> _Kinds:
    family = entry.get("family")
    if "states_file" in entry:
        return {"states_file": str}
    if isinstance(family, str) and family in FAMILIES:
        return {"family": str, "samples": float, **{f.name: float for f in fields(FAMILIES[family])}}
    raise InputError(f"{where}: family is {family!r}; it must be one of {', '.join(FAMILIES)}, or a states_file")


def _check(where: str, name: str, entry: Mapping[str, object]) -> None:
    """Raise InputError for a name that an entry of this list does not have, or a value of another kind."""
    kinds = _kinds_of_motion(where, entry) if name == "motions" else _TOOL if name == "tools" else _MEDIUM
    if name == "tools" and "mesh" not in entry:
        raise InputError(f"{where} has no mesh")
    for key, value in entry.items():
        kind = kinds.get(key)
        if kind is None:
            raise InputError(f"{where} has no '{key}'; it has {', '.join(kinds)}")
        if isinstance(kind, tuple):
            fits, wanted = value in kind, f"one of {', '.join(kind)}"
        elif kind is str:
            fits, wanted = isinstance(value, str), "text"
        elif kind is list:
            fits, wanted = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value)), "three numbers"
        else:
            fits, wanted = _is_number(value), "a number"
        if not fits:
            raise InputError(f"{where}: {key} is {value!r}; it must be {wanted}")


def _values(where: str, key: str, value: object) -> list[Any]:
    if isinstance(value, Mapping):
        try:
            low, high, count = float(value["from"]), float(value["to"]), int(value["count"])
        except (KeyError, TypeError, ValueError, OverflowError):
            raise InputError(f"{where} is {dict(value)!r}; a range has from, to and count") from None
        if not (np.isfinite([low, high]).all() and 0 < count <= _MOST):
            raise InputError(f"{where} is {dict(value)!r}; from and to must be finite, count from 1 to {_MOST:,}")
        return [float(v) for v in np.linspace(low, high, count)]
    if isinstance(value, list):
        if key == "origin" and not any(isinstance(v, list) for v in value):
            return [value]
        if not value:
            raise InputError(f"{where} is an empty list")
        return value
    return [value]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
