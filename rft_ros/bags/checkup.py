"""Check a cell's set-up by what its inputs say: a finding for each question, OK or what to do."""

from collections import Counter, deque
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from rft_ros.bags.playback import push_all
from rft_ros.estimator import Estimate, Estimator, Model, PoseSample, Reason, TwistSample, WrenchSample
from rft_ros.estimator.messages import Role, Sample, Stamped
from rft_ros.estimator.tool_poses import ToolPoses
from rft_ros.ground import Cloud
from rft_ros.parameters import Values, settings_of

__all__ = ["Checkup", "Finding"]

_ENOUGH = 20  # estimates in the grains, or in the air
_FELT = 0.2  # N: a smaller force decides nothing
_ALIKE = 0.5  # correlation of the measured and the predicted force
_RARE = 0.01  # share of poses
_EXPECTED = {Reason.AT_REST, Reason.POSE_HISTORY_SHORT, Reason.POSE_RATE_LIMITED, Reason.SURFACE_RATE_LIMITED}
_ROLES: dict[type, Role] = {PoseSample: "pose", TwistSample: "twist", WrenchSample: "wrench", Cloud: "surface"}
_ADVICE: dict[Role, str] = {
    "pose": "start the driver, remap ~/pose, or set pose_source: tf",
    "tf": "start the robot's state publisher, or set pose_source: topic",
    "twist": "set twist_source: pose_difference, or remap ~/twist",
    "wrench": "start the load cell's driver, or remap ~/wrench_measured",
    "surface": "the ground stays as at the start",
}


class Finding(NamedTuple):
    """The answer to one question: whether all is well, and a sentence, which says what to do if not."""

    ok: bool
    text: str

    def __str__(self) -> str:
        return f"{'OK ' if self.ok else 'FIX'} {self.text}"


@dataclass(slots=True)
class _Heard:
    """Arrival [ns] and age at arrival [s] of one role's messages; how many have no stamp; their frames."""

    times: list[int] = field(default_factory=list)
    ages: list[float] = field(default_factory=list)
    unstamped: int = 0
    frames: Counter[str] = field(default_factory=Counter)


