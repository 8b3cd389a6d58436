"""Checks a cell's set-up on its samples: clocks, inputs and frames here, the rest by `rft_ros.diagnosis`."""

import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.bags.estimates import ReplayTable
from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.reading import Recording, opened_recording
from rft_ros.diagnosis import Finding, evidence_of, examine
from rft_ros.doctor.alternation import MIN_JUMPS, Alternation
from rft_ros.estimator import (
    OF_TRANSFORMS,
    STAMP_ZERO,
    Estimator,
    PoseSample,
    Reason,
    Sample,
    Stamped,
    TwistSample,
    WrenchSample,
)
from rft_ros.ground import Cloud
from rft_ros.messages import TOPICS, Role
from rft_ros.parameters import Config, Model, Value
from rft_ros.rft import AXES


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A robot cell as the parameter file `file` describes it.

    `config`: all parameters. `named`: the names of the parameters that the file sets. `model`: made from them,
    with a tool reduced for the judge. `topics`: the topic of each role that is needed.
    """

    file: Path
    config: Config
    named: Collection[str]
    model: Model
    topics: dict[Role, str]


SOONEST_QUANTILE = 0.02  # quantile of the ages at arrival: due to clocks and drivers alone, without delays on the way
# ns on both sides of a step of the clock: a busy machine stands still for less
MIN_SPAN_NS = 1_500_000_000
MIN_REPORTED_SHARE = 0.01  # share of poses: rarer reasons are not reported
MAX_AHEAD_S = 1.5  # s: senders of transforms that change slowly date them ahead by up to this
MIN_PLAYED_AGE_S = 60.0  # s: stamps in a recording that are older come from one that was played
START_NS = 1_000_000_000  # ns in which the first transforms and twists may be missing
_EXPECTED_REASONS = {
    Reason.AT_REST,
    Reason.POSE_HISTORY_SHORT,
    Reason.POSE_RATE_LIMITED,
    Reason.SURFACE_RATE_LIMITED,
}
_SENSOR_REASONS = {
    Reason.WRENCH_FRAME_UNKNOWN,
    Reason.SENSOR_FRAME_UNKNOWN,
    Reason.TF_FRAME_UNKNOWN,
}
_ROLES: dict[type, Role] = {
    PoseSample: "pose",
    TwistSample: "twist",
    WrenchSample: "wrench",
    Cloud: "surface",
}
_ADVICE: dict[Role, str] = {
    "pose": "start the driver, remap ~/pose, or set pose_source: tf",
    "tf": "start the robot's state publisher, or set pose_source: topic",
    "twist": "remap ~/twist",
    "wrench": "start the load cell's driver, or remap ~/wrench_measured; force_torque_sensor_broadcaster publishes"
    " ~/wrench, and ~/wrench_filtered only with filters",
    "surface": "the ground remains the map at the start",
}
_NOT_IN_PART = (
    "the bag has the topic, and no message on it: record it again, or change --start and --end"
)


@dataclass(frozen=True, slots=True)
class _Arrivals:
    """n messages of one sender that have a stamp: times of arrival and stamps [ns], shape [n], as they arrived."""

    topic: str
    arrival: NDArray[np.int64]
    stamp: NDArray[np.int64]

    @property
    def ages(self) -> NDArray[np.float64]:
        """Ages at arrival [s]."""
        return np.asarray(1e-9 * (self.arrival - self.stamp))


def _age_of(ages: NDArray[np.float64]) -> float:
    """The age [s] of messages that were not delayed on their way: the difference of the clocks."""
    return float(np.quantile(ages, SOONEST_QUANTILE)) if len(ages) else 0.0


def delayed(ages: NDArray[np.float64], limit: float) -> bool:
    """Whether messages were delayed on their way by more than a limit [s]. `ages`: at arrival [s], shape [n].

    A wrong clock or a slow driver makes all messages old. A busy machine delays only some of them.
    """
    return len(ages) > 0 and float(np.median(ages) - _age_of(ages)) > limit


class _Words(NamedTuple):
    """What findings on times of arrival say: `name` of that on delays, the `clock`, and so on."""

    name: str
    clock: str
    in_step: str
    arrive: str
    busy: str
    again: str


_IN_STEP = "keep the clocks in step (NTP, PTP) from before the start"
_LIVE_WORDS = _Words(
    name="machine",
    clock="this machine's clock",
    in_step=_IN_STEP,
    arrive="arrive",
    busy="this machine is too busy to judge",
    again="end other work, and run again",
)
_RECORDING_WORDS = _Words(
    name="recording",
    clock="the recorder's clock",
    in_step=f"{_IN_STEP}, or use the part before or after it with --start or --end",
    arrive="were recorded",
    busy="the recorder or the network was behind",
    again="record again, on a machine with less work",
)


def _clock_findings(arrivals: _Arrivals, *, limit: float, words: _Words) -> Iterator[Finding]:
    """A step of a clock, or delays of single messages, by more than `limit` [s]."""
    ages = arrivals.ages
    topic = arrivals.topic
    parts = [ages]
    row = _clock_step(arrivals, limit)
    if row is not None:
        parts = [ages[:row], ages[row:]]
        step = _age_of(parts[0]) - _age_of(parts[1])
        after = 1e-9 * (arrivals.arrival[row] - arrivals.arrival[0])
        sentence = f"the stamps on {topic} step by {step:+.3g} s against {words.clock}, {after:.1f} s after the start"
        yield Finding(name="clock", said=sentence, advice=words.in_step)
    if any(delayed(part, limit) for part in parts):
        spread = f"{1e3 * ages.min():.0f} to {1e3 * ages.max():.0f} ms after their stamps"
        late = f"messages on {topic} {words.arrive} {spread}"
        sentence = f"{late}: {words.busy}, or the driver sends in bursts"
        yield Finding(name=words.name, said=sentence, advice=words.again)


def _clock_step(arrivals: _Arrivals, limit: float) -> int | None:
    """The message before which the clock stepped by more than `limit` [s], also by the soonest messages."""
    ages = arrivals.ages
    arrival = arrivals.arrival
    if len(ages) < 2:
        return None
    row = int(np.abs(np.diff(ages)).argmax()) + 1
    spans = arrival[row - 1] - arrival[0], arrival[-1] - arrival[row]
    if min(spans) < MIN_SPAN_NS or abs(_age_of(ages[:row]) - _age_of(ages[row:])) <= limit:
        return None
    return row


class _Heard(NamedTuple):
    """A message or transform that arrived at a time [ns], with its stamp [ns], its frame, and the frame it places."""

    arrival: int
    stamp: int
    frame: str
    child: str


class Checkup:
    """Finds what is wrong with a cell's set-up from its samples, which are pushed in the order of their arrival.

    `tare`: length of a replay's tare [s]. `live`: the samples arrive now, and not from a recording. `advice`: what
    to do where a role has no messages.
    """

    def __init__(
        self,
        cell: Cell,
        *,
        tare: float | None = None,
        live: bool = True,
        advice: Mapping[Role, str] | None = None,
    ) -> None:
        self._cell = cell
        self._advice = advice or _ADVICE
        self._tare = tare
        self._live = live
        # learning is off, since it would compensate a wrong sign or unit
        self._estimator = Estimator(cell.config.changed({"learning.mode": "off"}), cell.model)
        self._table = ReplayTable(self._estimator)
        self._heard: dict[Role, list[_Heard]] = {role: [] for role in cell.topics}
        self._alternations = {role: Alternation(role) for role in MIN_JUMPS}
        self._poses: list[tuple[float, ...]] = []  # stamp [ns], position and quaternion
        self._unknown_axes: dict[str, None] = {}  # in the order in which they were seen
        self._began = 0
        self._at_start: Counter[Reason] = Counter()  # reasons before the first estimate

    def push(self, sample: Sample, time: int) -> None:
        """Add a sample that arrived at `time` [ns]."""
        self._began = self._began or time
        if isinstance(sample, Stamped):
            heard = [(_ROLES[type(sample)], sample.stamp, sample.frame, "")]
        else:
            heard = [
                ("tf", transform.stamp, "", transform.child)
                for transform in sample
                if not transform.fixed
            ]
        if isinstance(sample, PoseSample):
            self._alternations["pose"].add(sample.position)
        elif isinstance(sample, TwistSample):
            self._alternations["twist"].add((*sample.linear, *sample.angular))
        elif isinstance(sample, WrenchSample):
            self._alternations["wrench"].add(sample.wrench)
            if not all(map(math.isfinite, sample.wrench)):
                axes = zip(AXES, sample.wrench, strict=True)
                self._unknown_axes |= {axis: None for axis, v in axes if not math.isfinite(v)}
        for role, stamp, frame, child in heard:
            if role in self._heard:
                self._heard[role].append(_Heard(time, stamp, frame, child))
        e = self._estimator
        for pose, answer in e.answers(sample):
            self._poses.append((pose.stamp, *pose.position, *pose.quaternion))
            self._table.add(answer)
            if e.estimates == 1 and time - self._began <= START_NS:
                self._at_start = self._at_start or Counter(e.counts)

    def findings(self, *, complete: bool = True) -> list[Finding]:
        """The findings, after the last sample. A cause comes before its effects.

        `complete`: whether every message arrived.
        """
        rows = self._table.rows()
        arrivals = {role: self._arrivals(role) for role in self._cell.topics}
        late = list(self._of_clocks(arrivals))
        # otherwise the node may have received samples that are missing here
        whole = complete and not late
        poses = np.array(self._poses).reshape(-1, 8)
        evidence = evidence_of(rows, self._estimator, poses=poses, tare=self._tare)
        evidence = replace(evidence, named=self._cell.named, complete=whole)
        inputs = [
            self._of_input(role, role_arrivals)
            for role, role_arrivals in arrivals.items()
            if role != "tf_static"  # which `_of_frames` judges
        ]
        mixed_findings = list(self._of_publishers())
        has_clock_step = any(finding.name == "clock" for finding in late)
        judged_findings = [] if mixed_findings or has_clock_step else list(examine(evidence))
        input_findings = [*late, *inputs, *mixed_findings, *self._of_axes()]
        found = [*input_findings, *self._of_frames(), *judged_findings]
        if whole:
            found += self._of_reasons(len(rows))
        made = self._estimator.estimates
        advice = "" if made else "fix the findings above first"
        sentence = f"{made} at {len(rows)} poses"
        return [*found, Finding(name="estimates", ok=made > 0, said=sentence, advice=advice)]

    def _arrivals(self, role: Role) -> dict[str, _Arrivals]:
        """The messages of a role that have a stamp, by the frame that they place: "" but for transforms."""
        times: dict[str, list[tuple[int, int]]] = {}
        for message in self._heard[role]:
            if message.stamp > 0:
                times.setdefault(message.child, []).append((message.arrival, message.stamp))
        return {
            child: _Arrivals(self._cell.topics[role], *np.array(times[child]).T)
            for child in sorted(times)
        }

    def _of_clocks(self, arrivals: Mapping[Role, Mapping[str, _Arrivals]]) -> Iterator[Finding]:
        limit = self._estimator.config.inputs.max_input_age
        words = _LIVE_WORDS if self._live else _RECORDING_WORDS
        for role, role_arrivals in arrivals.items():
            if role != "surface":
                for sent in role_arrivals.values():
                    yield from _clock_findings(sent, limit=limit, words=words)

    def _of_input(self, role: Role, role_arrivals: Mapping[str, _Arrivals]) -> Finding:
        """Whether the messages of a role arrive with stamps near their times. `role_arrivals`: of `_arrivals`."""
        topic = self._cell.topics[role]
        heard = self._heard[role]
        if not heard:
            return Finding(
                name=role,
                ok=role == "surface",
                said=f"nothing on {topic}",
                remedy={"twist_source": "pose_difference"} if role == "twist" else {},
                advice=self._advice[role],
            )
        unstamped_count = sum(1 for message in heard if message.stamp <= 0)
        if unstamped_count:
            sentence = f"{unstamped_count} messages on {topic} have no stamp"
            return Finding(name=role, said=sentence, advice="the driver must set it")
        limit = self._estimator.config.inputs.max_input_age
        ahead = ""
        for child, sent in role_arrivals.items():
            age = _age_of(sent.ages)
            of = f" of '{child}'" if child else ""
            if abs(age) > limit and not self._is_harmless(role, age):
                side = "old" if age > 0.0 else "ahead"
                off = f"stamps{of} on {topic} are {abs(age):.3g} s {side} when they arrive"
                sentence = f"{off}, over max_input_age {limit:g} s"
                return Finding(name=role, said=sentence, advice="synchronise the clocks")
            if child and abs(age) > limit:
                ahead += f"; '{child}' is dated {-age:.2g} s ahead, as it may be"
        seconds = (heard[-1].arrival - heard[0].arrival) * 1e-9
        count = len({message.arrival for message in heard}) if role == "tf" else len(heard)
        rate = f"{(count - 1) / seconds:.0f} Hz" if seconds > 0.0 else "1 message"
        named = " and ".join(sorted({message.frame for message in heard}))
        frame = f", frame {named}" if named else ""
        old = 1e3 * np.median(np.concatenate([sent.ages for sent in role_arrivals.values()]))
        sentence = f"{rate} on {topic}{frame}, stamps {old:.0f} ms old{ahead}"
        return Finding(name=role, ok=True, said=sentence)

    def _is_harmless(self, role: Role, age: float) -> bool:
        """Whether an offset of stamps against the times of arrival [s] changes no estimate."""
        # as of localisation with a tolerance
        is_ahead = role == "tf" and -MAX_AHEAD_S < age < 0.0
        # all messages of a recording that was played and recorded again
        is_played = not self._live and age > MIN_PLAYED_AGE_S
        return role == "surface" or is_ahead or is_played

    def _of_publishers(self) -> Iterator[Finding]:
        """Topics on which two publishers send in turn, by their messages."""
        for role, alternation in self._alternations.items():
            if alternation.is_found:
                topic = self._cell.topics.get(role, TOPICS[role])
                jump = f"{alternation.jump:.3g} {alternation.unit}"
                sentence = (
                    f"the messages on {topic} jump to and fro by {jump}, as of two publishers"
                )
                again = "" if self._live else ", and record again"
                yield Finding(name=role, said=sentence, advice=f"stop one of them{again}")

    def _of_axes(self) -> Iterator[Finding]:
        """Axes on which the load cell gives no number."""
        if self._unknown_axes:
            axes = ", ".join(self._unknown_axes)
            sentence = f"no number on {axes} of {self._cell.topics['wrench']}, but NaN or infinity"
            advice = "check its driver and cable; the other axes are used if all forces are there"
            yield Finding(name="wrench", said=sentence, advice=advice)

    def _of_frames(self) -> Iterator[Finding]:
        unknown = self._estimator.unknown_frames()
        world = self._estimator.config.frames.world
        pose_frames = {message.frame for message in self._heard.get("pose", ())}
        twist_frames = {message.frame for message in self._heard.get("twist", ())}
        if (
            unknown.keys() >= {Reason.POSE_FRAME_UNKNOWN, Reason.TWIST_FRAME_UNKNOWN}
            and pose_frames == twist_frames
        ):
            del unknown[Reason.POSE_FRAME_UNKNOWN], unknown[Reason.TWIST_FRAME_UNKNOWN]
            named = " and ".join(map(repr, sorted(pose_frames)))
            yield Finding(
                name="frames",
                said=f"poses and twists have frame_id {named}, which is not world_frame {world!r}",
                remedy={"world_frame": min(pose_frames)},
                advice="publish the transform between the two on /tf_static",
            )
        proposal = self._proposed_frames() if _SENSOR_REASONS & unknown.keys() else None
        if proposal:
            yield proposal
            unknown = {
                reason: sentence
                for reason, sentence in unknown.items()
                if reason not in _SENSOR_REASONS
            }
        for reason, sentence in unknown.items():
            if reason in OF_TRANSFORMS and self._transforms_unstamped():
                continue  # the frames are unknown because their transforms have no stamps; another finding says so
            if reason is not Reason.TF_OUT_OF_ORDER:  # `_of_reasons` reports it if it is frequent
                yield Finding(name="frames", said=sentence)
        frames = self._estimator.transforms.frames()
        if frames:
            sentence = ", ".join(frames)
            yield Finding(name="frames", ok=True, said=f"{sentence}{self._place_of_sensor()}")

    def _place_of_sensor(self) -> str:
        """The sensor's place by the transforms, as parameters, for a node that reads no transforms; "" if not known."""
        frames = self._estimator.config.frames
        place = self._estimator.transforms.fixed(frames.tool, frames.sensor)
        if frames.sensor_source != "tf" or place is None:
            return ""
        # a micrometre and a microradian
        position, quaternion = (
            "[" + ", ".join(f"{number:.6f}" for number in numbers) + "]" for numbers in place
        )
        return f"; that is sensor.position: {position} and sensor.quaternion: {quaternion}"

    def _proposed_frames(self) -> Finding | None:
        """The names of the load cell's and the tool's frame by what the messages and the transforms say.

        None if the parameters name them, or if the readings have several frames. The tool's is that of the twists, if
        it carries the load cell, or else tool0, as industrial arms call their flange, or the nearest one below it.
        """
        named = self._estimator.config.frames
        frames = {message.frame for message in self._heard.get("wrench", ())}
        if len(frames) != 1:
            return None
        (sensor,) = frames
        remedy: dict[str, Value] = {}
        sentence = f"the load cell's readings are in the frame '{sensor}'"
        advice = ""
        if sensor != named.sensor:
            remedy["sensor_frame"] = sensor
            sentence += f", which is not sensor_frame '{named.sensor}'"
        carriers = self._estimator.transforms.carriers(sensor)
        if carriers and named.tool not in carriers:
            twist_frames = {message.frame for message in self._heard.get("twist", ())}
            twist_carriers = [name for name in carriers if name in twist_frames]
            named_carriers = [name for name in carriers if name == "tool0"]
            tool = [*twist_carriers, *named_carriers, *carriers][0]
            remedy["tool_frame"] = tool
            links = ", ".join(self._estimator.transforms.links(tool, sensor))
            sentence += f"; the transforms place it on '{tool}' ({links}), and not on tool_frame '{named.tool}'"
            others = " or ".join(repr(name) for name in carriers if name != tool)
            if others:
                advice = (
                    f"tool_frame is the one whose poses are published; it may also be {others}"
                )
        if not remedy:
            return None
        if carriers and not {"sensor.position", "sensor.quaternion"} & set(self._cell.named):
            remedy["sensor.frame_source"] = "tf"
        return Finding(name="frames", said=sentence, remedy=remedy, advice=advice)

    def _transforms_unstamped(self) -> bool:
        """Whether most transforms have no stamp, which the finding on their topic reports."""
        heard = self._heard.get("tf", ())
        return 2 * sum(1 for message in heard if message.stamp <= 0) > len(heard)

    def _of_reasons(self, poses: int) -> Iterator[Finding]:
        named = self._estimator.unknown_frames().keys() - {Reason.TF_OUT_OF_ORDER}
        if _SENSOR_REASONS & named or not self._heard.get("wrench"):
            named |= {Reason.WRENCH_MISSING}  # the findings on frames or on the topic say why
        if not self._heard.get("twist"):
            named |= {Reason.TWIST_MISSING}
        counts = self._estimator.counts
        for reason in Reason:
            is_explained = reason in _EXPECTED_REASONS or reason in named or reason in STAMP_ZERO
            is_explained |= reason in OF_TRANSFORMS and self._transforms_unstamped()
            count = counts[reason] - self._at_start[reason]
            if reason is Reason.WRENCH_MISSING:  # of the poses before the first reading
                count -= sum(
                    1 for stamp, *_ in self._poses if stamp - self._poses[0][0] < START_NS
                )
            if not is_explained and count > MIN_REPORTED_SHARE * max(poses, 1):
                yield Finding(
                    name=reason.value, said=f"{count} times at {poses} poses: {reason.sentence}"
                )


