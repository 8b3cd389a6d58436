"""The calibrated parameter file: the input file with the fitted values, and a record of their sources."""

import os
from collections.abc import Iterable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from rft_ros.calibration.calibrate import Calibration
from rft_ros.calibration.fitting import FittedValue
from rft_ros.calibration.track import Track
from rft_ros.errors import InputError
from rft_ros.files import resolved, whole
from rft_ros.parameters import FILES, defaults, read_sections, sections_for
from rft_ros.parameters.file import path_beside
from rft_ros.parameters.sections import parameter_file_text

__all__ = ["SECTION", "alpha_y_table", "rounded", "write_calibrated"]

SECTION = "rft_calibration"
"""Top-level key of the record, which the node ignores."""

_BEDS_DIFFER = 0.1  # relative standard deviation of ζ between beds of the same grains (docs/accuracy.md)


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
    sections = [section for section in read_sections(source) if section.key != SECTION]
    for section in sections:
        if section.fault:
            raise InputError(f"parameter file '{source}': {section.fault}")
    tree: dict[str, dict[str, dict[str, Any]]] = {s.key: {"ros__parameters": {**s.parameters}} for s in sections}
    parameters: dict[str, Any] = {}
    for section in sections_for(sections):
        parameters = tree[section.key]["ros__parameters"]  # at last those that override the others
        _relocate_paths(parameters, source=source, file=file)

    numbers = {f.name: _rounded_values(f) for f in result.fitted}
    for f in result.fitted:
        if f.name in defaults():
            parameters[f.name] = numbers[f.name] if len(f.values) > 1 else numbers[f.name][0]
        if f.name == "medium.zeta":  # of another bed of the same grains, and of each tool that was recorded
            parameters["medium.zeta_error"] = float(f"{max(f.errors[0] / f.values[0], _BEDS_DIFFER, f.spread):.3g}")
    if "sensor.bias" in numbers:
        _remove_tare(tree)
    bags = [f"{t.name} ({datetime.fromtimestamp(t.begin // 10**9, timezone.utc):%Y-%m-%dT%H:%M:%SZ})" for t in tracks]
    texts = {}
    if result.alpha_y is not None:
        parameters["alpha_y.model"] = result.alpha_y.model
        if result.alpha_y.rows:
            table = alpha_y_table(file)
            parameters["alpha_y.table"] = table.name
            head = (
                f"# {result.alpha_y.value.name} over β from {', '.join(bags)}; constant beyond the first and last row\n"
            )
            rows = "".join(f"{beta:g},{alpha:.6g}\n" for beta, alpha in result.alpha_y.rows)
            texts[table] = f"{head}beta,alpha_y\n{rows}"
    tree[SECTION] = {"ros__parameters": _record(result, numbers, bags)}
    head = f"# {source.name} calibrated by rft calibrate; bags, sources and standard errors: {SECTION} below.\n"
    texts[file] = head + parameter_file_text(tree)
    for place, text in texts.items():  # a table before the file that names it
        with whole(place, "calibrated file") as part:
            part.write_text(text, encoding="utf-8", errors="backslashreplace")  # the source's name may not be UTF-8
    return list(reversed(texts))


def _relocate_paths(parameters: dict[str, Any], *, source: Path, file: Path) -> None:
    """Make the relative paths of a parameter file `source`, which begin at its folder, begin at that of `file`."""
    for name in parameters.keys() & set(FILES):
        given = str(parameters[name])
        found = path_beside(resolved(source).parent, name, given)
        if found != given:
            parameters[name] = os.path.relpath(found, resolved(file).parent)


def _rounded_values(fitted: FittedValue) -> list[float]:
    """The values of a fit, rounded by their errors."""
    errors = fitted.errors
    if fitted.name == "sensor.bias":
        # if the poses do not separate bias and weight, their sum is known better than each of them
        errors = tuple(min(error, 1e-3) for error in errors)
    return [rounded(value, error) for value, error in zip(fitted.values, errors, strict=True)]


def _remove_tare(tree: dict[str, dict[str, dict[str, Any]]]) -> None:
    """Remove the tare of replays: a fitted bias replaces it, and it would refuse a bag that begins in the grains."""
    of_replay = tree.get("rft_replay", {}).get("ros__parameters", {})
    of_replay.pop("tare", None)
    if not of_replay:
        tree.pop("rft_replay", None)


def _record(result: Calibration, numbers: dict[str, list[float]], bags: list[str]) -> dict[str, Any]:
    """What was fitted to which bags. ROS cannot read empty lists, so these are left out."""
    fitted = {
        f.name.partition(" ")[0].replace(".", "_"): {
            "value": numbers[f.name],
            "standard_error": [float(f"{e:.3g}") for e in f.errors],
            "unit": f.unit,
            "goodness": f.goodness,
            "source": f.source,
        }
        for f in result.fitted
    }
    not_identifiable = [f"{name}: {why}" for name, why in result.not_identifiable.items()]
    record = {"bags": bags, "fitted": fitted, "not_identifiable": not_identifiable, "warnings": result.warnings}
    return {name: value for name, value in record.items() if value}
