"""The calibrated parameter file: the input file with the fitted values, and a record of their sources."""

import os
from collections.abc import Iterable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from rft_ros.calibration.calibrate import Calibration
from rft_ros.calibration.penetration import BEDS_DIFFER
from rft_ros.calibration.track import Track
from rft_ros.files import resolved, whole
from rft_ros.parameters import FILES, defaults, parameter_tree
from rft_ros.parameters.file import flat, node_keys, path_beside

__all__ = ["SECTION", "alpha_y_table", "rounded", "write_calibrated"]

SECTION = "rft_calibration"
"""Top-level key of the record, which the node ignores."""


class _Dumper(yaml.SafeDumper):
    """Lists of numbers on one line, all else in blocks."""

    def represent_sequence(self, tag: str, sequence: Any, flow_style: bool | None = None) -> yaml.SequenceNode:  # noqa: ARG002
        return super().represent_sequence(tag, sequence, all(isinstance(v, int | float) for v in sequence))


def rounded(value: float, error: float) -> float:
    """Round to a hundredth of the standard error: further digits are noise and differ between machines."""
    places = 2 - int(np.floor(np.log10(error))) if error > 0.0 else 12
    return round(value, max(0, min(12, places)))


def alpha_y_table(file: Path) -> Path:
    """The α_y table beside a calibrated file."""
    return file.parent / f"{file.stem}.alpha_y.csv"


def write_calibrated(file: Path, source: Path, result: Calibration, tracks: Iterable[Track]) -> list[Path]:
    """Write the calibrated file, and an α_y table beside it if one is needed; return the paths written.

    The rest is that of the parameter file `source`, also for other nodes; comments and the nesting of names are lost.
    The same bags and parameters give the same bytes. Raises InputError if a file cannot be written.
    """
    tree = parameter_tree(source)
    tree.pop(SECTION, None)
    parameters: dict[str, Any] = {}
    for key in node_keys(tree):
        if isinstance(tree[key], dict):
            parameters = tree[key]["ros__parameters"] = dict(flat(tree[key]["ros__parameters"]))
            for name in parameters.keys() & set(FILES):
                # a path is relative to the source; the new one to the new file
                found = path_beside(resolved(source).parent, name, path := str(parameters[name]))
                parameters[name] = path if found == path else os.path.relpath(found, resolved(file).parent)

    numbers = {f.name: [rounded(v, e) for v, e in zip(f.values, f.errors, strict=True)] for f in result.fitted}
    parameters |= {n: v if len(v) > 1 else v[0] for n, v in numbers.items() if n in defaults()}
    for f in result.fitted:
        if f.name == "medium.zeta":  # of another bed of the same grains
            parameters["medium.zeta_error"] = float(f"{max(f.errors[0] / f.values[0], BEDS_DIFFER):.3g}")
    if "sensor.bias" in numbers:
        # it replaces the tare, which would refuse a bag that begins in the grains
        section = tree.get("rft_replay", {}).get("ros__parameters", {})
        section.pop("tare", None)
        if not section:
            tree.pop("rft_replay", None)
    bags = [f"{t.name} ({datetime.fromtimestamp(t.begin // 10**9, timezone.utc):%Y-%m-%dT%H:%M:%SZ})" for t in tracks]
    texts = {}
    if (alpha_y := result.alpha_y) is not None:
        parameters["alpha_y.model"] = alpha_y.model
        if alpha_y.rows:
            table = alpha_y_table(file)
            parameters["alpha_y.table"] = table.name
            head = f"# {alpha_y.value.name} over β from {', '.join(bags)}; constant beyond the first and last row\n"
            texts[table] = head + "beta,alpha_y\n" + "".join(f"{b:g},{alpha:.6g}\n" for b, alpha in alpha_y.rows)
    record = {
        "bags": bags,
        "fitted": {
            f.name.partition(" ")[0].replace(".", "_"): {
                "value": [*numbers[f.name]],  # another list, or YAML has an alias, which ROS cannot read
                "standard_error": [float(f"{e:.3g}") for e in f.errors],
                "unit": f.unit,
                "goodness": f.goodness,
                "source": f.source,
            }
            for f in result.fitted
        },
        "not_identifiable": [f"{name}: {why}" for name, why in result.not_identifiable.items()],
    }
    # ROS cannot read empty lists
    tree[SECTION] = {"ros__parameters": {name: value for name, value in record.items() if value}}
    head = f"# {source.name} calibrated by rft calibrate; bags, sources and standard errors: {SECTION} below.\n"
    texts[file] = head + yaml.dump(tree, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
    for place, text in texts.items():  # a table before the file that names it
        with whole(place, "calibrated file") as part:
            part.write_text(text, encoding="utf-8", errors="backslashreplace")  # the source's name may not be UTF-8
    return list(reversed(texts))
