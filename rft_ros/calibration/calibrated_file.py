"""The calibrated parameter file: the input file with the fitted values, and a record of their sources."""

from collections.abc import Iterable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np

from rft_ros.calibration.fitting import FitResults, FittedValue, MotionFit
from rft_ros.calibration.track import Track
from rft_ros.parameters import NODE
from rft_ros.parameters.file import tree_for
from rft_ros.rft.motion_kinds import MOTIONS
from rft_ros.yaml_file import write_yaml

SECTION = "rft_calibration"
"""Top-level key of the record, which the node ignores."""

_BED_SPREAD_RATIO = 0.1
"""Standard deviation of ζ between beds of the same grains, relative to ζ (docs/accuracy.md)."""


def rounded(value: float, error: float) -> float:
    """Round to a hundredth of the standard error: further digits are noise and differ between machines."""
    places = 2 - int(np.floor(np.log10(error))) if error > 0.0 else 12
    return round(value, max(0, min(12, places)))


def write_calibrated(
    file: Path, source: Path, result: FitResults, tracks: Iterable[Track], *, node: str = NODE
) -> None:
    """Write the calibrated file.

    The rest is that of the parameter file `source`, also for nodes other than `node`; comments and the
    nesting of names are lost. The same bags and parameters give the same bytes. Raises InputError if a file cannot be
    written.
    """
    tree, parameters = tree_for(source, file, node)

    for fit in result.fitted_values:
        numbers = _rounded_values(fit)
        parameters[fit.name] = numbers if len(numbers) > 1 else numbers[0]
        if fit.name == "medium.zeta":
            # of another bed of the same grains, and of each tool that was recorded
            relative = max(fit.errors[0] / fit.values[0], _BED_SPREAD_RATIO, fit.spread)
            parameters["medium.zeta_error"] = _short(relative)
        if fit.name == "sensor.bias":
            _remove_tare(tree)
    kinds = [motion.kind for motion in result.motions if motion.kind in MOTIONS]
    if kinds:
        parameters["medium.calibrated_motions"] = ", ".join(kinds)
    tree[SECTION] = {"ros__parameters": _record(result, tracks)}
    comment = f"{source.name} calibrated by rft calibrate; bags, sources and standard errors: {SECTION} below."
    write_yaml(file, "calibrated file", tree, [comment])


def _rounded_values(fit: FittedValue) -> list[float]:
    """The values of a fit, rounded by their errors."""
    errors = fit.errors
    if fit.name == "sensor.bias":
        # if the poses do not separate bias and weight, their sum is known better than each of them
        errors = tuple(min(error, 1e-3) for error in errors)
    return [rounded(value, error) for value, error in zip(fit.values, errors, strict=True)]


def _remove_tare(tree: dict[str, dict[str, dict[str, Any]]]) -> None:
    """Remove the tare of replays: a fitted bias replaces it, and it would refuse a bag that begins in the grains."""
    replay_parameters = tree.get("rft_replay", {}).get("ros__parameters", {})
    replay_parameters.pop("tare", None)
    if not replay_parameters:
        tree.pop("rft_replay", None)


def _record(result: FitResults, tracks: Iterable[Track]) -> dict[str, Any]:
    """What was fitted to which bags. ROS cannot read empty lists, so these are left out."""
    names = [f"{track.name} ({_date(track)})" for track in tracks]
    fits = {fit.name.replace(".", "_"): _entry(fit) for fit in result.fitted_values}
    reasons = [f"{name}: {why}" for name, why in result.not_identifiable.items()]
    motions = {motion.kind: _motion(motion) for motion in result.motions}
    record = {
        "bags": names,
        "fitted": fits,
        "not_identifiable": reasons,
        "motions": motions,
        "warnings": result.warnings,
    }
    return {name: entries for name, entries in record.items() if entries}


def _motion(motion: MotionFit) -> dict[str, float]:
    """The ζ that a kind of motion alone would have, and the error with the written one [N]."""
    return {
        "zeta": rounded(motion.zeta, motion.error),
        "standard_error": _short(motion.error),
        "rms": _short(motion.rms),
        "peak": _short(motion.peak),
    }


def _short(number: float) -> float:
    return float(f"{number:.3g}")


def _date(track: Track) -> str:
    return f"{datetime.fromtimestamp(track.begin // 10**9, timezone.utc):%Y-%m-%dT%H:%M:%SZ}"


def _entry(fit: FittedValue) -> dict[str, Any]:
    return {
        "value": _rounded_values(fit),
        "standard_error": [_short(error) for error in fit.errors],
        "unit": fit.unit,
        "goodness": fit.goodness,
        "source": fit.source,
    }
