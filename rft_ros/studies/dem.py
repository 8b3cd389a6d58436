"""Simulated grains: ζ from one vertical penetration, then every other run predicted."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rft_ros.studies.dem_runs import CALIBRATION, RUNS, DemRun, fitted_zeta, median_error, read_run, smoothed
from rft_ros.studies.figure import BLACK, BLUE, GREY, ORANGE, SKY, VERMILION, label_axes, new_figure
from rft_ros.studies.outcome import Outcome, TextTable
from rft_ros.studies.paper import ALPHA_Y, NOT_STATED, law

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["ALONG_ITSELF", "MOBILIZATION_LENGTH", "PUBLISHED_PLATES", "Accuracy", "accuracy", "study"]

Array = NDArray[np.float64]

PUBLISHED_PLATES = "1.2–18.8 %"
"""Median errors of the paper's own plates, over its combinations of β, φ and ψ."""

MOBILIZATION_LENGTH = 0.0029
"""λ [m] of the column with memory (α_y constant); `rft_ros.rft.mobilization`."""

ALONG_ITSELF = "plate_b90_psi90_phi0"
"""The plate neither of whose faces leads: what it lacks is no matter of memory, so it is left out of means."""

_MEMORY = "memory"
_COLUMNS = {**{model: f"α_y {model}" for model in ALPHA_Y}, _MEMORY: f"with memory, {1e3 * MOBILIZATION_LENGTH:g} mm"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Accuracy:
    """The runs; ζ fitted to the calibration run alone; median relative vector errors by run.

    `errors[run]`: by α_y model, and with "memory" (α_y constant).
    """

    runs: tuple[DemRun, ...]
    zeta: float
    errors: dict[str, dict[str, float]]

    def mean(self, column: str) -> float:
        """Mean over the ten runs, `ALONG_ITSELF` left out."""
        return float(np.mean([e[column] for name, e in self.errors.items() if name != ALONG_ITSELF]))


def accuracy(data: Path) -> Accuracy:
    """Calibrate on one run of the reference data, predict them all."""
    runs = tuple(read_run(data, name) for name in RUNS)
    # A flat plate straight down has no force along e1, so that α_y plays no part. Two digits: another packing of the
    # same grains gives 0.23 to 0.26.
    zeta = round(fitted_zeta(next(run for run in runs if run.name == CALIBRATION), law("constant", zeta=1.0)), 2)
    errors = {
        run.name: {
            **{model: median_error(run.forces, run.predicted(law(model, zeta=zeta))) for model in ALPHA_Y},
            _MEMORY: median_error(run.forces, _remembered(run, zeta)),
        }
        for run in runs
    }
    return Accuracy(runs=runs, zeta=zeta, errors=errors)


def _remembered(run: DemRun, zeta: float) -> Array:
    return run.predicted(law("constant", zeta=zeta), mobilization_length=MOBILIZATION_LENGTH)


def study(data: Path) -> Outcome:
    """The study on the reference data in the folder `data`."""
    found = accuracy(data)
    return Outcome(
        name="dem",
        title="Simulated grains: every run predicted from one penetration",
        figure=_draw(found),
        numbers={
            "dem": {
                "run": list(found.errors),
                "zeta": [found.zeta] * len(found.errors),
                **{f"median_error_{model}": [e[model] for e in found.errors.values()] for model in _COLUMNS},
            }
        },
        table=_table(found),
    )


def _table(found: Accuracy) -> TextTable:
    rows = []
    for name, errors in found.errors.items():
        calibration = name == CALIBRATION
        text = f"{RUNS[name]} (calibration: ζ = {found.zeta:.2f})" if calibration else RUNS[name]
        paper = "" if calibration else PUBLISHED_PLATES if name.startswith("plate") else NOT_STATED
        rows.append((text, *(f"{100.0 * errors[column]:.1f} %" for column in _COLUMNS), paper))
    means = (f"{100.0 * found.mean(column):.1f} %" for column in _COLUMNS)
    rows.append(("mean, without the plate that moves along itself", *means, NOT_STATED))
    return TextTable(header=("run", *_COLUMNS.values(), "the paper, in its beads"), rows=tuple(rows))


def _draw(found: Accuracy) -> "Figure":
    figure = new_figure(13.0, 9.0)
    panels = figure.subplots(3, 4).ravel()
    for axes, run in zip(panels, found.runs, strict=False):
        _draw_run(axes, run, found)
    panels[0].legend(fontsize=7)
    _draw_errors(panels[len(found.runs)], found)
    figure.suptitle(
        f"Force on the tool: simulated grains against 3D RFT with ζ = {found.zeta:.2f} from the first panel alone;"
        " median error of the force vector, without → with memory"
    )
    return figure


def _draw_run(axes: "Axes", run: DemRun, found: Accuracy) -> None:
    model, remembered = run.predicted(law("constant", zeta=found.zeta)), _remembered(run, found.zeta)
    measured = smoothed(run.forces)[4:-4]
    for column, name, colour in ((2, "up", BLUE), (0, "along x", VERMILION)):
        axes.plot(run.times[4:-4], measured[:, column], color=colour, lw=0.8, alpha=0.8, label=f"{name}, simulated")
        axes.plot(run.times, model[:, column], color=colour, lw=1.8, ls="--", label=f"{name}, RFT")
        axes.plot(run.times, remembered[:, column], color=BLACK, lw=0.9, ls=":", label=f"{name}, with memory")
    axes.axhline(0.0, color=GREY, lw=0.6)
    plain, with_memory = (100.0 * found.errors[run.name][column] for column in ("constant", _MEMORY))
    label_axes(axes, x="Time [s]", y="Force [N]")
    axes.set_title(f"{RUNS[run.name].partition(' (')[0]}: {plain:.0f} → {with_memory:.0f} %", fontsize=8)


def _draw_errors(axes: "Axes", found: Accuracy) -> None:
    place = np.arange(len(found.errors))
    low, high = (float(bound) for bound in PUBLISHED_PLATES.removesuffix(" %").split("–"))
    axes.axhspan(low, high, color="0.9", label=f"paper's plates, {PUBLISHED_PLATES}")
    for shift, (column, label), colour in zip((-0.27, 0.0, 0.27), _COLUMNS.items(), (BLACK, ORANGE, SKY), strict=True):
        errors = [100.0 * e[column] for e in found.errors.values()]
        axes.bar(place + shift, errors, width=0.27, color=colour, label=label)
    axes.set_xticks(place, [str(k + 1) for k in place])
    label_axes(axes, x="Panel", y="Median error [%]", legend={"loc": "upper left"})
    axes.set_ylim(0.0, 120.0)
