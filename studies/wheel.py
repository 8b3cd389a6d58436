"""A smooth wheel in real sand: forces in 190 steady states, and how deep it sinks under its load while it travels.

Carnegie Mellon's testbed, ``../shared/data/cmu_wheel`` and ``cmu_wheel_motion``; their READMEs say how it was measured.
The wheel is a closed cylinder of 125 x 60 mm. No constant of the model was chosen on it.
"""

from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.rft import Integration, Law, Memory, Plates, wrenches, wrenches_in_time
from rft_ros.simulation import Grains
from rft_ros.tool import Tool, tool_of_mesh
from studies.choice import REMEMBERED
from studies.result import BLUE, VERMILION, StudyResult, TextTable, label_axes, new_figure

__all__ = ["DATA", "KINDS", "LOAD", "MEASURED", "STEPS", "ZETA_OF_PRESS", "SteadyStates", "Travel"]
__all__ += [
    "fitted_zeta",
    "kind_of",
    "measured_sinkage",
    "median_errors",
    "of_kind",
    "read_states",
]
__all__ += ["sinkage", "steady_forces", "steady_travel", "study", "wheel"]

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
"""The folder of the measurements."""

ZETA_OF_PRESS = 0.85
"""ζ of wheels of this size that were pressed into this sand, over the first 10 mm."""

LOAD = 20.0
"""Load on the wheel that was free to sink [N]."""

KINDS = ("drag", "brake", "roll", "spin")
"""A wheel that does not turn, turns more slowly than it travels, within a fifth of the speed of travel, or faster."""

_RADIUS = 0.0625  # m
_WIDTH = 0.06  # m
_SECTIONS = 48
_RINGS = 5
_GRAVITY = 9.81  # m/s²
_SPEED = 0.01  # m/s, at which every wheel travels
_PATH = 0.16  # m, of the fastest point: an arc as long as the deepest wheel has in the sand
_STEP = 0.0005  # m
STEPS = round(_PATH / _STEP) + 1
"""Steps until the force is steady."""
_START_CLEARANCE = 0.0315  # m, the authors' own constant for all runs
_TRAVEL_STEP = 0.0005  # m


@cache
def wheel(integration: Integration = "refined", tolerance: float = 0.0) -> Tool:
    """The closed cylinder; arguments as for `load_tool`. Its axle lies along x, through the tool frame's origin."""
    radii = _RADIUS * np.linspace(0.0, 1.0, _RINGS + 1)
    half = 0.5 * _WIDTH
    below = [(radius, -half) for radius in radii]
    tread = [(_RADIUS, height) for height in np.linspace(-half, half, _RINGS + 1)[1:-1]]
    above = [(radius, half) for radius in radii[::-1]]
    mesh = trimesh.creation.revolve([*below, *tread, *above], sections=_SECTIONS)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (0.0, 1.0, 0.0)))
    return tool_of_mesh(mesh, name="wheel", integration=integration, tolerance=tolerance)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SteadyStates:
    """Wheels that move steadily in sand.

    `states`: shape [n, 13], columns `rft_ros.rft.STATE`; the surface is at 0. `forces`: measured, on the wheel [N],
    shape [n, 3], world axes. `slip_angles`: from the wheel's plane to its velocity [deg]. `rim_speeds` [m/s].
    """

    states: Array
    forces: Array
    slip_angles: Array
    rim_speeds: Array


def read_states() -> SteadyStates:
    """The 190 measured states."""
    folder = DATA / "cmu_wheel"
    rows = np.loadtxt(folder / "smooth_states.csv", delimiter=",", skiprows=1)
    table = np.genfromtxt(folder / "smooth_expected.csv", delimiter=",", names=True)
    forces = np.column_stack([table[f"measured_{axis}"] for axis in ("fx", "fy", "fz")])
    return SteadyStates(
        states=rows[:, 1:],
        forces=forces,
        slip_angles=table["slip_angle_deg"],
        rim_speeds=1e-3 * table["rim_speed_mm_s"],
    )


def kind_of(rim_speed: float) -> str:
    """The one of `KINDS` of a wheel that travels at 10 mm/s. `rim_speed` [m/s]."""
    if rim_speed == 0.0:
        return "drag"
    if rim_speed < 0.79 * _SPEED:
        return "brake"
    return "roll" if rim_speed < 1.21 * _SPEED else "spin"


def steady_forces(law: Law, states: SteadyStates, plates: Plates | None = None) -> Array:
    """The force in each state [N], shape [n, 3]; with memory, after the motion has gone on for `_PATH`."""
    plates = wheel().plates if plates is None else plates
    if not law.has_memory:
        return wrenches(plates, law, states.states)[:, :3]
    durations = _STEP / np.maximum(np.abs(states.rim_speeds), _SPEED)
    steps = np.arange(STEPS)
    forces = np.empty((len(states.states), 3))
    for k, (state, duration) in enumerate(zip(states.states, durations, strict=True)):
        path = np.tile(state, (STEPS, 1))
        path[:, :2] += steps[:, None] * duration * state[7:9]
        path[:, 3] = np.sin(0.5 * steps * state[10] * duration)
        path[:, 6] = np.cos(0.5 * steps * state[10] * duration)
        forces[k] = wrenches_in_time(plates, law, path, Memory(plates))[-1, :3]
    return forces


