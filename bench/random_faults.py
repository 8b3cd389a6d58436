"""Single faults of a random cell: what its file or one of its drivers gets wrong, and which findings name that.

Add a fault by adding an entry to `FAULTS`. A fault makes the cell's parameters wrong, or its recording, or gives None
where the cell cannot have it.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.random_cells import (
    Array,
    RandomCell,
    Recording,
    attitudes_at,
    grains_on,
    interpolated,
    law_at,
    read_by,
    tool_of,
)

MIN_EFFECT = 0.06
"""A fault that changes the expected readings by a smaller share of them is one that nobody could see."""
CHECK_RATE_HZ = 40.0
DEAD_BAND_M = 2e-5
"""Of measured poses, whose noise would release the force that is held at rest."""
MIN_LIFT_S = 0.2
"""Time in the air between two pushes in which another TCP can be chosen."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """The parameters that a file says, and what the drivers send. `true`: what they should say, where that changed."""

    parameters: dict[str, Any]
    recording: Recording
    true: dict[str, Any] = field(default_factory=dict)


Made = Callable[[RandomCell, np.random.Generator], Setup | None]


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault: how it is made, and the names of the findings that name it."""

    made: Made
    causes: Collection[str]


def right(cell: RandomCell) -> Setup:
    """The cell as it is."""
    return Setup(parameters=cell.parameters, recording=cell.recording)


def fits(setup: Setup) -> float:
    """The share of the measured wrench that the set-up does not explain, with the strength that suits it best.

    It is computed by the load cell of `random_cells`, and not by the package's judge.
    """
    parameters = setup.parameters
    sent = setup.recording
    step = max(round(len(sent.time) / (sent.time[-1] - sent.time[0]) / CHECK_RATE_HZ), 1)
    time = sent.time[::step]
    rotation = Rotation.from_quat(sent.poses[::step, 3:])
    law = law_at("treers2021", zeta=parameters["medium.zeta"], mobilization_length=0.003)
    grains = grains_on(
        tool_of(parameters),
        time,
        sent.poses[::step, :3],
        rotation,
        law,
        surface=parameters["surface_height"],
        dead_band=DEAD_BAND_M,
    )
    lever = 0.05 + float(np.linalg.norm(parameters["sensor.position"]))
    scale = np.repeat((1.0, 1.0 / lever), 3)
    measured = interpolated(time + parameters["sensor.delay"], sent.wrench_time, sent.wrenches)
    # where a recording begins in the grains their memory is not known at first
    rows = time > time[0] + 1.0
    empty = scale * read_by(parameters, rotation, np.zeros_like(grains))[rows]
    of_grains = scale * read_by(parameters, rotation, grains)[rows] - empty
    rest = scale * measured[rows] - empty
    size = float((of_grains**2).sum())
    strength = float((of_grains * rest).sum()) / size if size > 0.0 else 1.0
    left = rest - np.clip(strength, 0.6, 1.6) * of_grains
    return float(np.sqrt((left**2).sum() / max((rest**2).sum(), 1e-12)))


def is_visible(cell: RandomCell, faulty: Setup) -> bool:
    """Whether the fault changes what the file would have predicted."""
    return fits(faulty) ** 2 - fits(right(cell)) ** 2 > MIN_EFFECT**2


def _in_file(cell: RandomCell, **changes: Any) -> Setup:
    """Other values in the file; names with __ for dots."""
    named = {name.replace("__", "."): value for name, value in changes.items()}
    return Setup(parameters={**cell.parameters, **named}, recording=cell.recording)


def _sent(cell: RandomCell, **changes: Any) -> Setup:
    """Something else in the recording."""
    return Setup(parameters=cell.parameters, recording=replace(cell.recording, **changes))


def _read(cell: RandomCell, changed: Callable[[Array], Array]) -> Setup:
    """Readings changed by the driver, which gets them without their bias."""
    bias = np.array(cell.parameters["sensor.bias"])
    return _sent(cell, wrenches=changed(cell.recording.wrenches - bias) + bias)


def _posed(cell: RandomCell, position: Array, rotation: Rotation) -> Setup:
    return Setup(parameters=cell.parameters, recording=cell.recording.posed(position, rotation))


def _attitudes(cell: RandomCell) -> Rotation:
    """The true attitudes of the tool at the moments of the readings."""
    sent = cell.recording
    moments = sent.wrench_time - cell.parameters["sensor.delay"]
    return attitudes_at(moments, sent.time, sent.rotations)


def _direction(random: np.random.Generator) -> Array:
    axis = random.standard_normal(3)
    return np.asarray(axis / np.linalg.norm(axis))


