"""How many force components lie within one and two standard deviations of the prediction, on all data at hand.

Of the recordings of each group, in the order of their names, every other one was used to choose the constants of
`rft_ros/estimator/sigma.py` and of (L5); the table shows the rest apart.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from studies.choice import Choice
from studies.dem import RUNS
from studies.learning import (
    LAGS,
    MODELS,
    Series,
    bag_series,
    dem_series,
    in_sigmas,
    learned,
    unlearned,
)
from studies.result import StudyResult, TextTable

__all__ = ["GROUPS", "series_of_group", "study", "within"]

Array = NDArray[np.float64]

GROUPS = ("dem", "abb", "cmu", "wheel")
"""Groups of recordings: simulated grains; penetrations of the ABB plate and of round plates; wheels."""

_MORE_RUNS = ("buried_block", "drag_plate_b90_d15_y22")
_MODES = (None, *LAGS)


def series_of_group(group: str, choice: Choice) -> list[Series]:
    """The recordings of a group of `GROUPS` in the order of their names; [] where they are absent."""
    if group == "dem":
        return [dem_series(name, choice) for name in sorted((*RUNS, *_MORE_RUNS))]
    return sorted(bag_series(group, choice), key=lambda series: series.name)


def within(series: Series, *, lag: float | None) -> Array:
    """Errors over their standard deviations, shape [n, 3], by the fixed model (`lag` None) or learned [m]."""
    return in_sigmas(series, unlearned(series) if lag is None else learned(series, lag=lag).out)


def study() -> StudyResult:
    """The table by half: recordings count alike."""
    rows: list[tuple[str, ...]] = []
    for choice in MODELS:
        groups = [series_of_group(group, choice) for group in GROUPS]
        for half, name in enumerate(("tuned on", "held out")):
            runs = [run for group in groups for run in group[half::2]]
            errors = [[within(run, lag=mode) for mode in _MODES] for run in runs]
            rows.append((f"**all**; {choice.name}", name, *_cells(errors)))
    models = ("fixed model", *(f"learning, lag {1e3 * lag:g} mm" for lag in LAGS))
    header = ("data; model", "recordings", *(f"{model}: x / y / z" for model in models))
    return StudyResult(
        name="coverage",
        title="Force components within one and two standard deviations",
        figure=None,
        table=TextTable(header=header, rows=tuple(rows)),
    )


def _cells(errors: Sequence[Sequence[Array]]) -> list[str]:
    """Such as "78, 95 / 71, 94 / 74, 95" for each mode: x, y and z within one and two; recordings count alike."""
    cells = []
    for mode in range(len(_MODES)):
        parts = []
        for part in range(3):
            shares = [
                100.0 * np.mean([(run[mode][:, part] < k).mean() for run in errors])
                for k in (1.0, 2.0)
            ]
            parts.append(", ".join(f"{share:.0f}" for share in shares))
        cells.append(" / ".join(parts))
    return cells
