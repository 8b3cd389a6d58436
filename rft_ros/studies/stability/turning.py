"""A tool that turns: the side of the axis on which a facet lies decides whether it leads."""

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.rft import wrenches
from rft_ros.studies.figure import BLACK, label_axes, new_figure
from rft_ros.studies.outcome import Outcome
from rft_ros.studies.paper import law
from rft_ros.studies.stability.drawing import MILLIMETRES, RULE_COLOUR, draw_lines, jump_outcome
from rft_ros.studies.stability.sweep import LENGTH_STEP, Array, Sweep, both_rules, evenly, measured, scene_states

__all__ = ["turning", "turning_sweep"]

_SIZES = (1, 2, 4, 8, 16)  # facets along a side, in pairs


def turning_sweep(divisions: int = 1) -> Sweep:
    """An upright plate that turns about a vertical axis, which is moved along the plate through its middle."""
    import trimesh

    mesh = trimesh.creation.box((0.05, 0.05, 0.003))
    for _ in range(int(np.log2(divisions))):
        mesh = mesh.subdivide()

    def states(axis: Array) -> Array:
        # the axis at y = a: the origin moves with -ω x (0, a, 0)
        velocity = np.column_stack([axis, np.zeros_like(axis), np.zeros_like(axis)])
        about = Rotation.from_euler("y", -90.0, degrees=True)
        return scene_states(about, velocity=velocity, spin=(0.0, 0.0, 1.0))

    return Sweep(
        name=f"axis of turning, {len(mesh.faces)} facets",
        tool=both_rules(np.array(mesh.vertices), np.array(mesh.faces)),
        values=evenly(-0.04, 0.04, LENGTH_STEP),
        states=states,
    )


def turning() -> Outcome:
    """Net force against where the axis is, with 12 facets; the jumps against the number of facets."""
    by_size = [measured(turning_sweep(n)) for n in _SIZES]
    lines = [line for lines in by_size for line in lines]
    coarse = [line for line in by_size[0] if line.alpha_y == "constant"]
    figure = new_figure(8.4, 3.6)
    force, sizes = figure.subplots(1, 2)
    draw_lines(force, coarse, MILLIMETRES, shown=lambda forces: forces[:, 0], label="{rule}, 12 facets")
    fine = turning_sweep(16)
    exact = wrenches(fine.tool["refined"], law("constant", zeta=1.0), fine.states(fine.values))[:, 0]
    force.plot(1e3 * fine.values, exact, color=BLACK, lw=1.0, ls=":", label="refined, 3,072 facets")
    label_axes(force, x="Axis of turning, from the plate's middle [mm]", y="Net force along the normal [N]", legend={})
    force.set_title("An upright plate that turns about a vertical axis", fontsize=10)
    for rule in ("centroid", "refined"):
        count = [12 * n * n for n in _SIZES]
        jump = [100.0 * max(line.jump for line in lines if line.rule == rule) for lines in by_size]
        sizes.loglog(count, jump, "o-" if rule == "centroid" else "s--", ms=4, color=RULE_COLOUR[rule], label=rule)
    label_axes(sizes, x="Facets", y="Largest jump [% of the local force]", legend={})
    sizes.set_title("Every facet turns over at once", fontsize=10)
    return jump_outcome("fails_turning", "Pure turning", figure, lines, MILLIMETRES)
