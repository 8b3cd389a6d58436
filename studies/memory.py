"""The memory of one plate: pressed, drawn back, and pressed again."""

import numpy as np

from rft_ros.rft import Memory, Plates, checked_states, wrenches, wrenches_in_time
from studies.paper import law
from studies.result import BLUE, GREY, StudyResult, TextTable, label_axes, new_figure

__all__ = ["study"]

DEPTH = 0.03
"""Depth [m], at which λ(d) is the mobilization length."""

LENGTH = 0.003
"""The mobilization length [m]."""

CORNERS = 1e-3 * np.array([6.0, 4.0, 8.0])
"""Where the plate turns back, comes again, and ends [m]."""


def study() -> StudyResult:
    """The force on an upright plate over its displacement, at a constant depth."""
    plate = Plates.from_arrays([[0.0, 0.0, 0.0]], [[1.0, 0.0, 0.0]], [1e-4])
    places = np.concatenate(
        [np.linspace(a, b, 800) for a, b in zip([0.0, *CORNERS[:2]], CORNERS, strict=True)]
    )
    states = np.zeros((len(places), 13))
    states[:, 0], states[:, 2], states[:, 6] = places, -DEPTH, 1.0
    states[:, 7] = np.gradient(places)
    grains = law("linear", zeta=1.0, mobilization_length=LENGTH)
    states = checked_states(states)
    held = -wrenches_in_time(plate, grains, states, Memory(plate))[:, 0]
    by_law = -wrenches(plate, grains, states[:1])[0, 0]
    figure = new_figure(5.6, 3.4)
    axes = figure.subplots()
    axes.plot(1e3 * places, held, color=BLUE, lw=2.0, label="with memory")
    axes.axhline(by_law, color=GREY, ls="--", label="law, in steady motion")
    top = held[:800].max()
    for text, at, to in (
        (
            "yields towards the law",
            (2.6, 0.45 * by_law),
            (2.2, np.interp(2.2, 1e3 * places[:800], held[:800])),
        ),
        ("unloads as a spring", (6.3, 0.6 * top), (5.97, 0.6 * top)),
        ("beyond contact: the gap opens", (1.3, 0.07 * by_law), (4.7, 0.0)),
        ("gap closed, reloads", (4.8, 0.28 * by_law), (4.42, 0.31 * top)),
    ):
        axes.annotate(text, to, at, fontsize=8, arrowprops={"arrowstyle": "->", "lw": 0.7})
    label_axes(
        axes,
        x="Displacement of the plate [mm]",
        y="Force against the plate [N]",
        legend={"loc": (0.02, 0.74)},
    )
    rows = [("at the turn", f"{top:.2f}"), ("in steady motion", f"{by_law:.2f}")]
    return StudyResult(
        name="memory", title="A plate pressed, drawn back and pressed again", figure=figure,
        table=TextTable(header=("force on the plate", "N"), rows=tuple(rows)),
    )  # fmt: skip
