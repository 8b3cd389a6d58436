"""Random robot cells and what each would record: an arm moves a tool in the air and in grains, under a load cell.

The motion and the load cell are modelled here on their own, so that a fault in the package's own transforms shows. The
grains' force is the package's law, the second law, or one that no parameter of the package gives.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rft_ros.rft import (
    MEDIA,
    Law,
    Memory,
    alpha_y_model,
    checked_states,
    displacements_followed,
    law_named,
    wrenches_in_time,
)
from rft_ros.tool import Tool, load_tool

Array = NDArray[np.float64]
Motion = Literal["press", "drag", "roll", "dig", "tilt"]
Turns = Literal["none", "before", "on the way down"]
Forces = Literal["model", "second law", "power of depth", "turned by 2 degrees"]

TOOLS = ("ellipsoid", "plate", "abb_plate", "root_tip", "scoop", "sphere")
MOTIONS: tuple[Motion, ...] = get_args(Motion)
TURNS: tuple[Turns, ...] = get_args(Turns)
FORCES: tuple[Forces, ...] = get_args(Forces)

GRAVITY_M_S2 = 9.80665
FORCE_RATE_HZ = 1000.0
"""Rate at which the force of the grains is computed; it is interpolated between. At 100 Hz it was late by 5 ms."""
MIN_RAMP_S = 0.05
MAX_RAMP_S = 0.5
"""Time in which a movement starts or stops: of industrial arms, and of slow smooth ones."""
MIN_PEAK_N = 3.0
MAX_PEAK_N = 400.0


@dataclass(frozen=True, kw_only=True)
class Recording:
    """What the drivers send.

    `time` [s] and `poses`, position [m] and quaternion xyzw, shape [n, 7]; `twists` [m/s, rad/s], shape [n, 6], or
    None; `wrench_time`, the load cell's stamps [s], and `wrenches` [N, N m], shape [m, 6].
    """

    time: Array
    poses: Array
    twists: Array | None
    wrench_time: Array
    wrenches: Array

    @property
    def rotations(self) -> Rotation:
        """The n attitudes of the tool frame."""
        return Rotation.from_quat(self.poses[:, 3:])

    def posed(self, position: Array, rotation: Rotation) -> "Recording":
        """The same readings at other poses."""
        return replace(self, poses=np.hstack([position, rotation.as_quat()]))


@dataclass(frozen=True, kw_only=True)
class RandomCell:
    """A right cell: the node's `parameters`, its `recording`, and what the grains and the load cell truly were.

    `force_time` [s], shape [k], and `grains` [N, N m], shape [k, 6]: their wrench about the tool frame's origin in
    world axes. `true_zeta`: 0 if the force is not the model's. `noise`: of the measured force [N].
    """

    seed: int
    tool: str
    motion: Motion
    turns: Turns
    forces: Forces
    begins_in_grains: bool
    parameters: dict[str, Any]
    recording: Recording
    force_time: Array
    grains: Array
    true_zeta: float
    noise: float

    @property
    def title(self) -> str:
        """In words."""
        begins = ", begins in the grains" if self.begins_in_grains else ""
        turns = "" if self.turns == "none" else f", turns {self.turns}"
        return f"{self.tool} {self.motion}, {self.forces}{turns}{begins}"

    @property
    def peak(self) -> float:
        """The greatest force of the grains [N]."""
        return float(np.linalg.norm(self.grains[:, :3], axis=1).max())


@dataclass(frozen=True)
class Leg:
    """A straight movement from rest to rest: how far the tool's centre goes [m], and how it turns meanwhile [rad].

    `ramp`: the time in which it starts, and in which it stops [s].
    """

    seconds: float
    move: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ramp: float = MIN_RAMP_S


def random_cell(seed: int) -> RandomCell:
    """The right cell of a seed. A draw whose force is too small or too great to matter is repeated."""
    random = np.random.default_rng(seed)
    while True:
        cell = _drawn(seed, random)
        if MIN_PEAK_N <= cell.peak <= MAX_PEAK_N:
            return cell


@lru_cache(maxsize=32)
def _loaded(
    mesh: str, scale: float, origin: tuple[float, ...], quaternion: tuple[float, ...]
) -> Tool:
    return load_tool(mesh, scale=scale, origin=origin, quaternion=quaternion)


def tool_of(parameters: dict[str, Any]) -> Tool:
    """The tool of a cell's parameters."""
    return _loaded(
        parameters["mesh.file"],
        float(parameters.get("mesh.scale", 0.0)),
        tuple(parameters.get("mesh.origin", (0.0, 0.0, 0.0))),
        tuple(parameters.get("mesh.quaternion", (0.0, 0.0, 0.0, 1.0))),
    )