def _turned(quaternion: Any, turn: Rotation) -> tuple[float, ...]:
    return tuple((Rotation.from_quat(quaternion) * turn).as_quat().tolist())


def _sign(cell: RandomCell, _random: np.random.Generator) -> Setup:
    return _in_file(cell, sensor__sign=-cell.parameters["sensor.sign"])


def _axes(cell: RandomCell, random: np.random.Generator, *, degrees: float) -> Setup:
    """About one of the load cell's axes."""
    axis = np.eye(3)[random.integers(3)]
    turn = Rotation.from_rotvec(np.radians(degrees) * axis)
    return _in_file(cell, sensor__quaternion=_turned(cell.parameters["sensor.quaternion"], turn))


def _axes_swapped(cell: RandomCell, random: np.random.Generator) -> Setup:
    turn = Rotation.from_rotvec(np.radians(120.0) / np.sqrt(3.0) * random.choice((-1.0, 1.0), 3))
    return _in_file(cell, sensor__quaternion=_turned(cell.parameters["sensor.quaternion"], turn))


def _angle(cell: RandomCell, random: np.random.Generator, *, low: float, high: float) -> Setup:
    turn = Rotation.from_rotvec(np.radians(random.uniform(low, high)) * _direction(random))
    return _in_file(cell, sensor__quaternion=_turned(cell.parameters["sensor.quaternion"], turn))


def _mirrored(cell: RandomCell, random: np.random.Generator) -> Setup:
    axes = np.ones(6)
    axis = int(random.integers(3))
    axes[[axis, axis + 3]] = -1.0
    return _read(cell, lambda wrenches: wrenches * axes)


def _sign_and_axes(cell: RandomCell, random: np.random.Generator) -> Setup:
    turned = _axes(cell, random, degrees=float(random.choice((90.0, 180.0))))
    sign = -cell.parameters["sensor.sign"]
    return replace(turned, parameters={**turned.parameters, "sensor.sign": sign})


def _lever(cell: RandomCell, random: np.random.Generator, *, metres: float) -> Setup:
    place = np.array(cell.parameters["sensor.position"]) + metres * _direction(random)
    return _in_file(cell, sensor__position=tuple(place.tolist()))


def _bias(cell: RandomCell, random: np.random.Generator, *, share: float) -> Setup:
    off = np.zeros(6)
    off[:3] = max(share * cell.peak, 1.0) * _direction(random)
    bias = np.array(cell.parameters["sensor.bias"]) + off
    return _in_file(cell, sensor__bias=tuple(bias.tolist()))


def _mass(cell: RandomCell, _random: np.random.Generator) -> Setup:
    true = cell.parameters["sensor.mass"]
    given = 0.0 if true > 0.3 else true + 0.8
    return _in_file(cell, sensor__mass=given)


def _center(cell: RandomCell, random: np.random.Generator) -> Setup | None:
    if cell.parameters["sensor.mass"] < 0.5:
        return None
    center = np.array(cell.parameters["sensor.center_of_mass"]) + 0.1 * _direction(random)
    return _in_file(cell, sensor__center_of_mass=tuple(center.tolist()))


def _payload(cell: RandomCell, _random: np.random.Generator) -> Setup | None:
    """The driver subtracts a weight that is not there."""
    if cell.parameters["sensor.mass"] > 0.0 or cell.turns == "none":
        return None
    none = np.zeros_like(cell.recording.wrenches)
    weight = read_by({**cell.parameters, "sensor.mass": 0.9}, _attitudes(cell), none)
    return _read(cell, lambda wrenches: wrenches - (weight - cell.parameters["sensor.bias"]))


def _delay(cell: RandomCell, _random: np.random.Generator, *, seconds: float) -> Setup:
    late = _sent(cell, wrench_time=cell.recording.wrench_time + seconds)
    return replace(late, true={"sensor.delay": cell.parameters["sensor.delay"] + seconds})


def _surface(cell: RandomCell, _random: np.random.Generator, *, metres: float) -> Setup:
    return _in_file(cell, surface_height=cell.parameters["surface_height"] + metres)


def _unit_of_mesh(cell: RandomCell, _random: np.random.Generator, *, factor: float) -> Setup:
    return _in_file(cell, mesh__scale=0.001 * factor)


def _mesh_turned(
    cell: RandomCell, _random: np.random.Generator, *, axis: str, degrees: float
) -> Setup | None:
    if cell.tool == "sphere":  # a turned sphere is one that is elsewhere
        return None
    turn = Rotation.from_euler(axis, degrees, degrees=True)
    return _in_file(cell, mesh__quaternion=_turned(cell.parameters["mesh.quaternion"], turn))


