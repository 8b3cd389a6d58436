"""A cell as it would be recorded: an arm pushes an ellipsoid into grains and drags it along x and along y."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from recordings import (
    POSE,
    START,
    STEP,
    TF,
    TWIST,
    WRENCH,
    cdr,
    transforms_cdr,
    write_messages,
    write_ros2,
)
from scipy.spatial.transform import Rotation

from rft_ros.bags.options import topics_of
from rft_ros.diagnosis import Finding
from rft_ros.doctor.checkup import Cell, Checkup
from rft_ros.estimator import PoseSample, TransformSample, TwistSample, WrenchSample
from rft_ros.parameters import Config
from rft_ros.rft import POSITION, QUATERNION, STATE, VELOCITY, frames, wrenches
from rft_ros.rft.frames import Placement

SURFACE = 0.12
ZETA = 0.4
MOUNT = Placement(
    (0.0, 0.0, 0.05), tuple(Rotation.from_euler("z", 90, degrees=True).as_quat().tolist())
)
"""The load cell in the tool."""
PARAMETERS = {
    "mesh.file": "ellipsoid",
    "medium.zeta": ZETA,
    "medium.mobilization_length": 0.0,
    "alpha_y.model": "constant",
    "surface_height": SURFACE,
    "sensor.position": list(MOUNT.position),
    "sensor.quaternion": list(MOUNT.quaternion),
}
LEGS = (
    (1.0, (0, 0, 0)),
    (3.0, (0, 0, -1)),
    (0.5, (0, 0, 0)),
    (1.5, (1, 0, 0)),
    (1.5, (0, 1, 0)),
    (3.0, (0, 0, 1)),
)


def motion(rate: float) -> NDArray[np.float64]:
    """States at a rate [Hz], shape [n, 13]: 1 s in the air, 60 mm down, rest, 30 mm along x and y, up.

    The tool frame begins 55 mm over the surface; the ellipsoid reaches 20 mm lower.
    """
    velocity = np.repeat([v for _, v in LEGS], [round(s * rate) for s, _ in LEGS], axis=0) * 0.02
    states = np.zeros((len(velocity), len(STATE)))
    states[:, 6], states[:, VELOCITY] = 1.0, velocity
    states[:, POSITION] = np.cumsum(velocity, axis=0) / rate + (0.4, 0.1, SURFACE + 0.055)
    return states


def loads(states: NDArray[np.float64], *, zeta: float = ZETA) -> NDArray[np.float64]:
    """What the load cell feels [N, N m], shape [n, 6], in its own axes: the grains, whose force holds at rest."""
    model = Config.of(
        {**Config().values, **PARAMETERS, "medium.zeta": zeta, "tolerance": 0.0}
    ).model()
    world = wrenches(model.tool.plates, model.law, states, surface_height=SURFACE)[:, :6].copy()
    for k in np.flatnonzero((states[1:, 7:] == 0.0).all(axis=1)) + 1:
        world[k] = world[k - 1]
    to_tool, to_cell = Rotation.from_quat(states[:, QUATERNION]).inv(), MOUNT.inverse()
    in_tool = np.hstack([to_tool.apply(world[:, :3]), to_tool.apply(world[:, 3:])])
    return np.array([to_cell.wrench(tuple(row)) for row in in_tool.tolist()])


def cell_of(values, *, named=PARAMETERS) -> Cell:
    topics, model = topics_of(values), Config.of(values).model()
    return Cell(
        file=Path("cell.yaml"), config=Config.of(values), named=named, model=model, topics=topics
    )


def wrong(
    states,
    readings,
    *,
    poses=None,
    twists=None,
    stamps=None,
    arrivals=None,
    late=0.0,
    live=True,
    lost=(),
    **parameters,
) -> list[Finding]:
    """What the doctor finds wrong with a cell of these states and readings; parameters with _ for dots: as __.

    `stamps` and `arrivals` [ns]; `late`: of the load cell's stamps [s]. `lost`: the moments that do not arrive.
    """
    named = {
        **PARAMETERS,
        **{name.replace("__", "."): value for name, value in parameters.items()},
    }
    values = {**Config().values, **named}
    checkup = Checkup(cell_of(values, named=named), live=live)
    stamps = [START + k * STEP for k in range(len(states))] if stamps is None else stamps
    places = states[:, POSITION] if poses is None else poses
    velocities = states[:, VELOCITY] if twists is None else twists
    rows = zip(
        stamps,
        stamps if arrivals is None else arrivals,
        states,
        places,
        velocities,
        readings,
        strict=True,
    )
    for k, (stamp, now, state, place, velocity, reading) in enumerate(rows):
        if k in lost:
            continue
        checkup.push(
            WrenchSample(stamp + round(1e9 * late), "ft_sensor", tuple(reading.tolist())), now
        )
        if values["twist_source"] == "topic":
            checkup.push(
                TwistSample(stamp, "world", tuple(velocity.tolist()), tuple(state[10:].tolist())),
                now,
            )
        checkup.push(
            PoseSample(stamp, "world", tuple(place.tolist()), tuple(state[QUATERNION].tolist())),
            now,
        )
    return [finding for finding in checkup.findings() if not finding.ok]


def record(
    path: Path,
    *,
    told: Placement = MOUNT,
    stamped: bool = True,
    extra: tuple[TransformSample, ...] = (),
) -> Path:
    """Topics of a right cell, /tf and /tf_static that say the same, and the cell without stamps, and untouched.

    At 100 Hz; messages arrive 1 ms after their stamps. `told`: the sensor in the tool by /tf_static, with `extra` fixed
    transforms. `stamped`: whether the transforms on /tf have stamps.
    """
    states, random = motion(100.0), np.random.default_rng(3)
    readings = 1.1 * loads(states) + 0.02 * random.standard_normal((len(states), 6)) * (
        1,
        1,
        1,
        0.01,
        0.01,
        0.01,
    )
    messages = []
    for k, (state, reading) in enumerate(zip(states.tolist(), readings.tolist(), strict=True)):
        stamp = START + k * STEP
        place = TransformSample(
            stamp if stamped else 0,
            "base",
            "tool",
            (state[0] - 0.4, state[1] - 0.1, state[2]),
            (*state[QUATERNION],),
        )
        now = (
            ("/rft/wrench_measured", WRENCH, cdr("wrench", stamp, reading)),
            ("/unstamped", WRENCH, cdr("wrench", 0, reading)),
            ("/still", WRENCH, cdr("wrench", stamp, [0.01 * (k % 3)] * 6)),
            ("/rft/twist", TWIST, cdr("twist", stamp, state[frames.TWIST])),
            ("/rft/pose", POSE, cdr("pose", stamp, state[frames.POSE])),
            ("/tf", TF, transforms_cdr(place)),
        )
        messages += [(stamp + 1_000_000, *one) for one in now]
    mount = TransformSample(START, "tool", "ft_sensor", *told)
    arm = TransformSample(START, "world", "base", (0.4, 0.1, 0.0), (0.0, 0.0, 0.0, 1.0))
    late = START + 81_000_000  # as publishers are found one after the other
    return write_messages(
        path, [*messages, (late, "/tf_static", TF, transforms_cdr(mount, arm, *extra))]
    )


def record_of_a_newcomer(path: Path, *, offset: tuple[float, ...]) -> Path:
    """Poses at 250 Hz with 3 um of noise and no twists, a load cell at 100 Hz with an offset, grains 30 % stronger."""
    random = np.random.default_rng(5)
    poses, states = motion(250.0), motion(100.0)
    poses[:, :3] += 3e-6 * random.standard_normal((len(poses), 3))
    readings = loads(states, zeta=1.3 * ZETA) + offset
    readings += 0.02 * random.standard_normal((len(states), 6)) * (1, 1, 1, 0.01, 0.01, 0.01)
    rows = [("pose", START + k * 4_000_000, row[:7]) for k, row in enumerate(poses.tolist())]
    rows += [("wrench", START + k * STEP + 7, row) for k, row in enumerate(readings.tolist())]
    timed = [
        (role, stamp, stamp, row) for role, stamp, row in sorted(rows, key=lambda row: row[1])
    ]
    topics = {"pose": ("/tcp", POSE), "wrench": ("/ft", WRENCH)}
    return write_ros2(path, timed, topics=topics, frames={"pose": "base", "wrench": "ft_sensor"})
