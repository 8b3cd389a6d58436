"""Play a recording through an estimator: topics, the part of the bag, and the loop over its samples."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.reading import Recording, bag_name
from rft_ros.errors import InputError, shown
from rft_ros.estimator import Estimate, Estimator, Model, PoseSample, Reason, Sample
from rft_ros.estimator.samples import Answer
from rft_ros.ground import HeightMap
from rft_ros.messages import TOPICS, Role
from rft_ros.parameters import NODE, LoadCell, Values, section_parameters, settings_of
from rft_ros.progress import bar
from rft_ros.rft import FORCE, QUATERNION

__all__ = ["Played", "ReplayOptions", "play", "read_replay_options", "reasons", "states_of", "topics_of"]
__all__ += ["world_forces"]

_SECTION = "rft_replay"
_BAR_PERIOD = 512  # samples between updates of the progress bar


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """Options of a replay. `remap`: rules such as ``~/pose:=/tool_pose``. `tare`: its length, at the beginning [s].

    `start`, `end`: the part of the bag that is replayed [s]. Raises InputError for values that are no times, and if
    `end` is not after `start`.
    """

    remap: tuple[str, ...] = ()
    tare: float | None = None
    start: float | None = None
    end: float | None = None

    def __post_init__(self) -> None:
        for name, seconds in (("start", self.start), ("end", self.end), ("tare", self.tare)):
            number = isinstance(seconds, int | float) and not isinstance(seconds, bool)
            if seconds is not None and not (number and 0.0 <= seconds <= 1e9):
                raise InputError(f"{name} is {shown(seconds)}; it must be a number from 0 to 1e9 [s]")
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise InputError(f"end is {self.end:g} s; it must be after start, {self.start:g} s")


def read_replay_options(file: Path) -> ReplayOptions:
    """The options under ``rft_replay: ros__parameters:`` of a parameter file, if any; the node ignores them."""
    section: dict[str, Any] = {**section_parameters(file, _SECTION)}
    remap = section.pop("remap", ())
    try:
        if not isinstance(remap, list | tuple) or not all(isinstance(rule, str) for rule in remap):
            raise InputError(f"remap is {shown(remap)}; it must be a list of strings")
        for name, value in section.items():
            if name not in ("tare", "start", "end") or value is None:
                raise InputError(f"{name} is {shown(value)}; it has remap, and the numbers tare, start and end [s]")
        return ReplayOptions(remap=tuple(remap), **section)
    except InputError as error:
        raise InputError(f"parameter file '{file}': {_SECTION} {error}") from None


def topics_of(values: Values, remap: Sequence[str] = (), node: str = NODE) -> dict[Role, str]:
    """The topic of each role that the parameters need: NODE/pose and so on, unless a rule of `remap` gives another.

    A later rule overrides an earlier one. With `pose_source` tf, /tf takes the place of the topic of poses. Raises
    InputError for a rule that cannot be used.
    """
    topics = {role: _resolved(name, node) for role, name in TOPICS.items() if role != "tf_static"}
    roles = {topic: role for role, topic in topics.items()}
    for rule in remap:
        left, separator, right = (part.strip() for part in rule.partition(":="))
        if not separator or not right:
            raise InputError(f"remap '{rule}' is not of the form FROM:=TO, such as ~/pose:=/tool_pose")
        role = roles.get(_resolved(left, node) if left.startswith(("/", "~")) else "")
        if role is None:
            raise InputError(f"remap '{rule}': '{left}' is none of {', '.join(TOPICS[role] for role in topics)}")
        topics[role] = _resolved(right, node)
    unused: set[Role] = {"pose"} if values["pose_source"] == "tf" else {"tf"}
    if values["twist_source"] != "topic":
        unused.add("twist")
    if not values["ground.cell"]:
        unused.add("surface")
    return {role: topic for role, topic in topics.items() if role not in unused}


def _resolved(name: str, node: str) -> str:
    """A topic's full name, as ROS resolves it for the node."""
    if name.startswith("~"):
        return node + name[1:]
    return name if name.startswith("/") else f"{node.rpartition('/')[0]}/{name}"


def play(recording: Recording, estimator: Estimator) -> Iterator[tuple[Sample, Answer | None]]:
    """Push every sample of an open recording. Yields each sample, and each pose with its answer (`Estimator.answers`).

    At the end all measurements are final, and messages that cannot be decoded are counted.
    """
    label, from_transforms = bag_name(recording.bag), estimator.settings.pose_source == "tf"
    with bar(label, recording.last - recording.first) as update:
        for number, sample in enumerate(recording):
            answers = estimator.answers(sample)
            if not isinstance(sample, PoseSample):
                yield sample, None
            for pose, answer in answers:
                if from_transforms:
                    recording.counts["pose"] += 1
                yield pose, answer
            if number % _BAR_PERIOD == 0:
                update(recording.time - recording.first, label)
    estimator.finish()
    if recording.unreadable:
        estimator.counts[Reason.MESSAGE_UNREADABLE] += recording.unreadable


def reasons(recording: Recording, estimator: Estimator) -> str:
    """Damage of a recording that was played, and the counted reasons, as the end of an error."""
    return "; ".join(filter(None, (recording.damage, *estimator.counted()))) or "no sample was refused"


class Played(NamedTuple):
    """The estimates of a recording. `times`: since the first one [s], shape [n]. `states`: shape [n, 13].

    `forces`: predicted, on the tool, world axes [N], shape [n, 3]. `ground`: the map at the end; None: a level plane.
    """

    times: NDArray[np.float64]
    states: NDArray[np.float64]
    forces: NDArray[np.float64]
    ground: HeightMap | None


def states_of(bag: Path, values: Values, model: Model, options: ReplayOptions) -> Played:
    """The estimates of a recording. Raises InputError if no pose has an estimate."""
    estimator = Estimator(settings_of(values), model)
    stamps, states, wrenches = [], [], []
    with Recording(bag, topics_of(values, options.remap), start=options.start, end=options.end) as recording:
        for _, answer in play(recording, estimator):
            if isinstance(answer, Estimate):
                stamps.append(answer.stamp)
                states.append(estimator.state.copy())
                wrenches.append(answer.predicted)
    if not states:
        raise InputError(f"bag '{bag}' has no pose with an estimate ({reasons(recording, estimator)})")
    forces = world_forces(np.array(wrenches), np.array(states), estimator.load_cell)
    return Played((np.array(stamps) - stamps[0]) * 1e-9, np.array(states), forces, estimator.ground)


def world_forces(wrenches: NDArray[np.float64], states: NDArray[np.float64], cell: LoadCell) -> NDArray[np.float64]:
    """Rotate the forces of wrenches in sensor axes [N], shape [n, 3 or 6], to world axes. `states`: shape [n, 13]."""
    from scipy.spatial.transform import Rotation

    sensor = Rotation.from_quat(states[:, QUATERNION]) * Rotation.from_quat(cell.quaternion)
    return np.asarray(sensor.apply(wrenches[:, FORCE]))