def law_at(name: str, *, zeta: float, mobilization_length: float) -> Law:
    medium = MEDIA["generic"]
    alpha_y = alpha_y_model("linear", medium)
    return law_named(name, medium, alpha_y, zeta=zeta, mobilization_length=mobilization_length)


def _states(time: Array, position: Array, rotation: Rotation) -> Array:
    """Checked states along poses, with the velocities between them; shape [n, 13]."""
    states = np.zeros((len(time), 13))
    states[:, :3] = position
    states[:, 3:7] = rotation.as_quat()
    steps = np.diff(time)[:, None]
    states[1:, 7:10] = np.diff(position, axis=0) / steps
    states[1:, 10:] = (rotation[1:] * rotation[:-1].inv()).as_rotvec() / steps
    return checked_states(states)


def grains_on(
    tool: Tool,
    time: Array,
    position: Array,
    rotation: Rotation,
    law: Law,
    *,
    surface: float,
    dead_band: float = 0.0,
) -> Array:
    """The wrench of the grains about the tool frame's origin in world axes, shape [n, 6].

    `dead_band`: movements below it are noise of the poses [m]; a true path has none.
    """
    states = _states(time, position, rotation)
    return wrenches_in_time(
        tool.plates,
        law,
        states,
        Memory(tool.plates),
        displacements=displacements_followed(states, reach=tool.plates.reach, dead_band=dead_band),
        surface_height=surface,
    )[:, :6].copy()


def read_by(parameters: dict[str, Any], rotation: Rotation, grains: Array) -> Array:
    """What the driver of the load cell sends at n attitudes of the tool under wrenches of the grains, shape [n, 6]."""
    to_world = rotation * Rotation.from_quat(parameters["sensor.quaternion"])
    weight = np.tile((0.0, 0.0, -GRAVITY_M_S2 * parameters["sensor.mass"]), (len(grains), 1))
    lever = rotation.apply(parameters["sensor.position"])
    center = to_world.apply(parameters["sensor.center_of_mass"])
    force = to_world.inv().apply(grains[:, :3] + weight)
    torque = grains[:, 3:] - np.cross(lever, grains[:, :3]) + np.cross(center, weight)
    torque = to_world.inv().apply(torque)
    on_tool = np.hstack([force, torque])
    reading = parameters["sensor.sign"] * on_tool + parameters["sensor.bias"]
    if parameters["sensor.frame_source"] != "world":
        return np.asarray(reading)
    # the driver turns the whole reading, with its bias
    return np.hstack([to_world.apply(reading[:, :3]), to_world.apply(reading[:, 3:])])


def interpolated(at: Array, time: Array, values: Array) -> Array:
    """Columns of values at other times, shape [m, k]."""
    return np.column_stack([np.interp(at, time, column) for column in values.T])


def attitudes_at(at: Array, time: Array, rotation: Rotation) -> Rotation:
    """Attitudes at other times, each between its two neighbours."""
    index = np.clip(np.searchsorted(time, at) - 1, 0, len(time) - 2)
    share = np.clip((at - time[index]) / (time[index + 1] - time[index]), 0.0, 1.0)
    step = (rotation[index].inv() * rotation[index + 1]).as_rotvec()
    return rotation[index] * Rotation.from_rotvec(share[:, None] * step)


def _course(share: Array, leg: Leg) -> Array:
    """How much of a leg is done at shares of its time."""
    ramp = min(leg.ramp / leg.seconds, 0.4)
    up = share**2 / (2.0 * ramp)
    down = 1.0 - ramp - (1.0 - share) ** 2 / (2.0 * ramp)
    even = np.where(share < ramp, up, np.where(share > 1.0 - ramp, down, share - 0.5 * ramp))
    return np.asarray(even / (1.0 - ramp))


