"""Recordings with known parameters: a tool on a path, what a load cell in any mounting reads of it, noise added."""

from dataclasses import replace
from pathlib import Path as File
from tempfile import TemporaryDirectory

import numpy as np
import trimesh
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation, Slerp

from rft_ros.calibration.track import Track
from rft_ros.estimator import LoadCellFrame, PoseDifference, PoseSample
from rft_ros.parameters import Config, LoadCell
from rft_ros.rft import (
    MEDIA,
    Memory,
    alpha_y_model,
    treers2021,
    wrenches_in_time,
)
from rft_ros.tool import load_tool

REST = 2e-4
"""Speed below which a tool is at rest [m/s]."""

GENERIC = MEDIA["generic"]
_FOLDER = TemporaryDirectory()
TOOL_FILE = str(File(_FOLDER.name) / "plate.stl")
"""A plate of twelve facets and the size of the shipped abb_plate, which has 392; horizontal at 0, 0, 0, 1."""

_BOX = trimesh.creation.box((42.64, 32.57, 3.0))
_BOX.apply_translation((0.0, 0.0, -1.5))
_BOX.export(TOOL_FILE)
TOOL = load_tool(TOOL_FILE, scale=0.001)

ROTATED = tuple(
    float(v) for v in Rotation.from_euler("xyz", [25.0, -40.0, 70.0], degrees=True).as_quat()
)


def law(zeta=1.0):
    return treers2021(GENERIC, alpha_y_model("constant", GENERIC), zeta=zeta)


def parameters(**given):
    """The node's parameters for `TOOL` and `law`, without memory; names with __ for dots."""
    named = {name.replace("__", "."): value for name, value in given.items()}
    of_tool = {"mesh.file": TOOL_FILE, "mesh.scale": 0.001, "tolerance": 0.0}
    of_law = {"alpha_y.model": "constant", "medium.mobilization_length": 0.0}
    return {**Config().values, **of_tool, **of_law, **named}


class Path:
    """Corners of a path with times, and states in between."""

    def __init__(self, position, rotation=None):
        self.times, self.positions = [0.0], [np.array(position, dtype=float)]
        self.rotations = [rotation or Rotation.identity()]

    def wait(self, seconds):
        return self._corner(seconds, self.positions[-1], self.rotations[-1])

    def move(self, offset, speed):
        offset = np.array(offset, dtype=float)
        return self._corner(
            np.linalg.norm(offset) / speed, self.positions[-1] + offset, self.rotations[-1]
        )

    def turn_to(self, rotation, seconds=0.5):
        return self._corner(seconds, self.positions[-1], rotation)

    def roll(self, offset, rotation, seconds):
        """Move and turn at once."""
        return self._corner(seconds, self.positions[-1] + np.array(offset), rotation)

    def _corner(self, seconds, position, rotation):
        self.times.append(self.times[-1] + seconds)
        self.positions.append(position)
        self.rotations.append(rotation)
        return self

    def states(self, rate=100.0):
        """Time [s], shape [n], and states, shape [n, 13]: velocities are those of the corner's straight leg."""
        time = np.arange(0.0, self.times[-1], 1.0 / rate)
        places = np.array(self.positions)
        position = np.column_stack([np.interp(time, self.times, column) for column in places.T])
        turns = Slerp(self.times, Rotation.concatenate(self.rotations))(time)
        leg = np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 2)
        lengths = np.diff(self.times)[leg, None]
        velocity = np.diff(places, axis=0)[leg] / lengths
        spins = np.array(
            [
                (b * a.inv()).as_rotvec()
                for a, b in zip(self.rotations, self.rotations[1:], strict=False)
            ]
        )
        return time, np.hstack([position, turns.as_quat(), velocity, spins[leg] / lengths])


def grain_wrenches(_time, states, law, *, surface, length=1e-9, tool=TOOL):
    """Wrench of the grains on the tool, world axes, shape [n, 6]; by default the memory matters only at rest."""
    plates = tool.plates
    grains = replace(law, mobilization_length=length)
    return wrenches_in_time(plates, grains, states, Memory(plates), surface_height=surface)