def fitted_zeta(law: Law, states: SteadyStates, model: Array) -> float:
    """ζ for which the model's forces, shape [n, 3], computed with `law`, have the least squared errors."""
    return law.zeta * float((states.forces * model).sum() / (model**2).sum())


def median_errors(states: SteadyStates, model: Array) -> dict[str, float]:
    """The median of abs(model - measured) / abs(measured) of force vectors: of `all`, and of each kind."""
    sizes = np.linalg.norm(states.forces, axis=1)
    errors = np.linalg.norm(model - states.forces, axis=1) / sizes
    return {kind: float(np.median(errors[of_kind(states, kind)])) for kind in ("all", *KINDS)}


def of_kind(states: SteadyStates, kind: str) -> NDArray[np.bool_]:
    """Which states are of a kind, or of `all`, shape [n]."""
    return np.array([kind in ("all", kind_of(speed)) for speed in states.rim_speeds])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Travel:
    """A wheel on a carriage that travels at 10 mm/s and may sink, at equal steps of time.

    `travel` [m]; `yaw`: of the wheel's plane out of the direction of travel, `turn`: about its axle [rad]; shape [n].
    """

    travel: Array
    yaw: Array
    turn: Array


def steady_travel(*, slip_angle: float, rim_speed: float, length: float) -> Travel:
    """A travel of this length [m]; `slip_angle` [deg], `rim_speed` [m/s]."""
    travel = np.arange(0.0, length, _TRAVEL_STEP)
    yaw = np.full(len(travel), np.radians(slip_angle))
    turn = travel * rim_speed / (_SPEED * _RADIUS)
    return Travel(travel=travel, yaw=yaw, turn=turn)


def sinkage(law: Law, motion: Travel) -> Array:
    """Sinkage [m] of a wheel that is set down on the surface and carries `LOAD`, shape [n].

    The simulator's grains hold it up; only its height is free.
    """
    dt = _TRAVEL_STEP / _SPEED
    grains = Grains(wheel(), law)
    inverse_inertia = np.zeros((6, 6))
    inverse_inertia[2, 2] = _GRAVITY / LOAD
    free_acceleration = np.array([0.0, 0.0, -_GRAVITY, 0.0, 0.0, 0.0])
    attitudes = Rotation.from_euler("ZX", np.column_stack([motion.yaw, -motion.turn]))
    turning = (attitudes[1:] * attitudes[:-1].inv()).as_rotvec() / dt
    speeds = np.diff(motion.travel) / dt
    heights = np.full(len(motion.travel), _RADIUS)
    sinking = 0.0
    for k, (speed, turn_rate) in enumerate(zip(speeds, turning, strict=True)):
        wrench = grains.step(
            position=(0.0, motion.travel[k], heights[k]),
            quaternion=attitudes[k].as_quat(),
            twist=(0.0, speed, sinking, *turn_rate),
            dt=dt,
            inverse_inertia=inverse_inertia,
            free_acceleration=free_acceleration,
        )
        sinking += dt * _GRAVITY * (wrench[2] / LOAD - 1.0)
        heights[k + 1] = heights[k] + dt * sinking
    return _RADIUS - heights


MEASURED = {
    "forward drag": "gr810_vx_10_11-25-20_10_0_0_1",
    "drag at 30°": "gr810_vx_10_11-26-20_10_0_30_1",
    "drag at 45°": "gr810_vx_10_11-26-20_10_0_45_1",
    "roll": "gr810_vx_10_12-5-20_10_10_0_1",
}
"""The file of each run of which the sinkage was measured. The wheels of the drags roll for the first 20 cm."""


def measured_sinkage(name: str) -> tuple[Travel, Array]:
    """A run of `MEASURED` from the first contact on, and its sinkage [m], shape [n]."""
    rows = np.loadtxt(DATA / "cmu_wheel_motion" / f"{MEASURED[name]}.txt", delimiter=",")
    travelled = 1e-3 * rows[:, 0]
    depths = 1e-3 * (rows[0, 4] - rows[:, 4]) - _START_CLEARANCE
    touched = float(travelled[np.argmax(depths > 0.0)])
    at = np.arange(touched, travelled[-1], _TRAVEL_STEP)
    rim_speeds = np.interp(at, travelled, 1e-3 * rows[:, 2])
    turn = np.cumsum(rim_speeds) * _TRAVEL_STEP / (_SPEED * _RADIUS)
    yaw = np.radians(np.interp(at, travelled, rows[:, 3]))
    return Travel(travel=at - touched, yaw=yaw, turn=turn), np.interp(at, travelled, depths)


_AT = (0.09, 0.3, 0.49)
"""Travel after which the table gives the sinkage [m]."""