def along(
    legs: list[Leg], time: Array, position: Array, rotation: Rotation
) -> tuple[Array, Rotation]:
    """Places of the tool's centre, shape [n, 3], and its attitudes, from the given ones on."""
    ends = np.cumsum([leg.seconds for leg in legs])
    places = np.empty((len(time), 3))
    turns = np.empty((len(time), 4))
    begin = 0.0
    for leg, end in zip(legs, ends, strict=True):
        rows = (time >= begin) & (time <= end + 1e-9) if leg is not legs[-1] else time >= begin
        share = np.clip((time[rows] - begin) / leg.seconds, 0.0, 1.0)
        done = _course(share, leg)[:, None]
        places[rows] = position + done * leg.move
        if rows.any():
            turns[rows] = (Rotation.from_rotvec(done * leg.turn) * rotation).as_quat()
        position = position + np.array(leg.move)
        rotation = Rotation.from_rotvec(leg.turn) * rotation
        begin = float(end)
    return places, Rotation.from_quat(turns)


def _drawn(seed: int, random: np.random.Generator) -> RandomCell:
    """One draw of a cell; its force may be too small or too great."""
    name = str(random.choice(TOOLS))
    motion: Motion = MOTIONS[random.integers(len(MOTIONS))]
    turns: Turns = TURNS[random.choice(3, p=(0.4, 0.3, 0.3))]
    forces: Forces = FORCES[random.integers(len(FORCES))]
    begins_in_grains = bool(random.random() < 0.12)
    surface = round(float(random.uniform(-0.2, 0.3)), 3)
    mesh = load_mesh(name, random)
    tool = tool_of(mesh)
    in_tool = Rotation.from_quat(mesh["mesh.quaternion"])

    yaw = Rotation.from_euler("z", random.uniform(-np.pi, np.pi))
    leaning = Rotation.from_rotvec((*random.uniform(-0.3, 0.3, 2), 0.0))
    of_mesh = leaning * yaw
    of_tool = of_mesh * in_tool.inv()
    center = tool.vertices.min(axis=0) + 0.5 * np.ptp(tool.vertices, axis=0)
    legs, entered = _legs(random, motion, turns, tool)
    lowest = float(of_tool.apply(tool.vertices - center)[:, 2].min())
    begin = np.array((*random.uniform(-0.5, 0.5, 2), surface - lowest + _clearance(turns, tool)))

    rate = float(random.choice((50.0, 62.5, 100.0, 125.0, 200.0)))
    seconds = sum(leg.seconds for leg in legs)
    first = entered if begins_in_grains else 0.0
    time = np.arange(first, seconds, 1.0 / rate)
    force_time = np.arange(0.0, seconds, 1.0 / FORCE_RATE_HZ)
    wrench_rate = float(random.choice((rate, 100.0, 125.0, 250.0)))
    moments = np.arange(
        first + random.uniform(0.0, 1.0 / wrench_rate), seconds - 0.02, 1.0 / wrench_rate
    )

    def poses(at: Array) -> tuple[Array, Rotation]:
        places, attitudes = along(legs, at, begin, of_tool)
        return places - attitudes.apply(center), attitudes

    zeta = float(np.exp(random.uniform(np.log(0.3), np.log(1.5))))
    length = float(random.uniform(0.002, 0.0045))
    position, rotation = poses(force_time)
    grains, given_zeta = _forces(
        random,
        forces,
        tool,
        force_time,
        position,
        rotation,
        zeta=zeta,
        length=length,
        surface=surface,
    )
    parameters = {
        **mesh,
        **_load_cell(random),
        "medium.zeta": given_zeta,
        "surface_height": surface,
        "twist_source": "pose_difference" if random.random() < 0.7 else "topic",
    }
    noise = float(max(0.02, random.uniform(0.0005, 0.002) * np.abs(grains[:, :3]).max()))
    lever = 0.02 + 0.05 * float(np.linalg.norm(parameters["sensor.position"]))
    _, attitudes = poses(moments)
    wrenches = read_by(parameters, attitudes, interpolated(moments, force_time, grains))
    wrenches += noise * random.standard_normal(wrenches.shape) * np.repeat((1.0, lever), 3)
    delay = parameters["sensor.delay"]
    places, attitudes = poses(time)
    exact = _states(time, places, attitudes)[:, 7:]
    pose_noise = float(random.choice((0.0, 1e-6, 5e-6)))
    recording = Recording(
        time=time - first + 1.0,
        poses=np.hstack(
            [places + pose_noise * random.standard_normal(places.shape), attitudes.as_quat()]
        ),
        twists=exact if parameters["twist_source"] == "topic" else None,
        wrench_time=moments + delay - first + 1.0,
        wrenches=wrenches,
    )
    return RandomCell(
        seed=seed,
        tool=name,
        motion=motion,
        turns=turns,
        forces=forces,
        begins_in_grains=begins_in_grains,
        parameters=parameters,
        recording=recording,
        force_time=force_time - first + 1.0,
        grains=grains,
        true_zeta=zeta if forces == "model" else 0.0,
        noise=noise,
    )


