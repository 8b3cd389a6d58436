"""Plates that lie nearly level, that move along themselves, and the side of a wheel that moves along its axle."""

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.rft import traction_per_depth, wrenches
from rft_ros.rft.traction import FLAT, FLAT_BLEND, NEVER_FLAT
from rft_ros.studies.figure import BLACK, GREY, label_axes, new_figure
from rft_ros.studies.outcome import Outcome
from rft_ros.studies.paper import law
from rft_ros.studies.stability.drawing import DEGREES, RULE_COLOUR, draw_lines, jump_outcome
from rft_ros.studies.stability.sweep import (
    ANGLE_STEP,
    Array,
    Sweep,
    both_rules,
    evenly,
    measured,
    scene_states,
    shipped,
)

__all__ = ["along_itself", "knife_edge", "level", "level_sweeps", "wheel_sweep"]

_DEM_ZETA = 0.24  # of the simulated beads, from their vertical penetration (docs/accuracy.md)

_DEM_FORCES = {0.0: 2.87, 30.0: 2.71, 90.0: 1.04}
"""Mean force [N] over the last 25 mm of simulated drags of an upright 30 x 30 x 3 mm plate, centre 35 mm deep, by ψ."""

_DRAWS = 200  # of noise


def level_sweeps() -> tuple[Sweep, ...]:
    """β through 0 (moving on and down) and through 180° (moving on and up), for yaw 0 to 90°."""
    plate = shipped("plate")
    tilts = evenly(np.radians(-8.0), np.radians(8.0), ANGLE_STEP)
    sweeps = []
    for name, turn, rise in (("β through 0", 0.0, -0.3), ("β through 180°", np.pi, 0.3)):
        for yaw in (0.0, 30.0, 60.0, 90.0):

            def states(tilt: Array, yaw: float = yaw, turn: float = turn, rise: float = rise) -> Array:
                about = Rotation.from_euler("z", yaw, degrees=True) * Rotation.from_euler("y", (turn - tilt)[:, None])
                return scene_states(about, velocity=(0.01, 0.0, 0.01 * rise))

            sweeps.append(Sweep(name=f"{name}, yaw {yaw:.0f}°", tool=plate, values=tilts, states=states))
    return tuple(sweeps)


def level() -> Outcome:
    """Plates whose normal is nearly vertical: the direction of e2 comes from the normal, the velocity, or both."""
    by_name = {sweep.name: measured(sweep) for sweep in level_sweeps()}
    figure = new_figure(8.4, 3.8)
    edge = np.degrees(np.arccos(FLAT))
    for axes, name in zip(figure.subplots(1, 2), ("β through 0, yaw 30°", "β through 180°, yaw 90°"), strict=True):
        draw_lines(axes, by_name[name], DEGREES)
        for limit, style in ((edge, ":"), (FLAT_BLEND, "-.")):
            for side in (-limit, limit):
                axes.axvline(side, color=GREY, lw=0.8, ls=style)
        below = name.startswith("β through 0")
        if below:
            axes.plot(0.0, _by_the_papers_text(), "x", color=BLACK, ms=8, label="the paper's text, at exactly 0")
        label_axes(axes, x="β [°]" if below else "β - 180° [°]", y="Force on the plate [N]")
        axes.set_title(f"{name}, moving on and {'down' if below else 'up'}", fontsize=10)
    figure.axes[0].legend(fontsize=7)
    figure.suptitle(f"centroid jumps at {edge:.1f}° (dotted), refined blends up to {FLAT_BLEND:.0f}°", fontsize=9)
    lines_of_all = [line for lines in by_name.values() for line in lines]
    return jump_outcome("fails_level_plate", "A plate that lies nearly level", figure, lines_of_all, DEGREES)


def _by_the_papers_text() -> float:
    """Force [N] of the shipped plate's lower face with e1 along the horizontal velocity, α_y constant."""
    plates = shipped("plate")["centroid"].packed
    below = plates[5] < -0.5
    load = float((plates[6] * (0.05 - plates[2]))[below].sum())
    traction = traction_per_depth(law("constant", zeta=1.0), 0.0, 1e-9, -1.0, 1.0, 0.0, -0.3, NEVER_FLAT)
    return load * float(np.linalg.norm(traction))


