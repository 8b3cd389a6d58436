"""What the estimator keeps from pose to pose, and the table of changes that make each part of it begin anew.

The tree of frames, and the stamps that wait for poses from transforms, are the intake's: a new run of the poses ends
neither.
"""

from collections import deque
from enum import Flag, auto
from functools import reduce
from operator import or_

import numpy as np

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
from rft_ros.ground import Footing, GroundMapper, LocalSurface
from rft_ros.parameters import LoadCell, Model, Settings
from rft_ros.rft import STATE, Memory
from rft_ros.rft.frames import Wrench
from rft_ros.rft.wrench import prepared

# a pose that waited in a queue of 200 messages still finds the twist of its own time
_TWISTS = 256


class Change(Flag):
    """What can change between two samples."""

    RUN = auto()  # the stamps of the poses jumped back, as in a bag that is played in a loop
    AXES = auto()  # those of the poses: `world_frame`, `tool_frame`
    TOOL = auto()
    GROUND = auto()  # the map at the start; or the ground was levelled
    HEIGHT = auto()  # `surface_height`
    LAW = auto()
    MEMORY = auto()  # the law has a memory now, or has none any more
    PRIOR = auto()  # of learning: it is switched on or off, or forgets
    LOAD_CELL = auto()
    READINGS = auto()  # their stamps or axes
    RATE = auto()  # `max_rate`


_MOTION = Change.RUN | Change.AXES
_TOOL = _MOTION | Change.TOOL

RESTARTS: dict[str, Change] = {
    "twists": Change.AXES,  # a new run also drops those of the run before, by their stamps
    "readings": Change.READINGS,  # likewise
    "pending": Change.RUN | Change.READINGS,
    "last_raw": Change.RUN | Change.READINGS,
    "pose_stamp": Change.RUN,
    "pose": _MOTION,
    "state": _MOTION,
    "poses": _MOTION,
    "jumps": _MOTION,
    "pace": _MOTION | Change.RATE,
    "kinematics": _MOTION,
    "mapper": _MOTION | Change.GROUND,
    "surface": _MOTION | Change.GROUND | Change.HEIGHT,
    "footing": _TOOL,
    "step": _TOOL | Change.MEMORY,
    "withdrawal": _TOOL,
    "quality": _TOOL,
    "unseen": _TOOL,
    "air": _TOOL | Change.LOAD_CELL,
    "learning": Change.LAW | Change.PRIOR,
}
"""For each part of `Run`, the changes after which it begins anew."""

_PLACE = _TOOL | Change.GROUND | Change.HEIGHT
"""The changes after which `Run.learning` forgets all but the strength of the grains."""


def compared(settings: Settings, load_cell: LoadCell, model: Model) -> dict[Change, object]:
    """The values whose change is each `Change`. `load_cell`: that of the settings, at its place by the transforms."""
    s = settings
    return {
        Change.AXES: (s.world_frame, s.tool_frame),
        Change.TOOL: model.tool,
        Change.GROUND: model.ground,
        Change.HEIGHT: s.surface_height,
        Change.LAW: model.law,
        Change.MEMORY: model.law.has_memory,
        Change.PRIOR: (s.learning_mode == "off", s.strength_error),
        Change.LOAD_CELL: load_cell,
        Change.READINGS: (
            s.world_frame,
            s.sensor_frame,
            s.load_cell.delay,
            s.sensor_source == "world",
        ),
        Change.RATE: s.max_rate,
    }


def changes(before: dict[Change, object], after: dict[Change, object]) -> Change:
    """The changes between two results of `compared`."""
    return reduce(or_, [change for change in after if after[change] != before[change]], Change(0))


class Run:
    """The parts of the estimator's state, made for settings and a model. `RESTARTS` says what makes each part anew."""

    def __init__(self, settings: Settings, model: Model) -> None:
        tool = model.tool
        self.twists = Timeline[TwistSample](maxlen=_TWISTS)
        self.readings = Timeline[WrenchSample](maxlen=HISTORY)
        """Of the load cell."""
        self.pending = deque[Prediction]()
        """Those that wait for their readings. Compare them before they begin anew."""
        self.last_raw: Wrench | None = None
        """The last reading that was compared."""
        self.pose_stamp = 0
        """Of the last pose that was accepted [ns]."""
        self.pose: PoseSample | None = None
        """The last one that was accepted."""
        self.state = np.zeros(len(STATE))
        """As `Estimator.state`."""
        self.poses = deque[TarePose](maxlen=HISTORY)
        """For a tare."""
        self.jumps = PoseJumps()
        self.pace = Pace(settings.max_rate)
        self.kinematics = Kinematics()
        self.mapper = None if model.ground is None else GroundMapper(model.ground)
        """None: the ground is a level plane."""
        self.surface = LocalSurface(settings.surface_height)
        """The one around the tool at the last pose that was evaluated."""
        self.footing = Footing(tool.corners)
        self.step = prepared(tool.plates, Memory(tool.plates) if model.law.has_memory else None)
        """Evaluates the model at the next pose."""
        self.withdrawal = Withdrawal()
        self.quality = QualityMonitor(tool)
        self.unseen = UnseenMotion(tool)
        self.air = AirReading()
        self.learning: Learning | None = None
        if settings.learning_mode != "off":
            self.learning = Learning(
                lag=settings.learning_lag,
                strength_error=settings.strength_error,
                reach=tool.plates.reach,
            )

    def restart(self, changed: Change, settings: Settings, model: Model) -> None:
        """Make the parts anew that the changes restart, for these settings and this model."""
        if not changed:
            return
        if changed & _PLACE and self.learning is not None:
            self.learning.forget_place()
        new = Run(settings, model)
        for name, when in RESTARTS.items():
            if changed & when:
                setattr(self, name, getattr(new, name))