def load_mesh(name: str, random: np.random.Generator) -> dict[str, Any]:
    """Where the tool frame lies in the mesh: often at its origin, as a flange with z down, or anywhere."""
    way = random.random()
    turn = Rotation.identity()
    origin = (0.0, 0.0, 0.0)
    if way > 0.35:
        turn = Rotation.from_euler("x", 180.0, degrees=True)
        origin = (0.0, 0.0, float(round(random.uniform(0.0, 120.0), 1)))
    if way > 0.75:
        turn = Rotation.random(random_state=random)
        origin = tuple(np.round(random.uniform(-40.0, 40.0, 3), 1).tolist())
    quaternion = tuple(turn.as_quat().tolist())
    return {"mesh.file": name, "mesh.origin": origin, "mesh.quaternion": quaternion}


def _load_cell(random: np.random.Generator) -> dict[str, Any]:
    """Any mount, lever and sign."""
    group = Rotation.create_group("O")
    turn = group[int(random.integers(24))]
    if random.random() < 0.5:
        turn = Rotation.random(random_state=random)
    mass = float(random.choice((0.0, round(float(random.uniform(0.1, 2.0)), 3))))
    in_world = bool(random.random() < 0.1)
    bias = np.zeros(6)
    if random.random() < 0.5 and not in_world:
        bias = np.hstack([random.uniform(-8.0, 8.0, 3), random.uniform(-0.3, 0.3, 3)])
    delay = 0.0 if random.random() < 0.5 else float(round(random.uniform(0.0, 0.03), 4))
    return {
        "sensor.position": tuple(np.round(random.uniform(-0.12, 0.12, 3), 3).tolist()),
        "sensor.quaternion": tuple(turn.as_quat().tolist()),
        "sensor.sign": float(random.choice((-1.0, 1.0))),
        "sensor.mass": mass,
        "sensor.center_of_mass": tuple(
            np.round(random.uniform(-0.05, 0.05, 3) * (mass > 0.0), 3).tolist()
        ),
        "sensor.bias": tuple(np.round(bias, 3).tolist()),
        "sensor.delay": delay,
        "sensor.frame_source": "world" if in_world else "parameters",
    }


def _clearance(turns: Turns, tool: Tool) -> float:
    """How high over the surface the tool's lowest point begins [m], so that no turn reaches the grains."""
    return 0.02 if turns == "none" else 0.02 + float(np.linalg.norm(np.ptp(tool.vertices, axis=0)))


