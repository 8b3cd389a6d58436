"""A recording through the estimator: estimates as a bag and a table, a summary, a figure."""

import json
import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rft_ros.bags.progress import with_progress
from rft_ros.bags.reading import Recording
from rft_ros.bags.remapping import remapped_topics
from rft_ros.bags.summary import AXES, Summary, WrenchStatistics
from rft_ros.bags.writing import BagWriter
from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, Estimator, Model, PoseSample, Reason, Settings, TwistSample, Withheld, Wrench
from rft_ros.estimator.messages import Role, Sample
from rft_ros.estimator.parameter_file import node_parameters
from rft_ros.estimator.parameters import Values, model_of, settings_of
from rft_ros.estimator.pose_difference import PoseDifference
from rft_ros.estimator.warm_up import warm_up
from rft_ros.rft import rotation_matrix, unit_quaternion

__all__ = ["COLUMNS", "ReplayOptions", "read_replay_options", "replay"]

COLUMNS = (
    "t",
    "depth",
    "speed",
    *(f"{kind}_{axis}" for kind in ("predicted", "compensated", "residual") for axis in AXES),
    "reason",
    "generation",
)
"""estimates.csv, a row for each pose: header stamp [s], depth of the tool's lowest point below the surface [m],
negative above it, speed of its fastest plate [m/s], wrenches in the sensor frame [N], [N m]; or the reason for none."""

_SECTION = "rft_replay"

_UNPLACED = {
    Reason.POSE_NOT_FINITE,
    Reason.POSE_QUATERNION_NOT_UNIT,
    Reason.POSE_FRAME_UNKNOWN,
    Reason.POSE_STAMP_ZERO,
    Reason.POSE_REPEATED,
    Reason.POSE_OUT_OF_ORDER,
}
"""Reasons for which a pose does not say where the tool is now."""

_SIX = ",%.9g" * 6
_FULL = "%d.%09d,%.9g,%.9g" + 3 * _SIX + ",,%d\n"
_WITHOUT_WRENCH = "%d.%09d,%.9g,%.9g" + _SIX + 12 * "," + ",,%d\n"


@dataclass(frozen=True, slots=True, kw_only=True)
class ReplayOptions:
    """What a replay needs beside the node's parameters: as in `replay`."""

    remap: tuple[str, ...] = ()
    tare: float | None = None
    start: float | None = None
    end: float | None = None


def read_replay_options(file: Path) -> ReplayOptions:
    """The options under ``rft_replay: ros__parameters:`` of a parameter file, if any; the node passes them over."""
    section = node_parameters(file, (_SECTION,))
    remap = section.pop("remap", ())
    if not isinstance(remap, list | tuple) or not all(isinstance(rule, str) for rule in remap):
        raise InputError(f"parameter file '{file}': {_SECTION} remap is {remap!r}; it must be a list of strings")
    for name, value in section.items():
        if name not in ("tare", "start", "end"):
            raise InputError(f"parameter file '{file}': {_SECTION} has no '{name}'; it has remap, tare, start, end")
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"parameter file '{file}': {_SECTION} {name} is {value!r}; it must be a number [s]")
    return ReplayOptions(remap=tuple(remap), **section)


def replay(
    bag: Path,
    out: Path,
    values: Values,
    *,
    remap: Sequence[str] = (),
    tare: float | None = None,
    start: float | None = None,
    end: float | None = None,
) -> Summary:
    """Push a bag's samples through the estimator and write what comes out to the folder `out`.

    `values`: the node's parameters (`read_parameter_file`). `remap`: rules such as ``~/pose:=/tool_pose``. `tare`: take
    the load cell's bias from this many seconds at the beginning. `start`, `end`: use this part of the bag only [s].

    Writes ``estimates/`` (rosbag2, MCAP), ``estimates.csv`` (`COLUMNS`), ``summary.json``, ``wall.json`` and
    ``replay.png``; all but wall.json are the same, byte for byte, for the same bag and parameters. A bag that cannot be
    used is an InputError (`Recording` lists what that can be), and so is a tare that the estimator refuses.
    """
    for name, seconds in (("start", start), ("end", end), ("tare", tare)):
        if seconds is not None and not 0.0 <= seconds <= 1e9:
            raise InputError(f"{name} is {seconds} s; it must be a number of seconds from 0 on")
    topics = remapped_topics(remap)
    if values["twist_source"] != "topic":
        del topics["twist"]
    if bag.resolve() == (out / "estimates").resolve():
        raise InputError(f"bag '{bag}' lies where its own estimates would be written; choose another output folder")
    model = model_of(values)
    warm_up(model)

    began = time.perf_counter()
    if tare is not None:
        values = {**values, "sensor.bias": _bias(bag, topics, settings_of(values), model, start or 0.0, tare)}
    settings = settings_of(values)
    estimator = Estimator(settings, model)
    overall, penetration = WrenchStatistics(), WrenchStatistics()
    try:
        out.mkdir(parents=True, exist_ok=True)
        with (
            Recording(bag, topics, start=start, end=end) as recording,
            BagWriter(out / "estimates") as writer,
            (out / "estimates.csv").open("w", encoding="utf-8", newline="\n") as table,
        ):
            table.write(",".join(COLUMNS) + "\n")
            motion = _Motion(settings, model)
            for sample in with_progress(recording, bag.name):
                answer = _push(estimator, sample)
                if answer is None:
                    continue
                assert isinstance(sample, PoseSample)
                depth, sinking = motion.push(sample, answer)
                table.write(_row(sample.stamp, depth, answer))
                if isinstance(answer, Estimate):
                    _write(writer, settings.sensor_frame, answer)
                    overall.add(answer)
                    if sinking and answer.submerged_area > 0.0:
                        penetration.add(answer)
    except OSError as error:
        raise InputError(f"output folder '{out}' cannot be written: {error}") from None
    seconds = time.perf_counter() - began
    if not recording.counts["pose"]:
        why = f" ({recording.damage})" if recording.damage else ""
        raise InputError(f"bag '{bag}' has no message on {topics['pose']} in the part that is replayed{why}")

    estimates = estimator.counts.pop("estimates", 0)
    summary = Summary(
        bag=bag.resolve().name,
        topics=topics,
        parameters=dict(values),
        bias=settings.load_cell.bias,
        messages={role: recording.counts[role] for role in topics},
        estimates=estimates,
        withheld=dict(sorted(estimator.counts.items())),
        duration=(recording.time - recording.first) * 1e-9,
        damage=recording.damage,
        wrench=overall.axes(),
        penetration=penetration.axes(AXES[:3]),
        penetration_estimates=penetration.estimates,
        seconds=seconds,
    )
    (out / "summary.json").write_text(summary.json(), encoding="utf-8")
    wall = {"seconds": seconds, "real_time_factor": summary.real_time_factor}
    (out / "wall.json").write_text(json.dumps(wall, indent=2) + "\n", encoding="utf-8")

    from rft_ros.report.replay_figure import draw_replay

    draw_replay(out / "estimates.csv", out / "replay.png", title=summary.bag, vertical=motion.vertical_axis())
    return summary