def examine_bag(cell: Cell, bag: Path, options: ReplayOptions) -> list[Finding]:
    """The findings on a recording of the cell. Raises InputError for a bag that cannot be used.

    Where the topic of poses or load cell is missing, and the bag has one other of its type, it is judged with that one.
    """
    with opened_recording(bag, cell.config, options, strict=False) as recording:
        if not recording.proposals:
            return _findings_on(recording, cell, options)
    missing = [
        Finding(
            name=role,
            said=f"nothing on {recording.topics[role]}",
            remap=f"{TOPICS[role]}:={topic}",
            advice=f"{recording.missing[role]}; what follows is judged with it",
        )
        for role, topic in recording.proposals.items()
    ]
    rules = [finding.remap for finding in missing]
    remapped_options = replace(options, remap=(*options.remap, *rules))
    return [*missing, *examine_bag(cell, bag, remapped_options)]


def _findings_on(recording: Recording, cell: Cell, options: ReplayOptions) -> list[Finding]:
    """The findings on an open recording, which it reads to its end."""
    as_recorded = replace(cell, config=recording.config, topics=recording.topics)
    advice: dict[Role, str] = dict.fromkeys(_ADVICE, _NOT_IN_PART)
    checkup = Checkup(
        as_recorded,
        tare=options.tare,
        live=False,
        advice={**advice, **recording.missing},
    )
    for sample in recording:
        checkup.push(sample, recording.time)
    found = [Finding(name=role, said=sentence) for role, sentence in recording.mistyped.items()]
    if recording.damage:
        found.append(Finding(name="bag", said=recording.damage))
    return [*found, *checkup.findings()]
