"""Where the method fails: the figures of docs/where-it-fails.md, and the numbers that its sections quote."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rft_ros.rft import (
    INTEGRATIONS,
    POSITION,
    QUATERNION,
    Integration,
    Memory,
    plate_forces,
    wrenches,
    wrenches_in_time,
)
from rft_ros.sweeps.motions import circumnutation, sample
from studies import bad_meshes, concave_tools, force_jumps, sampling
from studies.paper import law, root_tip
from studies.parameter_sweep import (
    RULE_COLOUR,
    Array,
    Line,
    Sweep,
    draw_lines,
    measured,
    scene_states,
    shipped,
)
from studies.result import BLACK, GREEN, StudyResult, label_axes, new_figure, result_of_rows

__all__ = ["CASES", "LIMIT", "overview", "reversal", "share_in_wake", "study", "sweeps", "wake"]

LIMIT = 0.02
"""Largest jump allowed under the refined rule, of the local force."""

_LEAST = 1e-7  # smaller jumps are drawn here
_DEGREE, _MILLIMETRE = 180.0 / np.pi, 1e3


def _by_rule(lines: Sequence[Line]) -> dict[Integration, float]:
    """The largest jump by each rule, over both α_y models."""
    return {rule: max(line.jump for line in lines if line.rule == rule) for rule in INTEGRATIONS}


def overview() -> StudyResult:
    """The largest jump of each sweep."""
    every = (
        *force_jumps.level_sweeps(),
        *force_jumps.yaw_sweeps(),
        force_jumps.wheel_sweep(),
        *force_jumps.direction_sweeps(),
        *force_jumps.height_sweeps(),
        force_jumps.reversal_sweep(),
        force_jumps.turning_sweep(1),
        force_jumps.turning_sweep(8),
    )
    found = {sweep.name: _by_rule(measured(sweep)) for sweep in every}
    figure = new_figure(8.0, 6.2)
    axes = figure.subplots()
    for rule, marker in zip(INTEGRATIONS, ("o", "s"), strict=True):
        jumps = [100.0 * max(jump[rule], _LEAST) for jump in found.values()]
        axes.semilogx(
            jumps, np.arange(len(found)), marker, ms=5, color=RULE_COLOUR[rule], label=rule
        )
    axes.axvline(
        100.0 * LIMIT,
        color=BLACK,
        lw=1.0,
        ls="--",
        label=f"limit for refined, {100.0 * LIMIT:.0f} %",
    )
    axes.set_yticks(np.arange(len(found)), list(found), fontsize=7)
    axes.invert_yaxis()
    label_axes(
        axes,
        x="Largest jump over a step of 1e-4 rad, 1e-5 m or 1e-5 m/s [% of the local force]",
        y="Sweep",
    )
    axes.legend(fontsize=8, loc="lower left")
    rows = [(name, *jumps.values()) for name, jumps in found.items()]
    by_rule = ((rule, "{:.2g} %", 100.0) for rule in INTEGRATIONS)
    return result_of_rows(
        "fails_overview", "The largest jump of each sweep", figure, rows, ("sweep", "{}"), *by_rule
    )


def sweeps() -> StudyResult:
    """The force along six of the sweeps."""
    level = {sweep.name: sweep for sweep in force_jumps.level_sweeps()}
    direction, height = force_jumps.direction_sweeps()[1], force_jumps.height_sweeps()[0]
    panels: tuple[tuple[Sweep, str, float, str, int | None], ...] = (
        (
            level["β through 180°, yaw 90°"],
            "Nearly level plate, facing up",
            _DEGREE,
            "β - 180° [°]",
            None,
        ),
        (
            force_jumps.along_itself_sweep(),
            "Plate in its own plane at 90°",
            _DEGREE,
            "Yaw ψ [°]",
            None,
        ),
        (
            force_jumps.wheel_sweep(),
            "Wheel pushed along its axle",
            _DEGREE,
            "Below the axle [°]",
            None,
        ),
        (direction, "Plate at β 45°: up -90°, down 90°", _DEGREE, "Direction of motion [°]", 2),
        (
            force_jumps.turning_sweep(1),
            "Turning plate of 12 facets",
            _MILLIMETRE,
            "Place of the axis [mm]",
            0,
        ),
        (
            height,
            "Upright plate of 12 facets, entering",
            _MILLIMETRE,
            "Height of its middle [mm]",
            None,
        ),
    )
    figure = new_figure(11.0, 6.4)
    rows = []
    for axes, (sweep, title, per_unit, x, component) in zip(
        figure.subplots(2, 3).flat, panels, strict=True
    ):
        lines = measured(sweep)
        draw_lines(axes, lines, per_unit, component=component)
        y = "Force [N]" if component is None else f"Force along {'xyz'[component]} [N]"
        label_axes(axes, x=x, y=y, title=title)
        rows.append((sweep.name, *_by_rule(lines).values()))
    figure.axes[0].legend(fontsize=7)
    by_rule = ((rule, "{:.2g} %", 100.0) for rule in INTEGRATIONS)
    return result_of_rows(
        "fails_sweeps", "The force along six sweeps", figure, rows, ("sweep", "{}"), *by_rule
    )


_RATE = 200.0  # Hz, of the stroke in time
_MOBILIZATION_LENGTH = 0.003  # m, the default of node and replay


def _stroke() -> tuple[Array, Array]:
    """Times [s] and states of a plate: 20 mm down, rest for a second, up; with noise of 0.03 mm/s."""
    times = np.arange(0.0, 5.0, 1.0 / _RATE)
    random = np.random.default_rng(0)
    speed = np.where(times < 2.0, -0.01, np.where(times < 3.0, 0.0, 0.01))
    height = -0.03 + np.concatenate([[0.0], np.cumsum(speed)[:-1]]) / _RATE
    noisy = random.normal(0.0, 3e-5, (len(times), 3))
    noisy[:, 2] += speed
    return times, scene_states(Rotation.identity(), velocity=noisy, height=height)


def reversal() -> StudyResult:
    """Vertical force over a stroke (down, rest, up), by each rule and with memory."""
    times, states = _stroke()
    plates = shipped("plate")
    forces = {
        rule: wrenches(plates[rule], law("constant", zeta=1.0), states)[:, 2]
        for rule in INTEGRATIONS
    }
    grains = law("constant", zeta=1.0, mobilization_length=_MOBILIZATION_LENGTH)
    remembered = wrenches_in_time(plates["refined"], grains, states, Memory(plates["refined"]))[
        :, 2
    ]
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    for rule, width in zip(INTEGRATIONS, (2.2, 1.0), strict=True):
        axes.plot(times, forces[rule], color=RULE_COLOUR[rule], lw=width, label=rule)
    label = f"refined, with memory, λ = {1e3 * _MOBILIZATION_LENGTH:g} mm"
    axes.plot(times, remembered, color=GREEN, lw=2.0, ls="--", label=label, zorder=5)
    axes.axvspan(2.0, 3.0, color="0.93")
    axes.axhline(0.0, color=BLACK, lw=0.5)
    label_axes(
        axes,
        x="Time [s]",
        y="Vertical force [N]",
        title="Down, rest (shaded) with noise, up",
        legend={},
    )
    rest = slice(int(2.1 * _RATE), int(3.0 * _RATE))
    lines: list[tuple[str, Array]] = [*forces.items(), ("refined, with memory", remembered)]
    rows = [(name, force[rest].min(), force[rest].max()) for name, force in lines]
    columns = (
        ("rule", "{}"),
        ("least force at rest", "{:.1f} N"),
        ("greatest force at rest", "{:.1f} N"),
    )
    return result_of_rows("fails_reversal", "Rest and reversal", figure, rows, *columns)


_PITCHES = (0.02, 0.04, 0.08)
"""Pitches of the helix [m]. The paper sees forces deviate at 20 mm and not at 40 mm."""

_DEEP = 0.5e-3  # m inside a former place of the tool; less is facet size
_POSES = 100  # along the path


def share_in_wake(pitch: float) -> float:
    """Share of a root tip's force from facets in its own wake [1], at the end of a helix 60 mm deep."""
    tool = root_tip()
    plates = tool.plates
    _, states = sample(circumnutation(pitch=pitch, travel=0.06), _POSES)
    last = states[-1]
    force = np.linalg.norm(plate_forces(plates, law("constant"), last), axis=1)
    places = Rotation.from_quat(last[QUATERNION]).apply(plates.centroids.T.copy()) + last[POSITION]
    # outward normals and offsets: the root is convex
    sides = np.unique(ConvexHull(tool.vertices).equations.round(9), axis=0)
    passed = np.zeros(len(plates), dtype=np.bool_)
    for state in states[:-1]:
        left = np.flatnonzero(~passed)
        there = Rotation.from_quat(state[QUATERNION]).inv().apply(places[left] - state[POSITION])
        passed[left] = (there @ sides[:, :3].T + sides[:, 3]).max(axis=1) < -_DEEP
    return float(force[passed].sum() / force.sum())


def wake() -> StudyResult:
    """The share over the pitch."""
    rows = [(pitch, share_in_wake(pitch)) for pitch in _PITCHES]
    columns = (
        ("pitch", "{:.0f} mm", 1e3),
        ("share of the force from where the tool has been", "{:.0f} %", 100.0),
    )
    return result_of_rows("fails_wake", "A tool in its own wake", None, rows, *columns)


CASES: tuple[Callable[[], StudyResult], ...] = (
    overview,
    sweeps,
    reversal,
    sampling.window,
    wake,
    concave_tools.study,
    bad_meshes.study,
)
"""The cases in the order of the page."""


def study() -> tuple[StudyResult, ...]:
    """All cases; without the simulated runs, all but the hollow tools."""
    return tuple(
        case() for case in CASES if case is not concave_tools.study or concave_tools.DATA.is_dir()
    )