def along_itself() -> Outcome:
    """An upright plate, yawed through motion along itself, where neither face leads."""
    vertices, faces = _box(0.03, 0.03, 0.003)

    def states(psi: Array) -> Array:
        about = Rotation.from_euler("z", psi[:, None]) * Rotation.from_euler("y", -90.0, degrees=True)
        # a little downwards, or rounding would decide whether the lower edge leads: that is `knife_edge`
        return scene_states(about, velocity=(0.1, 0.0, -0.001), height=-0.035)

    sweep = Sweep(
        name="ψ through 90°",
        tool=both_rules(vertices, faces),
        values=evenly(0.0, np.radians(120.0), ANGLE_STEP),
        states=states,
        zeta=_DEM_ZETA,
    )
    lines = measured(sweep)
    figure = new_figure(8.4, 3.6)
    wide, near = figure.subplots(1, 2)
    exactly = scene_states(Rotation.from_quat([0.5, -0.5, 0.5, 0.5]), velocity=(0.1, 0.0, 0.0), height=-0.035)
    for axes in (wide, near):
        draw_lines(axes, lines, DEGREES)
        axes.plot(
            list(_DEM_FORCES), list(_DEM_FORCES.values()), "o", color=BLACK, mfc="white", label="simulated grains"
        )
        for rule, plates in sweep.tool.items():
            force = wrenches(plates, law("linear", zeta=_DEM_ZETA), exactly)[:, :3]
            style = {"color": RULE_COLOUR[rule], "label": f"{rule}, linear, exactly along itself"}
            axes.plot(90.0, np.linalg.norm(force), "x" if rule == "centroid" else "+", ms=9, mew=2, ls="", **style)
    wide.axvspan(70.0, 110.0, color="0.93")
    near.set_xlim(85.0, 95.0)
    near.set_ylim(0.0, 3.2)
    label_axes(wide, x="ψ, yaw from motion along the normal [°]", y="Force on the plate [N]")
    label_axes(near, x="ψ [°]", y="Force on the plate [N]", title="Near motion along itself", legend={})
    wide.set_title("An upright plate; shaded: ψ > 70°", fontsize=10)
    return jump_outcome("fails_along_itself", "A plate that moves along itself", figure, lines, DEGREES)


def wheel_sweep() -> Sweep:
    """A wheel that is pushed nearly along its axle: from a little upwards to a little downwards of exactly along it."""
    import trimesh

    mesh = trimesh.creation.cylinder(radius=0.0625, height=0.06, sections=120)

    def states(fall: Array) -> Array:
        along = 0.01 * np.column_stack([np.cos(fall), np.zeros_like(fall), -np.sin(fall)])
        return scene_states(Rotation.from_euler("y", 90.0, degrees=True), velocity=along, height=0.03)

    return Sweep(
        name="motion through the axle's direction",
        tool=both_rules(np.array(mesh.vertices), np.array(mesh.faces)),
        values=evenly(np.radians(-3.0), np.radians(3.0), ANGLE_STEP),
        states=states,
    )


def knife_edge() -> Outcome:
    """Many facets exactly parallel to the motion: rounding decides which lead."""
    sweep = wheel_sweep()
    lines = measured(sweep)
    figure = new_figure(8.4, 3.6)
    axes, scatter = figure.subplots(1, 2, width_ratios=(3, 2))
    draw_lines(axes, lines, DEGREES)
    label_axes(axes, x="Motion below the axle's direction [°]", y="Force on the wheel [N]", legend={})
    axes.set_title("A wheel, a quarter buried, pushed along its axle", fontsize=10)

    exactly = sweep.states(np.zeros(_DRAWS))
    exactly[:, 7:10] += 1e-14 * np.random.default_rng(0).normal(size=(_DRAWS, 3))
    for k, (rule, plates) in enumerate(sweep.tool.items()):
        force = np.linalg.norm(wrenches(plates, law("constant", zeta=1.0), exactly)[:, :3], axis=1)
        scatter.plot(k + np.linspace(-0.3, 0.3, _DRAWS), force, ".", ms=3, color=RULE_COLOUR[rule], label=rule)
    scatter.set_xticks([0, 1], list(sweep.tool))
    label_axes(scatter, x="Rule", y="Force on the wheel [N]")
    scatter.set_title(f"{_DRAWS} draws of noise of 1e-12 of the speed", fontsize=10)
    return jump_outcome("fails_knife_edge", "Facets exactly parallel to the motion", figure, lines, DEGREES)


def _box(*extents: float) -> tuple[Array, "np.ndarray[tuple[int, int], np.dtype[np.int64]]"]:
    import trimesh

    mesh = trimesh.creation.box(extents)
    return np.array(mesh.vertices), np.array(mesh.faces)