def _legs(
    random: np.random.Generator, motion: Motion, turns: Turns, tool: Tool
) -> tuple[list[Leg], float]:
    """The legs of a motion, and a time near the end of the way down [s]."""
    size = float(np.linalg.norm(np.ptp(tool.vertices, axis=0)))
    air = _clearance(turns, tool)
    speed = float(random.uniform(0.01, 0.03))
    spin = np.radians(float(random.uniform(10.0, 25.0)))
    depth = float(random.uniform(0.012, 0.035))
    yaw = float(random.uniform(-np.pi, np.pi))
    ahead = np.array((np.cos(yaw), np.sin(yaw), 0.0))
    aside = np.array((-np.sin(yaw), np.cos(yaw), 0.0))

    def ramp() -> float:
        return float(random.uniform(MIN_RAMP_S, MAX_RAMP_S))

    def going(*move: float) -> Leg:
        x, y, z = move
        seconds = max(float(np.linalg.norm(move)) / speed, 0.2)
        return Leg(seconds, (x, y, z), ramp=ramp())

    def turning(turn: Array, move: Array | None = None) -> Leg:
        x, y, z = turn.tolist()
        far = np.zeros(3) if move is None else move
        slowest = max(np.linalg.norm(turn) / spin, np.linalg.norm(far) / speed, 0.2)
        a, b, c = far.tolist()
        return Leg(float(slowest), (a, b, c), (x, y, z), ramp=ramp())

    def rest() -> list[Leg]:
        return [Leg(float(random.uniform(0.4, 1.2)))] if random.random() < 0.7 else []

    legs = [Leg(float(random.uniform(0.8, 2.0)))]
    down = air
    if turns != "none":
        axis = np.array((*random.standard_normal(2), 0.0))
        tip = np.radians(random.uniform(15.0, 60.0)) * axis / np.linalg.norm(axis)
        other = np.radians(random.uniform(15.0, 60.0)) * np.array((-axis[1], axis[0], 0.0))
        other = other / np.linalg.norm(axis)
        legs += [turning(tip), Leg(0.5)]
        if turns == "before":
            legs += [turning(-tip), turning(other), Leg(0.5), turning(-other), Leg(0.5)]
        else:
            legs += [turning(-tip, np.array((0.0, 0.0, -size)))]
            down = air - size
    begin = sum(leg.seconds for leg in legs)
    slope = float(random.uniform(0.3, 1.0)) if motion == "dig" else 0.0
    entry = -(down + depth) * np.array((0.0, 0.0, 1.0)) + slope * (down + depth) * ahead
    legs.append(going(*entry.tolist()))
    entered = begin + legs[-1].seconds * float(random.uniform(0.8, 1.0))
    legs += rest()
    up = air + depth
    if motion == "drag":
        for way in (ahead, aside):
            dragged = float(random.uniform(0.02, 0.04)) * way
            legs += [going(*dragged.tolist()), *rest()]
    elif motion == "roll":
        far = float(random.uniform(0.02, 0.05))
        angle = float(random.uniform(0.5, 1.3))
        sink = np.array((0.0, 0.0, -float(random.uniform(0.0, 0.002))))
        legs += [turning(angle * aside, far * ahead + sink), *rest()]
        up += 0.5 * size - float(sink[2])
    elif motion == "dig":
        far = float(random.uniform(0.02, 0.04))
        pitch = float(random.uniform(0.25, 0.6))
        legs += [turning(-pitch * aside, far * ahead), *rest()]
        up += 0.5 * size
    elif motion == "tilt":
        for way in (ahead, aside):
            tip = float(random.uniform(0.15, 0.4)) * way
            legs += [turning(tip), *rest(), turning(-tip), *rest()]
    elif random.random() < 0.5:
        lift = up + 0.005
        x, y, _ = (0.05 * ahead).tolist()
        legs += [
            going(0.0, 0.0, lift),
            *rest(),
            going(x, y, 0.0),
            *rest(),
            going(0.0, 0.0, -lift),
            *rest(),
        ]
    out = np.array((0.0, 0.0, up))
    if motion == "dig":
        out += 0.4 * up * ahead
    legs += [going(*out.tolist()), Leg(float(random.uniform(0.8, 2.0)))]
    return legs, entered


def _forces(
    random: np.random.Generator,
    forces: Forces,
    tool: Tool,
    time: Array,
    position: Array,
    rotation: Rotation,
    *,
    zeta: float,
    length: float,
    surface: float,
) -> tuple[Array, float]:
    """The wrench of the grains, shape [n, 6], and a ζ near that with which the package's law is as strong."""
    law = law_at("treers2021", zeta=zeta, mobilization_length=length)
    of_model = grains_on(tool, time, position, rotation, law, surface=surface)
    wrench = of_model
    if forces == "second law":
        other = law_at("agarwal2023", zeta=zeta, mobilization_length=length)
        wrench = grains_on(tool, time, position, rotation, other, surface=surface)
    elif forces == "power of depth":
        points = tool.vertices[:: max(len(tool.vertices) // 200, 1)]
        z = rotation.as_matrix()[:, 2] @ points.T
        depth = np.maximum(surface - position[:, 2] - z.min(axis=1), 1e-4)
        power = float(random.uniform(-0.3, 0.6))
        wrench = of_model * ((depth / (0.7 * depth.max())) ** power)[:, None]
    elif forces == "turned by 2 degrees":
        axis = random.standard_normal(3)
        turn = Rotation.from_rotvec(np.radians(2.0) * axis / np.linalg.norm(axis))
        wrench = np.hstack([turn.apply(of_model[:, :3]), turn.apply(of_model[:, 3:])])
    own = np.linalg.norm(of_model[:, :3])
    strength = float(np.linalg.norm(wrench[:, :3]) / own) if own > 0.0 else 1.0
    wrong = 1.0 if random.random() < 0.4 else float(random.uniform(0.75, 1.3))
    return wrench, float(round(zeta * strength * wrong, 4))
