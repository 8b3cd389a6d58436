"""An ellipsoid pushed in straight and while it pitches: force over depth, and work (paper Fig. 7)."""

from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.rft import wrenches
from rft_ros.sweeps.motions import oscillating_insertion, sample
from rft_ros.tool import Tool
from studies.paper import NOT_STATED, ellipsoid, law
from studies.result import (
    BLACK,
    BLUE,
    GREY,
    VERMILION,
    StudyResult,
    label_axes,
    new_figure,
    published_against_ours,
)
from studies.sampling import Work, work

__all__ = ["FREQUENCIES", "Stroke", "stroke", "study", "vertical_frequency"]

Array = NDArray[np.float64]

FREQUENCIES = {"the released code": 0.625, "the paper's text": 1.25}
"""Frequency of the pitch [Hz] by source: the code runs ω = 1.25π rad/s, the text says 1.25 Hz."""

_SAMPLES = 1201
_SWEPT = np.concatenate([[0.05], np.arange(0.125, 2.51, 0.125)])  # Hz


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stroke:
    """One insertion: times [s], depth gained [m], shape [n]; forces on the body [N], shape [n, 3]; its work."""

    times: Array
    depths: Array
    forces: Array
    work: Work


def stroke(
    tool: Tool, *, amplitude_deg: float, frequency: float = 0.625, alpha_y: str = "constant"
) -> Stroke:
    """Push the ellipsoid in from the surface; frequency of the pitch [Hz]."""
    motion = oscillating_insertion(amplitude_deg=amplitude_deg, frequency=frequency)
    times, states = sample(motion, _SAMPLES)
    forces = wrenches(tool.plates, law(alpha_y), states)
    return Stroke(
        times=times,
        depths=states[0, 2] - states[:, 2],
        forces=forces[:, :3],
        work=work(times, states, forces),
    )


def vertical_frequency(one: Stroke) -> float:
    """Dominant frequency of the vertical force about its trend over the second half [Hz]."""
    half = len(one.times) // 2
    times, force = one.times[half:], one.forces[half:, 2]
    trend = np.polyval(np.polyfit(times, force, 2), times)
    size = np.abs(np.fft.rfft((force - trend) * np.hanning(len(times)), 16 * len(times)))
    return float(np.fft.rfftfreq(16 * len(times), times[1] - times[0])[size.argmax()])


def study() -> StudyResult:
    """Force and work of the straight and the pitching insertion."""
    tool = ellipsoid()
    straight = stroke(tool, amplitude_deg=0.0)
    pitching = {
        name: stroke(tool, amplitude_deg=9.0, frequency=f) for name, f in FREQUENCIES.items()
    }
    swept = [stroke(tool, amplitude_deg=9.0, frequency=f).work for f in _SWEPT]
    rows = []
    for name, one in pitching.items():
        frequency = FREQUENCIES[name]
        rows += [
            (
                f"{name}, {frequency:g} Hz: frequency of the force",
                "1.25 Hz",
                f"{vertical_frequency(one):.2f} Hz",
            ),
            (
                f"{name}, {frequency:g} Hz: vertical, total work (against straight)",
                NOT_STATED,
                f"{_millijoules(one.work.vertical, straight)}, {_millijoules(one.work.total, straight)}",
            ),
        ]
    return StudyResult(
        name="oscillation",
        title="Ellipsoid pushed in at 5 mm/s, straight and pitching ±9° (Fig. 7)",
        figure=_draw(straight, pitching, swept),
        table=published_against_ours(
            (
                "straight, 60 mm deep: force; work",
                NOT_STATED,
                f"{straight.forces[-1, 2]:.2f} N; {1e3 * straight.work.total:.1f} mJ",
            ),
            *rows,
        ),
    )


def _millijoules(value: float, straight: Stroke) -> str:
    return f"{1e3 * value:.1f} mJ ({100.0 * (value / straight.work.total - 1.0):+.0f} %)"


def _draw(straight: Stroke, pitching: dict[str, Stroke], swept: list[Work]) -> Figure:
    figure = new_figure(13.5, 4.4)
    vertical, level, cost = figure.subplots(1, 3)
    vertical.plot(1e3 * straight.depths, straight.forces[:, 2], color=BLACK, label="straight")
    level.plot(1e3 * straight.depths, straight.forces[:, 0], color=BLACK, label="straight")
    for (name, one), colour, style in zip(
        pitching.items(), (BLUE, VERMILION), ("-", "--"), strict=True
    ):
        label = f"±9° at {FREQUENCIES[name]:g} Hz ({name})"
        vertical.plot(1e3 * one.depths, one.forces[:, 2], style, color=colour, lw=1.2, label=label)
        level.plot(1e3 * one.depths, one.forces[:, 0], style, color=colour, lw=1.2, label=label)
        cost.axvline(FREQUENCIES[name], color=colour, ls=style, lw=1.0, label=name)
    label_axes(
        vertical, x="Depth of the tip [mm]", y="Vertical force [N]", legend={"loc": "upper left"}
    )
    label_axes(level, x="Depth of the tip [mm]", y="Horizontal force, in the plane of pitch [N]")
    cost.plot(_SWEPT, [1e3 * w.total for w in swept], "-", color=BLACK, label="total work")
    cost.plot(
        _SWEPT,
        [1e3 * w.vertical for w in swept],
        "-.",
        color=BLACK,
        label="work of the vertical force",
    )
    cost.axhline(1e3 * straight.work.total, color=GREY, ls=":", label="straight, both")
    cost.set_ylim(bottom=0.0)
    label_axes(
        cost,
        x="Frequency of the pitch [Hz]",
        y="Work over 60 mm [mJ]",
        legend={"loc": "lower center", "ncols": 2},
    )
    figure.suptitle("Ellipsoid 36 x 19 mm, 5 mm/s down, ζ = 0.33, α_y constant")
    return figure
