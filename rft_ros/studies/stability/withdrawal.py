"""Upward-facing faces that lead: where the force changes sign, and where it would push a tool on its way."""

import numpy as np
from scipy.spatial.transform import Rotation

from rft_ros.rft import Integration, Plates, wrenches
from rft_ros.studies.figure import BLACK, GREEN, GREY, PURPLE, label_axes, new_figure
from rft_ros.studies.outcome import Outcome
from rft_ros.studies.paper import ALPHA_Y, law
from rft_ros.studies.stability.drawing import DEGREES, RULE_COLOUR, draw_lines, jump_outcome
from rft_ros.studies.stability.sweep import ANGLE_STEP, Array, Sweep, evenly, measured, scene_states, shipped
from rft_ros.tool.refine import FLAT_HALF_ANGLE

__all__ = ["direction_sweeps", "greatest_power", "plate_facing", "withdrawal"]

_DEPTH = 1.0  # [m], so that a plate's own size does not matter

_DIRECTIONS = 90  # of velocity, from the normal to the plate, and half of those around it


def direction_sweeps() -> tuple[Sweep, ...]:
    """The direction of motion, from straight up over forwards to straight down, of a plate at three attack angles."""
    sweeps = []
    for beta in (0.0, 45.0, 90.0):

        def states(fall: Array, beta: float = beta) -> Array:
            velocity = 0.01 * np.column_stack([np.cos(fall), 0.2 * np.ones_like(fall), -np.sin(fall)])
            return scene_states(Rotation.from_euler("y", -beta, degrees=True), velocity=velocity)

        fall = evenly(-0.5 * np.pi, 0.5 * np.pi, ANGLE_STEP)
        sweeps.append(Sweep(name=f"direction, β {beta:.0f}°", tool=shipped("plate"), values=fall, states=states))
    return tuple(sweeps)


def plate_facing(beta: float, rule: Integration) -> Plates:
    """One small triangle at the origin whose outward normal lies at β [rad] towards +x."""
    along, up = np.array([0.0, 1.0, 0.0]), np.array([np.cos(beta), 0.0, np.sin(beta)])
    normal = np.array([[np.sin(beta), 0.0, -np.cos(beta)]])
    corners = 1e-3 * np.array([up, -0.5 * up - 0.8 * along, -0.5 * up + 0.8 * along])
    if np.cross(corners[1] - corners[0], corners[2] - corners[0]) @ normal[0] < 0.0:
        corners = corners[[0, 2, 1]]
    if rule == "refined":
        return Plates.from_triangles(corners[None], [FLAT_HALF_ANGLE])
    return Plates.from_arrays(np.zeros((1, 3)), normal, [1e-6])


def greatest_power(beta: float, rule: Integration, alpha_y: str, *, intruding: bool) -> float:
    """Greatest F·v of a leading plate over ζ, area, depth and speed [N/cm³], over all directions of motion.

    Positive: the grains would push the plate on its way; -inf: it leads in none. `intruding`: only directions that do
    not rise (γ >= 0).
    """
    # directions on the leading side of the plate, the same about its normal at every β
    normal, along = np.array([np.sin(beta), 0.0, -np.cos(beta)]), np.array([0.0, 1.0, 0.0])
    off, around = np.meshgrid(
        np.linspace(0.0, 0.499 * np.pi, _DIRECTIONS), np.linspace(0.0, 2.0 * np.pi, 2 * _DIRECTIONS)
    )
    aside = np.cos(around)[..., None] * along + np.sin(around)[..., None] * np.cross(normal, along)
    v = (np.cos(off)[..., None] * normal + np.sin(off)[..., None] * aside).reshape(-1, 3)
    v = v[v[:, 2] <= 0.0] if intruding else v
    if len(v) == 0:
        return -np.inf
    plates = plate_facing(beta, rule)
    force = wrenches(plates, law(alpha_y, zeta=1.0), scene_states(Rotation.identity(), velocity=v, height=-_DEPTH))
    return float((force[:, :3] * v).sum(axis=1).max() / (1e6 * plates.area * _DEPTH))


def withdrawal() -> Outcome:
    """Vertical force against the direction of motion; greatest power against the attack angle."""
    sweeps = direction_sweeps()
    lines = [line for sweep in sweeps for line in measured(sweep)]
    figure = new_figure(8.4, 3.8)
    by_direction, by_angle = figure.subplots(1, 2)
    constant = [line for line in lines if line.alpha_y == "constant"]
    draw_lines(by_direction, constant, DEGREES, shown=lambda forces: forces[:, 2], label="_{rule}")
    for line in constant[1::2]:
        at = int(0.8 * len(line.values))
        by_direction.text(
            np.degrees(line.values[at]),
            line.forces[at, 2] + 6.0,
            line.sweep.rpartition(", ")[2],
            fontsize=8,
            ha="right",
        )
    by_direction.plot([], [], color=RULE_COLOUR["centroid"], lw=2.4, label="centroid")
    by_direction.plot([], [], color=RULE_COLOUR["refined"], lw=1.4, label="refined")
    by_direction.axhline(0.0, color=BLACK, lw=0.6)
    label_axes(by_direction, x="Direction: up -90°, forwards 0, down 90°", y="Vertical force [N]", legend={})
    by_direction.set_title("A buried plate (3 mm thick)", fontsize=10)

    degrees = np.arange(0.0, 181.0, 2.0)
    for model, colour in zip(ALPHA_Y, (GREEN, PURPLE), strict=True):
        for intruding, dash in ((False, "-"), (True, "--")):
            power = [greatest_power(b, "refined", model, intruding=intruding) for b in np.radians(degrees)]
            moving = "γ >= 0" if intruding else "any direction"
            by_angle.plot(degrees, power, dash, color=colour, label=f"α_y {model}, {moving}")
    by_angle.axhline(0.0, color=BLACK, lw=0.6)
    by_angle.axvline(0.2035 / 0.0015, color=GREY, lw=0.8, ls=":")
    by_angle.set_ylim(-0.15, 0.1)
    label_axes(by_angle, x="Attack angle β [°]", y="Greatest F·v [N/cm³]", legend={"loc": "lower left"})
    by_angle.set_title("Above 0 the grains would push the plate on", fontsize=10)
    return jump_outcome("fails_withdrawal", "Withdrawal, and faces that look up and lead", figure, lines, DEGREES)