class _Judged(NamedTuple):
    """Of a kind of motion: ζ fitted to it alone; errors with the ζ of all states, and with that of a press."""

    own_zeta: float
    with_one_zeta: float
    with_zeta_of_press: float


_ONE_ZETA_BEFORE = 0.54
_PRESS = ("press, first 10 mm (3 recordings)", "1.00 → 1.00", "50 → 18 %", "21 → 21 %")
"""Of `cmu_wheel_press`, by `studies.learning`. Sliding does not change a press."""

_BEFORE = {
    "all": _Judged(0.54, 0.36, 0.38),
    "drag": _Judged(0.54, 0.36, 0.61),
    "brake": _Judged(0.60, 0.33, 0.42),
    "roll": _Judged(0.53, 0.36, 0.28),
    "spin": _Judged(0.48, 0.41, 0.25),
}
"""What commit 9e414115, without sliding, had."""

_SIDEWAYS = "sideways drag (measured: 64 after 640 mm)"
_SINKAGE_BEFORE = {
    "forward drag": "23, 25, 25",
    "drag at 30°": "21, 26, 26",
    "drag at 45°": "19, 27, 28",
    "roll": "14, 14, 14",
    _SIDEWAYS: "22, 31, 37",
}


def study() -> tuple[StudyResult, ...]:
    """Errors of the forces in the steady states, and measured and predicted sinkage; none where the data are absent."""
    if not DATA.is_dir():
        return ()
    return _forces(), _sinkage()


def _judged(states: SteadyStates, law: Law) -> tuple[float, dict[str, _Judged]]:
    """ζ fitted to all states, and each kind."""
    model = steady_forces(law, states)
    zeta = fitted_zeta(law, states, model)
    with_one = median_errors(states, zeta / law.zeta * model)
    of_press = median_errors(states, ZETA_OF_PRESS / law.zeta * model)
    judged = {}
    for kind in ("all", *KINDS):
        rows = of_kind(states, kind)
        own = law.zeta * float(
            (states.forces[rows] * model[rows]).sum() / (model[rows] ** 2).sum()
        )
        judged[kind] = _Judged(own, with_one[kind], of_press[kind])
    return zeta, judged


def _forces() -> StudyResult:
    states = read_states()
    one_zeta, now = _judged(states, REMEMBERED.made(1.0))
    rows = [_PRESS]
    for kind, found in now.items():
        before = _BEFORE[kind]
        rows.append(
            (
                f"{kind} ({of_kind(states, kind).sum()} states)",
                f"{before.own_zeta:.2f} → {found.own_zeta:.2f}",
                f"{100.0 * before.with_one_zeta:.0f} → {100.0 * found.with_one_zeta:.0f} %",
                f"{100.0 * before.with_zeta_of_press:.0f} → {100.0 * found.with_zeta_of_press:.0f} %",
            )
        )
    header = (
        "motion",
        "ζ of its own",
        f"error with one ζ, {_ONE_ZETA_BEFORE:.2f} → {one_zeta:.2f}",
        f"error with the ζ of a press, {ZETA_OF_PRESS:.2f}",
    )
    return StudyResult(
        name="wheel",
        title="A wheel in real sand: median error of the force, before and after sliding",
        figure=None,
        table=TextTable(header=header, rows=tuple(rows)),
    )


def _sinkage() -> StudyResult:
    law = REMEMBERED.made(ZETA_OF_PRESS)
    figure = new_figure(10.0, 3.0)
    rows: list[tuple[str, str, str, str]] = []
    for axes, name in zip(figure.subplots(1, len(MEASURED), sharey=True), MEASURED, strict=True):
        motion, measured = measured_sinkage(name)
        predicted = sinkage(law, motion)
        axes.plot(1e3 * motion.travel, 1e3 * measured, color=BLUE, label="measured")
        axes.plot(
            1e3 * motion.travel, 1e3 * predicted, color=VERMILION, ls="--", label="predicted"
        )
        label_axes(
            axes,
            x="Travel since contact [mm]",
            y="Sinkage [mm]" if not rows else "",
            title=name.capitalize(),
        )
        found = _at_travels(motion, predicted)
        rows.append((name, _at_travels(motion, measured), _SINKAGE_BEFORE[name], found))
    figure.axes[0].invert_yaxis()
    figure.axes[0].legend(fontsize=8)
    sideways = steady_travel(slip_angle=90.0, rim_speed=0.0, length=0.5)
    rows.append(
        (_SIDEWAYS, "", _SINKAGE_BEFORE[_SIDEWAYS], _at_travels(sideways, sinkage(law, sideways)))
    )
    travels = ", ".join(f"{1e3 * travel:.0f}" for travel in _AT)
    header = f"sinkage after {travels} mm [mm]", "measured", "predicted before", "now"
    return StudyResult(
        name="sinkage",
        title="A wheel that is free to sink in real sand",
        figure=figure,
        table=TextTable(header=header, rows=tuple(rows)),
    )


def _at_travels(motion: Travel, depths: Array) -> str:
    return ", ".join(f"{1e3 * depth:.0f}" for depth in np.interp(_AT, motion.travel, depths))