def _tcp(cell: RandomCell, _random: np.random.Generator) -> Setup:
    """The poses are those of the mesh's lower end, and the file says otherwise."""
    x, y, z = cell.parameters["mesh.origin"]
    heights = 1e3 * tool_of({"mesh.file": cell.tool}).vertices[:, 2]
    far = float(np.ptp(heights))
    return _in_file(cell, mesh__origin=(x, y, z + (far if far > 10.0 else 30.0)))


def _w_first(cell: RandomCell, _random: np.random.Generator) -> Setup:
    poses = cell.recording.poses.copy()
    poses[:, 3:] = np.roll(poses[:, 3:], 1, axis=1)
    return _sent(cell, poses=poses)


def _world(cell: RandomCell, turn: Rotation, random: np.random.Generator) -> Setup:
    """Poses in a turned frame, whose origin is the arm's, or below the tool at the surface."""
    sent = cell.recording
    pivot = np.zeros(3)
    if random.random() < 0.5:
        pivot = np.append(sent.poses[0, :2], cell.parameters["surface_height"])
    position = turn.apply(sent.poses[:, :3] - pivot) + pivot
    made = _posed(cell, position, turn * sent.rotations)
    if sent.twists is None:
        return made
    twists = np.hstack([turn.apply(sent.twists[:, :3]), turn.apply(sent.twists[:, 3:])])
    return replace(made, recording=replace(made.recording, twists=twists))


def _world_turned(cell: RandomCell, random: np.random.Generator, *, degrees: float) -> Setup:
    axis = "xy"[random.integers(2)]
    return _world(cell, Rotation.from_euler(axis, degrees, degrees=True), random)


def _world_tilted(cell: RandomCell, random: np.random.Generator) -> Setup:
    way = random.uniform(-np.pi, np.pi)
    tilt = np.radians(random.uniform(10.0, 30.0))
    turn = Rotation.from_rotvec(tilt * np.array((np.cos(way), np.sin(way), 0.0)))
    return _world(cell, turn, random)


def _other_axes(cell: RandomCell, _random: np.random.Generator) -> Setup:
    """The reading is in world axes where the file says those of the load cell, or the other way round."""
    to_world = _attitudes(cell) * Rotation.from_quat(cell.parameters["sensor.quaternion"])
    turn = to_world.inv() if cell.parameters["sensor.frame_source"] == "world" else to_world
    wrenches = cell.recording.wrenches
    # the driver turns the whole reading, with its bias
    turned = np.hstack([turn.apply(wrenches[:, :3]), turn.apply(wrenches[:, 3:])])
    return _sent(cell, wrenches=turned)


def _units(
    cell: RandomCell, _random: np.random.Generator, *, force: float, torque: float
) -> Setup:
    return _read(cell, lambda wrenches: wrenches * np.repeat((force, torque), 3))


def _main_axis(cell: RandomCell) -> int:
    """The axis of the load cell that feels most of the grains' force."""
    force = cell.recording.wrenches[:, :3]
    return int(np.argmax(np.abs(force - force[0]).max(axis=0)))


def _dead(cell: RandomCell, _random: np.random.Generator) -> Setup:
    axes = np.ones(6)
    axes[_main_axis(cell)] = 0.0
    return _read(cell, lambda wrenches: wrenches * axes)


def _saturated(cell: RandomCell, _random: np.random.Generator, *, share: float) -> Setup:
    axis = _main_axis(cell)
    wrenches = cell.recording.wrenches.copy()
    begin = wrenches[0, axis]
    most = share * np.abs(wrenches[:, axis] - begin).max()
    wrenches[:, axis] = np.clip(wrenches[:, axis], begin - most, begin + most)
    return _sent(cell, wrenches=wrenches)


def _moving_zero(cell: RandomCell, random: np.random.Generator, *, is_drift: bool) -> Setup:
    time = cell.recording.wrench_time
    share = (time - time[0]) / (time[-1] - time[0])
    course = share if is_drift else (share > random.uniform(0.2, 0.8)).astype(float)
    off = max(0.15 * cell.peak, 1.0) * _direction(random)
    wrenches = cell.recording.wrenches.copy()
    wrenches[:, :3] += course[:, None] * off
    return _sent(cell, wrenches=wrenches)


