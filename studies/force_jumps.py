"""Sweeps of one parameter through the places where the force of the published rule jumps or rises steeply.

Nearly level plates, plates that move in their own plane, facets parallel to the motion, withdrawal, turning, the
surface, and reversal. `docs/where-it-fails.md` explains them; `stability` draws them.
"""

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from studies.parameter_sweep import (
    ANGLE_STEP,
    LENGTH_STEP,
    Array,
    BothRules,
    Sweep,
    both_rules,
    evenly,
    scene_states,
    shipped,
)

__all__ = [
    "along_itself_sweep",
    "direction_sweeps",
    "height_sweeps",
    "level_sweeps",
]
__all__ += ["reversal_sweep", "turning_sweep", "wheel_sweep", "yaw_sweeps"]

_DEM_ZETA = 0.24  # of the simulated beads, from their vertical penetration (docs/accuracy.md)


def level_sweeps() -> tuple[Sweep, ...]:
    """β through 0 (moving forwards and down) and through 180° (forwards and up), for yaw 0 to 90°."""
    plate = shipped("plate")
    tilts = evenly(np.radians(-8.0), np.radians(8.0), ANGLE_STEP)
    sweeps = []
    for name, turn, rise in (("β through 0", 0.0, -0.3), ("β through 180°", np.pi, 0.3)):
        for yaw in (0.0, 30.0, 60.0, 90.0):

            def states(
                tilt: Array, yaw: float = yaw, turn: float = turn, rise: float = rise
            ) -> Array:
                about = Rotation.from_euler("z", yaw, degrees=True) * Rotation.from_euler(
                    "y", (turn - tilt)[:, None]
                )
                return scene_states(about, velocity=(0.01, 0.0, 0.01 * rise))

            sweeps.append(
                Sweep(name=f"{name}, yaw {yaw:.0f}°", tool=plate, values=tilts, states=states)
            )
    return tuple(sweeps)


def along_itself_sweep() -> Sweep:
    """An upright plate yawed through motion in its own plane, ψ = 90°, where neither face leads."""

    def states(psi: Array) -> Array:
        about = Rotation.from_euler("z", psi[:, None]) * Rotation.from_euler(
            "y", -90.0, degrees=True
        )
        # slightly downwards: otherwise rounding decides whether the lower edge leads
        return scene_states(about, velocity=(0.1, 0.0, -0.001), height=-0.035)

    return Sweep(
        name="ψ through 90°",
        tool=both_rules(trimesh.creation.box((0.03, 0.03, 0.003))),
        values=evenly(0.0, np.radians(120.0), ANGLE_STEP),
        states=states,
        zeta=_DEM_ZETA,
    )


def wheel_sweep() -> Sweep:
    """A wheel pushed along its axle, from 3° upwards to 3° downwards."""
    mesh = trimesh.creation.cylinder(radius=0.0625, height=0.06, sections=120)

    def states(fall: Array) -> Array:
        along = 0.01 * np.column_stack([np.cos(fall), np.zeros_like(fall), -np.sin(fall)])
        return scene_states(
            Rotation.from_euler("y", 90.0, degrees=True), velocity=along, height=0.03
        )

    return Sweep(
        name="motion through the axle's direction",
        tool=both_rules(mesh),
        values=evenly(np.radians(-3.0), np.radians(3.0), ANGLE_STEP),
        states=states,
    )


_ATTITUDES = {
    "upright": Rotation.from_euler("y", 90.0, degrees=True),
    "leaning": Rotation.from_euler("yx", [50.0, 20.0], degrees=True),
}


def yaw_sweeps(*tools: str) -> tuple[Sweep, ...]:
    """Yaw over 120° of shipped tools (default: plate, ellipsoid, root tip), moving forwards, or forwards and down."""
    sweeps = []
    for tool in tools or ("plate", "ellipsoid", "root_tip"):
        plates = shipped(tool)
        for name, attitude in _ATTITUDES.items():
            velocity = (0.01, 0.0, 0.0) if name == "upright" else (0.01, 0.002, -0.004)

            def states(
                yaw: Array,
                attitude: Rotation = attitude,
                velocity: tuple[float, float, float] = velocity,
            ) -> Array:
                return scene_states(
                    Rotation.from_euler("z", yaw[:, None]) * attitude, velocity=velocity
                )

            values = evenly(np.radians(-15.0), np.radians(105.0), ANGLE_STEP)
            sweeps.append(
                Sweep(name=f"yaw, {tool}, {name}", tool=plates, values=values, states=states)
            )
    return tuple(sweeps)


def direction_sweeps() -> tuple[Sweep, ...]:
    """The direction of motion, from up over forwards to down, of a plate at three attack angles."""
    sweeps = []
    for beta in (0.0, 45.0, 90.0):

        def states(fall: Array, beta: float = beta) -> Array:
            velocity = 0.01 * np.column_stack(
                [np.cos(fall), 0.2 * np.ones_like(fall), -np.sin(fall)]
            )
            return scene_states(Rotation.from_euler("y", -beta, degrees=True), velocity=velocity)

        fall = evenly(-0.5 * np.pi, 0.5 * np.pi, ANGLE_STEP)
        sweeps.append(
            Sweep(
                name=f"direction, β {beta:.0f}°", tool=shipped("plate"), values=fall, states=states
            )
        )
    return tuple(sweeps)


def turning_sweep(divisions: int = 1) -> Sweep:
    """An upright plate that turns about a vertical axis; the axis moves along the plate through its middle."""
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
        tool=both_rules(mesh),
        values=evenly(-0.04, 0.04, LENGTH_STEP),
        states=states,
    )


def _coarse(kind: str) -> BothRules:
    mesh = (
        trimesh.creation.box((0.05, 0.05, 0.003))
        if kind == "plate"
        else trimesh.creation.icosphere(1, radius=0.025)
    )
    return both_rules(mesh)


def height_sweeps() -> tuple[Sweep, ...]:
    """Heights through the surface of upright, level and leaning plates, a coarse ball, and shipped tools."""
    upright, leaning = (
        Rotation.from_euler("y", -90.0, degrees=True),
        Rotation.from_euler("zyx", [0.3, 0.5, 0.2]),
    )
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
            height: Array,
            attitude: Rotation = attitude,
            velocity: tuple[float, float, float] = velocity,
        ) -> Array:
            return scene_states(attitude, velocity=velocity, height=height)

        sweeps.append(
            Sweep(name=name, tool=tool, values=evenly(-0.03, 0.03, LENGTH_STEP), states=states)
        )
    return tuple(sweeps)


_SPEED_STEP = 1e-5  # m/s


def reversal_sweep() -> Sweep:
    """A plate whose vertical speed passes through zero while it drifts sideways at 0.01 mm/s."""
    values = evenly(-200.0 * _SPEED_STEP, 200.0 * _SPEED_STEP, _SPEED_STEP)

    def states(speed: Array) -> Array:
        drift = np.full_like(speed, 1e-5)
        return scene_states(
            Rotation.identity(), velocity=np.column_stack([drift, 0.0 * drift, speed])
        )

    return Sweep(
        name="vertical speed through 0", tool=shipped("plate"), values=values, states=states
    )