def _push(estimator: Estimator, sample: Sample) -> Estimate | Withheld | None:
    if isinstance(sample, PoseSample):
        return estimator.push_pose(sample)
    if isinstance(sample, TwistSample):
        estimator.push_twist(sample)
    else:
        estimator.push_wrench(sample)
    return None


def _bias(
    bag: Path, topics: Mapping[Role, str], settings: Settings, model: Model, start: float, seconds: float
) -> Wrench:
    """The estimator's tare over the first `seconds`, from the first pose on whose velocity is known."""
    estimator = Estimator(settings, model)
    begin = newest = 0
    with Recording(bag, topics, start=start, end=start + seconds) as recording:
        for sample in recording:
            answer = _push(estimator, sample)
            if answer is None:
                newest = sample.stamp
            elif not begin and (isinstance(answer, Estimate) or answer.reason is Reason.AT_REST):
                begin = sample.stamp
    try:
        return estimator.tare((newest - begin) * 1e-9 if 0 < begin < newest else seconds)
    except InputError as error:
        turned_away = "".join(f", {reason}: {n}" for reason, n in sorted(estimator.counts.items()))
        raise InputError(f"bag '{bag}': {error} (of the first {seconds:g} s{turned_away})") from None


class _Motion:
    """Where the tool is and whether it goes down, by its poses."""

    def __init__(self, settings: Settings, model: Model) -> None:
        self._settings = settings
        self._tool = model.tool
        self._difference = PoseDifference()
        self._difference.span(window=settings.twist_window, max_age=settings.max_input_age)
        self._newest = 0
        self._deepest = -math.inf
        self._up = np.array([0.0, 0.0, 1.0])

    def push(self, pose: PoseSample, answer: Estimate | Withheld) -> tuple[float | None, bool]:
        """Depth of the lowest point below the surface [m], None if the pose does not tell; whether it goes down."""
        quaternion = unit_quaternion(*pose.quaternion)
        if quaternion is None or (isinstance(answer, Withheld) and answer.reason in _UNPLACED):
            return None, False
        if pose.stamp < self._newest:  # a time jump
            self._difference.reset()
        self._newest = pose.stamp
        known = self._difference.push(pose)
        rotation = rotation_matrix(quaternion)
        depth = self._settings.surface_height - pose.position[2] - self._tool.lowest_point(rotation)
        if depth > self._deepest:
            self._deepest, self._up = depth, rotation[2]
        return depth, known and bool(-self._difference.twist[2] >= self._settings.rest_speed)

    def vertical_axis(self) -> tuple[str, str]:
        """The sensor axis nearest to vertical where the tool was deepest, and where it points."""
        up = self._up @ rotation_matrix(self._settings.load_cell.quaternion)
        axis = int(np.argmax(np.abs(up)))
        return "xyz"[axis], "up" if up[axis] > 0.0 else "down"


def _row(stamp: int, depth: float | None, answer: Estimate | Withheld) -> str:
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    if isinstance(answer, Withheld):
        place = "" if depth is None else f"{depth:.9g}"
        return f"{seconds}.{nanoseconds:09d},{place}{20 * ','}{answer.reason.value},\n"
    head = (seconds, nanoseconds, depth, answer.speed, *answer.predicted)
    if answer.compensated is None or answer.residual is None:
        return _WITHOUT_WRENCH % (*head, answer.generation)
    return _FULL % (*head, *answer.compensated, *answer.residual, answer.generation)


def _write(writer: BagWriter, frame: str, estimate: Estimate) -> None:
    writer.write_wrench("/rft/wrench_predicted", estimate.stamp, frame, estimate.predicted)
    if estimate.compensated is not None and estimate.residual is not None:
        writer.write_wrench("/rft/wrench_compensated", estimate.stamp, frame, estimate.compensated)
        writer.write_wrench("/rft/wrench_residual", estimate.stamp, frame, estimate.residual)