def _friction(cell: RandomCell, _random: np.random.Generator) -> Setup:
    """A seal holds the tool: the reading has a share that follows the vertical velocity's sign."""
    sent = cell.recording
    sinking = np.gradient(sent.poses[:, 2], sent.time)
    way = np.sign(np.where(np.abs(sinking) > 2e-3, sinking, 0.0))
    moments = sent.wrench_time - cell.parameters["sensor.delay"]
    force = np.zeros((len(moments), 6))
    force[:, 2] = -0.15 * cell.peak * np.interp(moments, sent.time, way)
    bare = {**cell.parameters, "sensor.mass": 0.0, "sensor.position": (0.0, 0.0, 0.0)}
    more = read_by(bare, _attitudes(cell), force) - bare["sensor.bias"]
    return _sent(cell, wrenches=sent.wrenches + more)


def _filter(cell: RandomCell, _random: np.random.Generator, *, seconds: float) -> Setup:
    wrenches = cell.recording.wrenches.copy()
    step = float(np.median(np.diff(cell.recording.wrench_time)))
    share = 1.0 - np.exp(-step / seconds)
    for k in range(1, len(wrenches)):
        wrenches[k] = wrenches[k - 1] + share * (wrenches[k] - wrenches[k - 1])
    true = {"sensor.delay": cell.parameters["sensor.delay"] + seconds}
    return replace(_sent(cell, wrenches=wrenches), true=true)


def _yielding(cell: RandomCell, random: np.random.Generator) -> Setup:
    """Poses as commanded, which the arm misses by its force over its stiffness."""
    sent = cell.recording
    yields = float(random.uniform(0.0015, 0.006))
    force = interpolated(sent.time, cell.force_time, cell.grains)[:, :3]
    position = sent.poses[:, :3] - yields / cell.peak * force
    return _posed(cell, position, sent.rotations)


def _not_turning(cell: RandomCell, _random: np.random.Generator) -> Setup:
    """The tool's frame keeps its first attitude."""
    poses = cell.recording.poses.copy()
    poses[:, 3:] = poses[0, 3:]
    twists = cell.recording.twists
    if twists is not None:
        twists = twists * np.repeat((1.0, 0.0), 3)
    return _sent(cell, poses=poses, twists=twists)


def _repeated(cell: RandomCell, _random: np.random.Generator) -> Setup | None:
    sent = cell.recording
    if len(sent.time) < 80.0 * (sent.time[-1] - sent.time[0]):
        return None
    rows = np.arange(len(sent.time)) // 5 * 5
    return _sent(cell, poses=sent.poses[rows])


def _jumped(cell: RandomCell, random: np.random.Generator) -> Setup | None:
    """Another TCP is chosen on the arm between two pushes."""
    pushed = np.flatnonzero(np.abs(cell.grains[:, :3]).max(axis=1) > 0.0)
    gaps = np.diff(pushed)
    if len(gaps) == 0:
        return None
    last = pushed[gaps.argmax()]
    leaves = cell.force_time[last]
    returns = cell.force_time[last + gaps.max()]
    if returns - leaves < MIN_LIFT_S:
        return None
    at = 0.5 * (leaves + returns)
    sent = cell.recording
    far = sent.rotations.apply(0.06 * _direction(random))
    position = sent.poses[:, :3] + np.where(sent.time > at, 1.0, 0.0)[:, None] * far
    return _posed(cell, position, sent.rotations)


def _in_millimetres(cell: RandomCell, _random: np.random.Generator) -> Setup:
    return _posed(cell, 1e3 * cell.recording.poses[:, :3], cell.recording.rotations)


def _noisy(cell: RandomCell, random: np.random.Generator) -> Setup:
    poses = cell.recording.poses
    return _posed(
        cell,
        poses[:, :3] + 2e-4 * random.standard_normal((len(poses), 3)),
        cell.recording.rotations,
    )


def _fault(made: Callable[..., Setup | None], *causes: str, **options: Any) -> Fault:
    return Fault(made=partial(made, **options), causes=frozenset(causes))


_AXES = ("turn", "angle", "sensor.quaternion")
# an axis that is mirrored in force and torque is one whose sign is wrong in a cell turned by 180 degrees
_SIGN_AND_AXES = ("sign and turn", "sign and quaternion")
_MESH = ("mesh turned", "mesh.quaternion")
_WORLD = ("world frame",)
_SURFACE = ("surface_height",)
_BIAS = ("load cell", "bias", "sensor.bias")
_WEIGHT = ("load cell", "mass", "sensor.mass", "payload", "sensor.center_of_mass")
_DELAY = ("delay", "sensor.delay")
_UNIT = ("strength", "mesh", "mesh.scale")
_ZERO = ("zero that moves",)
_CUT = ("saturation", "dead axis")

