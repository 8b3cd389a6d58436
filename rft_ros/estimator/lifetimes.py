"""What the estimator keeps from sample to sample, by lifetime, and the table of changes that end each part of it.

The tree of frames, the order of the poses' stamps, and the stamps that wait for poses from transforms are the intake's:
no change ends them.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Flag, auto
from functools import reduce
from operator import or_
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator.learning import Learning
from rft_ros.estimator.load_cell import HISTORY, Prediction
from rft_ros.estimator.motion import Kinematics, Pace
from rft_ros.estimator.pose_jumps import PoseJumps
from rft_ros.estimator.quality import QualityMonitor
from rft_ros.estimator.samples import PoseSample, TwistSample, WrenchSample
from rft_ros.estimator.sigma import Withdrawal
from rft_ros.estimator.tare import AirReading, TarePose
from rft_ros.estimator.timeline import Timeline
from rft_ros.estimator.unseen_motion import UnseenMotion
from rft_ros.ground import Footing, GroundMapper, HeightMap, LocalSurface
from rft_ros.parameters import Config, LoadCell, Model
from rft_ros.rft import STATE, Memory
from rft_ros.rft.frames import Vector
from rft_ros.rft.wrench import prepared
from rft_ros.tool import Tool

# a pose that waited in a queue of 200 messages still finds the twist of its own time
_TWIST_COUNT = 256


class Change(Flag):
    """What can change between two samples."""

    JUMP = auto()  # the stamps of the poses jumped back, as in a bag that is played in a loop
    FRAMES = auto()  # `world_frame`, `tool_frame`
    # their stamps or axes: the delay, `sensor_frame`, whether it turns with the tool
    READINGS = auto()
    LOAD_CELL = auto()  # also where a fixed transform places it
    TOOL = auto()
    GROUND = auto()  # the map at the start; or the ground was levelled
    HEIGHT = auto()  # `surface_height`
    MEMORY = auto()  # the law has a memory now, or has none any more
    PRIOR = auto()  # of learning: the law, its error, on or off; or the filter forgets


class Readings:
    """The samples of the load cell, and the predictions that wait for them."""

    def __init__(self) -> None:
        self.samples = Timeline[WrenchSample](maxlen=HISTORY)
        self.pending = deque[Prediction]()
        """Those that wait for their readings. Compare them before they end."""
        self.last_raw_force: Vector | None = None
        """That of the last reading that was compared."""

    def begin_run(self, stamp: int) -> None:
        """Drop what belongs to the run before the one that begins at a pose with this stamp [ns]."""
        self.samples.start_run(stamp)
        self.pending.clear()
        self.last_raw_force = None


class ToolMotion:
    """How the tool has moved."""

    def __init__(self) -> None:
        self.pose: PoseSample | None = None
        """The last one that was accepted."""
        self.state: NDArray[np.float64] = np.zeros(len(STATE))
        """As `Estimator.state`."""
        self.poses = deque[TarePose](maxlen=HISTORY)
        """For a tare."""
        self.jumps = PoseJumps()
        self.pace = Pace()
        self.kinematics = Kinematics()


class GroundAround:
    """The ground: the map that clouds and the tool change, and the surface around the tool."""

    def __init__(self, start: HeightMap | None) -> None:
        self.mapper = None if start is None else GroundMapper(start)
        """None: the ground is a level plane."""
        self.surface: LocalSurface | None = None
        """The one at the last pose that was evaluated."""


class Contact:
    """One tool in the grains: the memory of its plates, and what its motion through them says of an estimate."""

    def __init__(self, tool: Tool, *, has_memory: bool) -> None:
        self.footing = Footing(tool.corners)
        self.step = prepared(tool.plates, Memory(tool.plates) if has_memory else None)
        """Evaluates the model at the next pose."""
        self.withdrawal = Withdrawal()
        self.quality = QualityMonitor(tool)
        self.unseen = UnseenMotion(tool)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lifetimes:
    """The estimator's state: one value for each lifetime. `TABLE` says which change ends which.

    A change makes anew the values that it ends and leaves the others as they are. A jump of the poses' stamps ends
    those samples whose own stamps belong to the time before (`begin_run`): samples of the new run may have come before
    its first pose.
    """

    twists: Timeline[TwistSample]
    readings: Readings
    motion: ToolMotion
    ground: GroundAround
    contact: Contact
    air: AirReading
    learning: Learning | None

    @classmethod
    def begin(cls, config: Config, model: Model) -> "Lifetimes":
        """All values as they are before the first sample."""
        return cls(**{name: part.made(config, model) for name, part in TABLE.items()})

    def after(self, change: Change, config: Config, model: Model) -> "Lifetimes":
        """The values after changes. `config` and `model`: the new ones. Compare what waits for readings before."""
        if change & PLACE and self.learning is not None:
            self.learning.forget_place()
        new_values = {
            name: part.made(config, model)
            for name, part in TABLE.items()
            if change & part.ends_with
        }
        return replace(self, **new_values)

    def begin_run(self, stamp: int) -> None:
        """Drop the samples of the run before the one that begins at a pose with this stamp [ns]."""
        self.twists.start_run(stamp)
        self.readings.begin_run(stamp)


class Lifetime(NamedTuple):
    """How a value of `Lifetimes` is made, and the changes that end it."""

    made: Callable[[Config, Model], Any]
    ends_with: Change


def _learning(config: Config, model: Model) -> Learning | None:
    if config.learning.mode == "off":
        return None
    return Learning(
        lag=config.learning.lag,
        strength_error=config.strength_error,
        reach=model.tool.plates.reach,
    )


_MOTION = Change.JUMP | Change.FRAMES

TABLE = {
    "twists": Lifetime(lambda _, __: Timeline(maxlen=_TWIST_COUNT), Change.FRAMES),
    "readings": Lifetime(lambda _, __: Readings(), Change.FRAMES | Change.READINGS),
    "motion": Lifetime(lambda _, __: ToolMotion(), _MOTION),
    "ground": Lifetime(lambda _, model: GroundAround(model.ground), _MOTION | Change.GROUND),
    "contact": Lifetime(
        lambda _, model: Contact(model.tool, has_memory=model.law.has_memory),
        _MOTION | Change.TOOL | Change.MEMORY,
    ),
    "air": Lifetime(lambda _, __: AirReading(), _MOTION | Change.TOOL | Change.LOAD_CELL),
    "learning": Lifetime(_learning, Change.PRIOR),
}
"""For each value of `Lifetimes`, how it is made and the changes that end it."""

PLACE = _MOTION | Change.TOOL | Change.GROUND | Change.HEIGHT
"""The changes after which `Lifetimes.learning` forgets all but the strength of the grains."""


def compared(
    config: Config, load_cell: LoadCell, model: Model, *, readings_in_world: bool
) -> dict[Change, object]:
    """The values whose change is each `Change`.

    `load_cell`: that of the config, at its place by the transforms. `readings_in_world`: the load cell does not turn
    with the tool, or its readings are in world axes.
    """
    frames = config.frames
    return {
        Change.FRAMES: (frames.world, frames.tool),
        Change.READINGS: (frames.sensor, load_cell.delay, readings_in_world),
        Change.LOAD_CELL: load_cell,
        Change.TOOL: model.tool,
        Change.GROUND: model.ground,
        Change.HEIGHT: config.surface_height,
        Change.MEMORY: model.law.has_memory,
        Change.PRIOR: (model.law, config.learning.mode == "off", config.strength_error),
    }


def changes(old: dict[Change, object], new: dict[Change, object]) -> Change:
    """The changes between two results of `compared`."""
    return reduce(or_, [change for change in new if new[change] != old[change]], Change(0))
