"""The calibrated parameter file: the input file with what was fitted put in, and where it came from."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import yaml

from rft_ros.calibration.findings import Finding
from rft_ros.calibration.outcome import Calibration
from rft_ros.calibration.track import Track
from rft_ros.errors import InputError, reason_of
from rft_ros.estimator.parameters import NODE_KEYS, Value, parameter_tree

__all__ = ["SECTION", "rounded", "write_calibrated"]

SECTION = "rft_calibration"
"""Top-level key of what the node passes over: bags, dates, values with standard errors, refusals, notes."""

_Row = tuple[float, float]


class _Dumper(yaml.SafeDumper):
    """Lists of numbers on one line, all else in blocks, no aliases."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 (the base class calls it with it)
        return True


def _list(dumper: yaml.SafeDumper, data: Sequence[Any]) -> yaml.Node:
    plain = all(isinstance(v, int | float) for v in data)
    return dumper.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=plain)


def _float(dumper: yaml.SafeDumper, data: float) -> yaml.Node:
    text = repr(data)
    if "e" in text and "." not in text:  # 1e-05 is a string to PyYAML, not to ROS; 1.0e-05 is a number to both
        text = text.replace("e", ".0e")
    return dumper.represent_scalar("tag:yaml.org,2002:float", text)


_Dumper.add_representer(list, _list)
_Dumper.add_representer(tuple, _list)
_Dumper.add_representer(float, _float)


def rounded(value: float, error: float) -> float:
    """The value to a hundredth of its standard error: what is beyond that is noise, and would differ by machine."""
    return float(f"{value:.{max(0, min(12, _digits(error)))}f}")


def _digits(error: float) -> int:
    """Decimal places down to a hundredth of the error."""
    return 12 if not error > 0.0 else 2 - int(f"{error:e}".partition("e")[2])


@dataclass(frozen=True, slots=True, kw_only=True)
class _Target:
    """The parameters of one node in a tree, nested or with dots."""

    parameters: dict[str, Any]

    def put(self, name: str, value: Any) -> None:
        """Set a parameter where the file has it, else with dots."""
        group, _, rest = name.partition(".")
        nested = self.parameters.get(group)
        if name not in self.parameters and rest and isinstance(nested, dict):
            _Target(parameters=nested).put(rest, value)
        else:
            self.parameters[name] = value


def _put(tree: dict[str, Any], name: str, value: Value) -> None:
    """Set a parameter for the node `rft`, in the section that has the last word."""
    sections = [tree[key]["ros__parameters"] for key in NODE_KEYS if isinstance(tree.get(key), dict)]
    _Target(parameters=sections[-1]).put(name, list(value) if isinstance(value, tuple) else value)


def _recorded(finding: Finding) -> dict[str, Any]:
    pairs = list(zip(finding.values, finding.errors, strict=True))
    return {
        "value": [rounded(v, e) for v, e in pairs],
        "standard_error": [float(f"{e:.3g}") for e in finding.errors],
        "unit": finding.unit,
        "goodness": finding.goodness,
        "source": finding.source,
    }


def _date(stamp: int) -> str:
    """UTC of a header stamp [ns], to the second."""
    return datetime.fromtimestamp(stamp // 1_000_000_000, timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")


def write_calibrated(file: Path, source: Path, result: Calibration, tracks: Iterable[Track]) -> list[Path]:
    """Write the calibrated file, and an α_y table beside it if there is one; returns what was written.

    `source`: the parameter file that all other values come from; other nodes' sections and `rft_replay` are kept, its
    comments are not. The same bags and parameters give the same bytes. InputError where it cannot be written.
    """
    tree = parameter_tree(source)
    tree.pop(SECTION, None)
    written = [file]
    for finding in result.findings:
        if finding.parameter:
            values = tuple(rounded(v, e) for v, e in zip(finding.values, finding.errors, strict=True))
            _put(tree, finding.parameter, values if len(values) > 1 else values[0])
    begins = {track.name: _date(track.begin) for track in tracks}
    if result.alpha_y:
        table = file.with_name(f"{file.stem}.alpha_y.csv")
        _put(tree, "alpha_y.model", "table")
        _put(tree, "alpha_y.table", str(table.resolve()))
        written.append(table)
    record = {
        "bags": [f"{name} ({date})" for name, date in begins.items()],
        "fitted": {_key(f.name): _recorded(f) for f in result.findings},
        "refused": [f"{r.name}: {r.why}" for r in result.refusals],
        "notes": list(result.notes),
    }
    # ROS has no type for an empty list
    tree[SECTION] = {"ros__parameters": {name: value for name, value in record.items() if value}}
    head = [
        f"# {source.name} calibrated by rft calibrate; what came from where, with standard errors: {SECTION} below.",
        *(f"# From {name}, recorded {date}." for name, date in begins.items()),
    ]
    body = yaml.dump(tree, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=110)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("\n".join(head) + "\n" + body, encoding="utf-8")
        if result.alpha_y:
            written[1].write_text(_table(result.alpha_y.rows, result.alpha_y.model, begins), encoding="utf-8")
    except OSError as error:
        raise InputError(f"calibrated file '{file}' cannot be written: {reason_of(error)}") from None
    return written


def _key(name: str) -> str:
    """A finding's name without dots and words in brackets, which are no parameter names to ROS."""
    return name.partition(" ")[0].replace(".", "_")


def _table(rows: Sequence[_Row], model: str, begins: Iterable[str]) -> str:
    head = f"# α_y ({model} in β) from {', '.join(begins)}; held beyond the first and the last row\nbeta,alpha_y\n"
    return head + "".join(f"{beta:g},{alpha:.6g}\n" for beta, alpha in rows)