FAULTS: dict[str, Fault] = {
    "sign": _fault(_sign, "sign", "sensor.sign"),
    "axes 90": _fault(_axes, *_AXES, degrees=90.0),
    "axes -90": _fault(_axes, *_AXES, degrees=-90.0),
    "axes 180": _fault(_axes, *_AXES, degrees=180.0),
    "axes swapped": _fault(_axes_swapped, *_AXES),
    "axes 20 to 40": _fault(_angle, *_AXES, low=20.0, high=40.0),
    "axes 40 to 150": _fault(_angle, *_AXES, low=40.0, high=150.0),
    "mirrored": _fault(_mirrored, *_SIGN_AND_AXES),
    "sign and axes": _fault(_sign_and_axes, *_SIGN_AND_AXES),
    "lever 60 mm": _fault(_lever, "lever", "sensor.position", metres=0.06),
    "lever 150 mm": _fault(_lever, "lever", "sensor.position", metres=0.15),
    "bias 8 %": _fault(_bias, *_BIAS, share=0.08),
    "bias 30 %": _fault(_bias, *_BIAS, share=0.3),
    "mass": _fault(_mass, *_WEIGHT, *_BIAS),
    "centre of mass": _fault(_center, *_WEIGHT, *_BIAS),
    "payload": _fault(_payload, *_WEIGHT, *_BIAS),
    "delay 40 ms": _fault(_delay, *_DELAY, seconds=0.04),
    "delay 80 ms": _fault(_delay, *_DELAY, seconds=0.08),
    "delay 150 ms": _fault(_delay, *_DELAY, seconds=0.15),
    "delay 350 ms": _fault(_delay, *_DELAY, seconds=0.35),
    "delay -80 ms": _fault(_delay, *_DELAY, seconds=-0.08),
    "surface +15 mm": _fault(_surface, *_SURFACE, metres=0.015),
    "surface -15 mm": _fault(_surface, *_SURFACE, metres=-0.015),
    "surface +60 mm": _fault(_surface, *_SURFACE, metres=0.06),
    "surface -60 mm": _fault(_surface, *_SURFACE, metres=-0.06),
    "mesh in metres": _fault(_unit_of_mesh, *_UNIT, factor=1e3),
    "mesh in micrometres": _fault(_unit_of_mesh, *_UNIT, factor=1e-3),
    "mesh in inches": _fault(_unit_of_mesh, *_UNIT, factor=25.4),
    "mesh upside down": _fault(_mesh_turned, *_MESH, axis="x", degrees=180.0),
    "mesh turned x": _fault(_mesh_turned, *_MESH, axis="x", degrees=90.0),
    "mesh turned y": _fault(_mesh_turned, *_MESH, axis="y", degrees=-90.0),
    "TCP at the mesh's end": _fault(_tcp, "TCP", "mesh.origin", *_SURFACE),
    "w first": _fault(_w_first, "quaternions"),
    "world upside down": _fault(_world_turned, *_WORLD, degrees=180.0),
    "world of a wall": _fault(_world_turned, *_WORLD, degrees=90.0),
    "world tilted": _fault(_world_tilted, *_WORLD),
    "reading in other axes": _fault(_other_axes, "axes of the reading", "sensor.frame_source"),
    "torque in N mm": _fault(_units, "units of torque", "torque", force=1.0, torque=1e3),
    "kgf": _fault(_units, *_UNIT, force=1.0 / 9.80665, torque=1.0 / 9.80665),
    "kN": _fault(_units, *_UNIT, force=1e-3, torque=1e-3),
    "dead axis": _fault(_dead, *_CUT),
    "saturated": _fault(_saturated, *_CUT, share=0.5),
    "step of the zero": _fault(_moving_zero, *_ZERO, is_drift=False),
    "drift of the zero": _fault(_moving_zero, *_ZERO, is_drift=True),
    "friction": _fault(_friction, *_ZERO, "friction"),
    "filter 100 ms": _fault(_filter, *_DELAY, "filter", seconds=0.1),
    "yielding arm": _fault(_yielding, "yielding arm", "stiffness"),
    "frame does not turn": _fault(_not_turning, "frame does not turn"),
    "repeated poses": _fault(_repeated, "repeated poses"),
    "another TCP": _fault(_jumped, "jump", "jumped pose", "another TCP"),
    "poses in mm": _fault(_in_millimetres, "units"),
    "noisy poses": _fault(_noisy, "noise"),
}


def faulty(cell: RandomCell, name: str) -> Setup | None:
    """The cell with one fault; None if it cannot have it, or if nobody could see it."""
    random = np.random.default_rng((cell.seed, list(FAULTS).index(name)))
    made = FAULTS[name].made(cell, random)
    if made is None:
        return None
    of_drivers = ("repeated poses", "noisy poses")
    return made if name in of_drivers or is_visible(cell, made) else None