def read_by(cell, states, wrench_rows, rng=None, *, noise=(0.0, 0.0)):
    """What the load cell reads: raw sign, sensor axes. `noise`: as in `noisy`."""
    frame = LoadCellFrame(cell)
    rows = []
    for state, wrench in zip(states, wrench_rows, strict=True):
        answer = np.concatenate([wrench[:6], np.zeros(6)])
        numbers = np.concatenate(frame.into_sensor(state[3:7], answer)[:2])
        rows.append(cell.sign * (numbers[:6] + numbers[6:]))
    readings = np.array(rows)
    return readings if rng is None else noisy(readings, rng, noise)


def noisy(readings, rng, noise, memory=0.8):
    """The readings with noise [N], [N m] of that lag-one correlation."""
    white = rng.normal(size=readings.shape) * np.repeat(noise, 3) * np.sqrt(1.0 - memory**2)
    return readings + lfilter([1.0], [1.0, -memory], white, axis=0)


def shaken(states, rng, place, turn):
    """The states with noise of the poses [m], [rad]."""
    poses = states.copy()
    poses[:, :3] += rng.normal(0.0, place, (len(poses), 3))
    turned = Rotation.from_rotvec(rng.normal(0.0, turn, (len(poses), 3)))
    poses[:, 3:7] = (turned * Rotation.from_quat(poses[:, 3:7])).as_quat()
    return poses


def differenced(time, states):
    """The states with the velocities that the estimator finds from the poses."""
    difference = PoseDifference()
    for row, t in zip(states, time, strict=True):
        pose = PoseSample(
            1 + round(1e9 * t), "world", tuple(row[:3].tolist()), tuple(row[3:7].tolist())
        )
        row[7:13] = difference.twist if difference.push(pose, window=0.2, gap=10**8) else 0.0
    return states


def track_of(time, states, readings, name="synthetic", tool=TOOL):
    begin = 1_600_000_000 * 10**9
    moments = {"begin": begin, "time": time, "states": states, "readings": readings}
    return Track(name=name, **moments, cell=LoadCell(), tool=tool, rest_speed=REST)


LOAD_CELL = LoadCell(
    position=(0.01, -0.02, -0.1),
    quaternion=ROTATED,
    sign=-1.0,
    bias=(1.5, -0.8, 2.4, 0.05, -0.02, 0.01),
    mass=0.42,
    center_of_mass=(0.005, -0.012, 0.06),
)
"""A mounting, sign, bias and weight that a calibration has to deal with."""

NOISE = (0.1, 0.002)
"""Of a load cell [N], [N m]."""


def recorded(
    path,
    *,
    rate=100.0,
    zeta=0.8,
    length=1e-9,
    surface=0.0,
    force=None,
    tool=TOOL,
    cell=LOAD_CELL,
    noise=NOISE,
    seed=5,
):
    """The track of a path, with noise; `force`: from the states to the grains' wrenches, if not those of the law."""
    time, states = path.states(rate)
    if force is None:
        grains = grain_wrenches(time, states, law(zeta), surface=surface, length=length, tool=tool)
    else:
        grains = force(states)
    readings = read_by(cell, states, grains, np.random.default_rng(seed), noise=noise)
    return track_of(time, states, readings, tool=tool)


def unknown(**given):
    """Parameters with the mounting of the load cell only."""
    cell = LOAD_CELL
    mounting = {
        "sensor__position": cell.position,
        "sensor__quaternion": cell.quaternion,
        "sensor__sign": cell.sign,
    }
    return parameters(**(mounting | given))


def known(**given):
    """Parameters with all of the load cell."""
    cell = LOAD_CELL
    own = {
        "sensor__bias": cell.bias,
        "sensor__mass": cell.mass,
        "sensor__center_of_mass": cell.center_of_mass,
    }
    return unknown(**(own | given))


ORIENTATIONS = ((40, 0, 0), (-40, 0, 0), (0, 40, 0), (0, -40, 0), (90, 0, 0))


def in_the_air(orientations=ORIENTATIONS):
    """A path on which the tool waits 6 cm above z = 0 in each orientation, and comes back level."""
    path = Path((0.0, 0.0, 0.06))
    for angles in orientations:
        path.turn_to(Rotation.from_euler("xyz", angles, degrees=True)).wait(0.8)
    return path.turn_to(Rotation.identity()).wait(0.8)
