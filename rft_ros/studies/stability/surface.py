"""The surface: tools that enter and leave, and facets that it cuts."""

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.studies.figure import BLACK, label_axes, new_figure
from rft_ros.studies.outcome import Outcome
from rft_ros.studies.stability.drawing import MILLIMETRES, draw_lines, jump_outcome
from rft_ros.studies.stability.sweep import (
    LENGTH_STEP,
    Array,
    BothRules,
    Sweep,
    both_rules,
    evenly,
    measured,
    scene_states,
    shipped,
)

__all__ = ["height_sweeps", "surface"]


def _coarse(kind: str) -> BothRules:
    import trimesh

    mesh = trimesh.creation.box((0.05, 0.05, 0.003)) if kind == "plate" else trimesh.creation.icosphere(1, radius=0.025)
    return both_rules(np.array(mesh.vertices), np.array(mesh.faces))


def height_sweeps() -> tuple[Sweep, ...]:
    """Heights through the surface: plates upright, level and leaning, a coarse ball, and shipped tools."""
    upright, leaning = Rotation.from_euler("y", -90.0, degrees=True), Rotation.from_euler("zyx", [0.3, 0.5, 0.2])
    level = Rotation.identity()
    cases: tuple[tuple[str, BothRules, Rotation, tuple[float, float, float]], ...] = (
        ("upright plate, 12 facets, entering", _coarse("plate"), upright, (0.01, 0.0, -0.003)),
        ("ball, 80 facets, entering", _coarse("ball"), level, (0.004, 0.0, -0.01)),
        ("ball, 80 facets, leaving", _coarse("ball"), level, (0.004, 0.0, 0.01)),
        ("level plate, 12 facets, entering", _coarse("plate"), level, (0.0, 0.0, -0.01)),
        *(
            (f"height of {name}", shipped(name), leaning, (0.004, 0.002, -0.01))
            for name in ("plate", "ellipsoid", "root_tip")
        ),
    )
    sweeps = []
    for name, tool, attitude, velocity in cases:

        def states(
            height: Array, attitude: Rotation = attitude, velocity: tuple[float, float, float] = velocity
        ) -> Array:
            return scene_states(attitude, velocity=velocity, height=height)

        sweeps.append(Sweep(name=name, tool=tool, values=evenly(-0.03, 0.03, LENGTH_STEP), states=states))
    return tuple(sweeps)


def surface() -> Outcome:
    """Force against height of an upright plate and of a ball, both of few facets."""
    by_name = {sweep.name: measured(sweep) for sweep in height_sweeps()}
    lines = [line for lines in by_name.values() for line in lines]
    figure = new_figure(8.4, 3.6)
    plate, ball = figure.subplots(1, 2)
    constant = {name: [line for line in lines if line.alpha_y == "constant"] for name, lines in by_name.items()}
    draw_lines(plate, constant["upright plate, 12 facets, entering"], MILLIMETRES, label="{rule}")
    draw_lines(ball, constant["ball, 80 facets, entering"], MILLIMETRES, label="{rule}")
    for axes, title in ((plate, "Upright plate, 50 mm, 12 facets"), (ball, "Ball, 50 mm, 80 facets")):
        axes.axvline(0.0, color=BLACK, lw=0.5)
        label_axes(axes, x="Height of the middle over the surface [mm]", y="Force [N]", title=title, legend={})
    return jump_outcome("fails_surface", "At the surface", figure, lines, MILLIMETRES)
