"""The calibrated parameter file: the input file with the fitted values, and a record of their sources."""

import os
from collections.abc import Iterable, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rft_ros.calibration.calibrate import Calibration
from rft_ros.calibration.fitting import FittedValue
from rft_ros.calibration.track import Track
from rft_ros.files import whole
from rft_ros.parameters import FILES, defaults, node_keys, parameter_tree, path_beside

__all__ = ["SECTION", "rounded", "write_calibrated"]

SECTION = "rft_calibration"
"""Top-level key of the record, which the node ignores."""


class _Dumper(yaml.SafeDumper):
    """Lists of numbers on one line, all else in blocks, no aliases (ROS cannot read them)."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 (signature of the base class)
        return True


def _list(dumper: yaml.SafeDumper, data: Sequence[Any]) -> yaml.Node:
    plain = all(isinstance(v, int | float) for v in data)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=plain)


_Dumper.add_representer(list, _list)
_Dumper.add_representer(tuple, _list)


def rounded(value: float, error: float) -> float:
    """Round to a hundredth of the standard error: further digits are noise and differ between machines."""
    places = 2 - int(np.floor(np.log10(error))) if error > 0.0 else 12
    return round(value, max(0, min(12, places)))


def alpha_y_table(file: Path) -> Path:
    """The α_y table beside a calibrated file."""
    return file.with_name(f"{file.stem}.alpha_y.csv")


def write_calibrated(file: Path, source: Path, result: Calibration, tracks: Iterable[Track]) -> list[Path]:
    """Write the calibrated file, and an α_y table beside it if one is needed; return the paths written.

    `source`: the parameter file with all other values. Other nodes' sections and `rft_replay` are kept, except a tare
    if the bias was fitted; comments are lost. The same bags and parameters give the same bytes. Raises InputError if a
    file cannot be written.
    """
    tree = parameter_tree(source)
    tree.pop(SECTION, None)
    sections = [tree[key]["ros__parameters"] for key in node_keys(tree) if isinstance(tree[key], dict)]
    for section in sections:
        _follow(section, source, file)
    parameters = sections[-1]
    for f in result.fitted:
        if f.name in defaults():
            values = tuple(rounded(v, e) for v, e in zip(f.values, f.errors, strict=True))
            _put(parameters, f.name, values if len(values) > 1 else values[0])
    if result.zeta is not None:
        _put(parameters, "medium.zeta_error", float(f"{result.zeta.relative_error():.3g}"))
    if any(f.name == "sensor.bias" for f in result.fitted):
        _drop_tare(tree)
    begins = [(track.name, _date(track.begin)) for track in tracks]
    texts = {file: ""}
    if result.alpha_y is not None and result.alpha_y.published:
        _put(parameters, "alpha_y.model", result.alpha_y.model)
    elif result.alpha_y is not None:
        table = alpha_y_table(file)
        _put(parameters, "alpha_y.model", "table")
        _put(parameters, "alpha_y.table", table.name)
        bags = ", ".join(name for name, _ in begins)
        head = f"# α_y ({result.alpha_y.model} in β) from {bags}; constant beyond the first and last row\n"
        texts[table] = head + "beta,alpha_y\n" + "".join(f"{b:g},{alpha:.6g}\n" for b, alpha in result.alpha_y.rows)
    record = {
        "bags": [f"{name} ({date})" for name, date in begins],
        "fitted": {f.name.partition(" ")[0].replace(".", "_"): _recorded(f) for f in result.fitted},
        "not_identifiable": [f"{name}: {why}" for name, why in result.not_identifiable.items()],
        "notes": list(result.notes),
    }
    # ROS cannot read empty lists
    tree[SECTION] = {"ros__parameters": {name: value for name, value in record.items() if value}}
    head = f"# {source.name} calibrated by rft calibrate; sources and standard errors: {SECTION} below.\n"
    head += "".join(f"# From {name}, recorded {date}.\n" for name, date in begins)
    texts[file] = head + yaml.dump(tree, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
    for path, text in reversed(texts.items()):  # a table before the file that names it
        with whole(path, "calibrated file") as part:
            part.write_text(text, encoding="utf-8", errors="backslashreplace")  # the source's name may not be UTF-8
    return list(texts)


def _put(parameters: dict[str, Any], name: str, value: Any) -> None:
    """Set a parameter, nested or with dots as in the file; a new one goes into its group if there is one."""
    group, _, rest = name.partition(".")
    nested = parameters.get(group)
    if name not in parameters and rest and isinstance(nested, dict):
        _put(nested, rest, value)
    else:
        parameters[name] = value


def _drop_tare(tree: dict[str, Any]) -> None:
    """Remove the tare: the fitted bias replaces it, and it would refuse a bag that begins in the grains."""
    section = tree.get("rft_replay", {}).get("ros__parameters", {})
    section.pop("tare", None)
    if not section:
        tree.pop("rft_replay", None)


def _follow(parameters: dict[str, Any], source: Path, file: Path) -> None:
    """Keep relative paths valid: they are relative to the source, the new ones to the new file."""
    for name in FILES:
        group, _, rest = name.partition(".")
        nested = parameters.get(group)
        path = str(parameters.get(name, nested.get(rest, "") if isinstance(nested, dict) else ""))
        found = path_beside(source.resolve().parent, name, path)
        if found != path:
            _put(parameters, name, os.path.relpath(found, file.resolve().parent))


def _recorded(f: FittedValue) -> dict[str, Any]:
    return {
        "value": [rounded(v, e) for v, e in zip(f.values, f.errors, strict=True)],
        "standard_error": [float(f"{e:.3g}") for e in f.errors],
        "unit": f.unit,
        "goodness": f.goodness,
        "source": f.source,
    }


def _date(stamp: int) -> str:
    """UTC of a header stamp [ns], to the second."""
    return datetime.fromtimestamp(stamp // 1_000_000_000, timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
