"""Which modelling choice buys accuracy against simulated grains, and which only costs time."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import Integration
from rft_ros.studies.chart_points import median_seconds
from rft_ros.studies.dem_runs import CALIBRATION, RUNS, DemRun, fitted_zeta, median_error, read_run
from rft_ros.studies.paper import law
from rft_ros.tool import Tool, load_tool

__all__ = ["CHOICES", "GROUPS", "PACKINGS", "Choice", "Judged", "judged_choices", "wall_seconds"]

Array = NDArray[np.float64]

ALONG = "plate_b90_psi90_phi0"

GROUPS: dict[str, Callable[[str], bool]] = {
    "plates (5 runs)": lambda name: name.startswith("plate") and name != ALONG,
    "plate moving along itself": lambda name: name == ALONG,
    "ellipsoid (straight, pitching)": lambda name: name.startswith("ellipsoid"),
    "root tip (straight, helix)": lambda name: name.startswith("root"),
}
"""Runs whose errors are averaged, by name; the penetration that ζ is fitted to is in none."""

PACKINGS = (0.10, 0.15)
"""How far two packings of the same simulated grains lie apart (the data's README): nothing can be told below."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """One way to model: rule, α_y model, tolerance of the reduced tool (0: full), mobilization length [m] (0: none)."""

    name: str
    integration: Integration = "centroid"
    alpha_y: str = "constant"
    tolerance: float = 0.0
    mobilization_length: float = 0.0


CHOICES = (
    Choice(name="published"),
    Choice(name="published, α_y linear", alpha_y="linear"),
    Choice(name="published, reduced to 5 %", tolerance=0.05),
    Choice(name="refined", integration="refined"),
    Choice(name="refined, α_y linear", integration="refined", alpha_y="linear"),
    Choice(name="refined, reduced to 5 %", integration="refined", tolerance=0.05),
    Choice(name="refined, memory 3 mm", integration="refined", mobilization_length=0.003),
    Choice(name="refined, α_y linear, memory 3 mm", integration="refined", alpha_y="linear", mobilization_length=0.003),
)
"""The choices that are judged."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Judged:
    """A choice in one run: error of the force, `time` of an evaluation [s], `states` of the run, ζ as fitted for it."""

    run: str
    choice: Choice
    plates: int
    error: float
    time: float
    states: int
    zeta: float


def judged_choices(data: Path) -> list[Judged]:
    """Every choice in every run of the reference data in the folder `data`; ζ is fitted for each choice."""
    runs = [read_run(data, name) for name in RUNS]
    cases: list[tuple[Choice, DemRun, float]] = []
    for choice in CHOICES:
        own = [replace(run, tool=_tool(run, choice)) for run in runs]
        calibration = next(run for run in own if run.name == CALIBRATION)
        zeta = fitted_zeta(calibration, law(choice.alpha_y, zeta=1.0))
        cases += [(choice, run, zeta) for run in own]
    calls = [
        partial(
            run.predicted,
            law(choice.alpha_y, zeta=zeta),
            mobilization_length=choice.mobilization_length,
            threads=1,
        )
        for choice, run, zeta in cases
    ]
    return [
        Judged(
            run=run.name,
            choice=choice,
            plates=len(run.tool.plates),
            error=median_error(run.forces, call()),
            time=seconds / len(run.states),
            states=len(run.states),
            zeta=zeta,
        )
        for (choice, run, zeta), call, seconds in zip(cases, calls, median_seconds(calls), strict=True)
    ]


def _tool(run: DemRun, choice: Choice) -> Tool:
    return load_tool(run.tool.file, scale=1.0, integration=choice.integration, tolerance=choice.tolerance)


_ROW = re.compile(r"^\|(?P<names>[^|]*`[^|]*)\|[^|]*\|(?P<times>[^|]*\d) s \|\s*$", re.MULTILINE)


def wall_seconds(data: Path) -> dict[str, tuple[float, float]]:
    """What the simulation of each run took, least and most, as far as the data's README says so [s]."""
    readme = data / "dem" / "README.md"
    text = readme.read_text(encoding="utf-8") if readme.is_file() else ""
    found: dict[str, tuple[float, float]] = {}
    for row in _ROW.finditer(text):
        names = re.findall(r"`([^`]+)`", row["names"])
        spans = [[float(t) for t in re.findall(r"\d+", part)] for part in row["times"].split(",")]
        for name, span in zip(names, spans if len(spans) == len(names) else spans[:1] * len(names), strict=True):
            # of a family, capitals stand for angles: plate_bB_psiP_phiF
            like = re.sub(r"(?<=[a-z])[A-Z](?=_|$)", r"\\d+", name)
            found |= {run: (min(span), max(span)) for run in RUNS if run == name or re.fullmatch(like, run)}
    return found