class Checkup:
    """Takes a cell's samples in the order of their arrival, and says what is wrong with the set-up.

    `values`: the node's parameters. `named`: the names of those that the user has set. `topics`: the topic of each role
    that is needed. `tare`: length of a replay's tare [s].
    """

    def __init__(
        self,
        values: Values,
        model: Model,
        *,
        named: Collection[str],
        topics: dict[Role, str],
        tare: float | None = None,
    ) -> None:
        self._named, self._topics, self._tare = named, topics, tare
        self._estimator = Estimator(settings_of(values), model)
        self._tool_poses = ToolPoses(self._estimator) if values["pose_source"] == "tf" else None
        self._heard: dict[Role, _Heard] = {role: _Heard() for role in topics}
        self._waiting: deque[Estimate] = deque()
        self._forces: list[tuple[float, ...]] = []  # submerged area, predicted and measured force, sensor axes
        self._poses = 0
        self._deepest = -np.inf

    def push(self, sample: Sample, time: int) -> None:
        """Add a sample that arrived at `time` [ns]."""
        role = _ROLES.get(type(sample), "tf")
        if role in self._heard:
            self._hear(self._heard[role], sample, time)
        for _, answer in push_all(self._estimator, self._tool_poses, sample):
            self._poses += answer is not None
            if isinstance(answer, Estimate):
                self._waiting.append(answer)
                self._deepest = max(self._deepest, self._estimator.depth())
        self._compare()

    def _hear(self, heard: _Heard, sample: Sample, time: int) -> None:
        if isinstance(sample, Stamped):
            stamp = sample.stamp
            heard.frames[sample.frame] += 1
        elif all(transform.fixed for transform in sample):
            return
        else:
            stamp = max(transform.stamp for transform in sample)
        heard.times.append(time)
        if stamp > 0:
            heard.ages.append((time - stamp) * 1e-9)
        else:
            heard.unstamped += 1

    def _compare(self) -> None:
        for measurement in self._estimator.measurements():
            estimate = self._waiting.popleft()
            if measurement.compensated is not None:
                row = (estimate.submerged_area, *estimate.predicted[:3], *measurement.compensated[:3])
                self._forces.append(row)

    def findings(self) -> list[Finding]:
        """The findings, after the last sample."""
        self._estimator.finish()
        self._compare()
        return [*self._of_tool(), *self._of_inputs(), *self._of_frames(), *self._of_load_cell(), *self._of_reasons()]

    def _of_tool(self) -> Iterator[Finding]:
        tool = self._estimator.model.tool
        extents = " x ".join(f"{1e3 * e:.3g}" for e in np.ptp(tool.vertices, axis=0))
        deepest = f", at most {1e3 * self._deepest:.3g} mm below the surface" if np.isfinite(self._deepest) else ""
        sizes = [issue.message for issue in tool.issues if issue.kind == "size"]
        advice = f": {sizes[0]}" if sizes else deepest
        yield Finding(not sizes, f"mesh {tool.name}: {extents} mm{advice}")
        if "surface_height" in self._named:
            yield Finding(True, f"surface_height: {self._estimator.settings.surface_height:g} m")
        else:
            yield Finding(False, "surface_height is not set and counts as 0.0: measure it, or run rft calibrate")

    def _of_inputs(self) -> Iterator[Finding]:
        limit = self._estimator.settings.max_input_age
        for role, topic in self._topics.items():
            heard = self._heard[role]
            if not heard.times:
                yield Finding(role == "surface", f"{role}: nothing on {topic}; {_ADVICE[role]}")
                continue
            if heard.unstamped:
                yield Finding(
                    False, f"{role}: {heard.unstamped} messages on {topic} have no stamp; the driver must set it"
                )
            seconds = (heard.times[-1] - heard.times[0]) * 1e-9
            rate = f"{(len(heard.times) - 1) / seconds:.0f} Hz" if seconds > 0.0 else "1 message"
            age = float(np.median(heard.ages or [0.0]))
            frames = f", frame {' and '.join(sorted(heard.frames))}" if heard.frames else ""
            if abs(age) > limit and role != "surface":
                off = f"{abs(age):.3g} s {'old' if age > 0.0 else 'ahead'} when they arrive"
                yield Finding(
                    False,
                    f"{role}: stamps on {topic} are {off}, over max_input_age {limit:g} s: synchronise the clocks",
                )
            else:
                yield Finding(True, f"{role}: {rate} on {topic}{frames}, stamps {1e3 * age:.0f} ms old")

    def _of_frames(self) -> Iterator[Finding]:
        publish = "publish the fixed transform between the two on /tf_static"
        for reason, sentence in self._estimator.unknown_frames().items():
            choice = "" if reason == Reason.SURFACE_FRAME_UNKNOWN.value else "set the parameter to it, or "
            yield Finding(False, f"frames: {sentence}; {choice}{publish}")
        if frames := self._estimator.transforms.frames():
            yield Finding(True, f"frames: {', '.join(frames)}")

    def _of_load_cell(self) -> Iterator[Finding]:
        rows = np.array(self._forces).reshape(-1, 7)
        dry, wet = rows[rows[:, 0] == 0.0], rows[rows[:, 0] > 0.0]
        if not len(rows):  # the findings before say why
            return
        air = dry[:, 4:].mean(axis=0) if len(dry) >= _ENOUGH else np.zeros(3)
        load = float(np.linalg.norm(air))
        if self._tare:
            tares = f"a replay tares over its first {self._tare:g} s; for the node call ~/tare in the air"
            yield Finding(True, f"load cell: {load:.2f} N in the air; {tares}")
        elif len(dry) < _ENOUGH:
            yield Finding(False, "load cell: the tool was not seen in the air; lift it out of the grains and run again")
        elif load > _FELT:
            advice = "call ~/tare, replay with --tare, or calibrate sensor.bias and sensor.mass"
            yield Finding(False, f"load cell: it reads {load:.2f} N in the air; {advice}")
        else:
            yield Finding(True, f"load cell: {load:.2f} N in the air")
        predicted, measured = wet[:, 1:4].ravel(), (wet[:, 4:] - air).ravel()
        strength = float(np.linalg.norm(predicted) * np.linalg.norm(measured))
        if len(wet) < _ENOUGH or np.abs(predicted).max() < _FELT or strength == 0.0:
            yield Finding(False, "sign: no push was seen; push the tool down into the grains and run again")
            return
        alike = float(predicted @ measured) / strength
        if alike < -_ALIKE:
            sign = -self._estimator.settings.load_cell.sign
            yield Finding(False, f"sign: pushed down, the tool is pulled down; set sensor.sign: {sign:g}")
        elif alike < _ALIKE:
            advice = "check sensor.quaternion, mesh.origin and surface_height"
            yield Finding(
                False, f"sign: measured and predicted force point elsewhere (correlation {alike:.2f}); {advice}"
            )
        else:
            yield Finding(True, f"sign: measured and predicted force agree in direction (correlation {alike:.2f})")

    def _of_reasons(self) -> Iterator[Finding]:
        named = self._estimator.unknown_frames()
        for reason in Reason:
            count = self._estimator.counts[reason.value]
            if reason not in _EXPECTED and reason.value not in named and count > _RARE * max(self._poses, 1):
                yield Finding(False, f"{reason}: {count} times at {self._poses} poses; docs/node.md, Reasons, says why")
        estimates = self._estimator.counts["estimates"]
        advice = "" if estimates else "; mend what stands above first"
        yield Finding(estimates > 0, f"estimates: {estimates} at {self._poses} poses{advice}")
