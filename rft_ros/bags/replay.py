"""A recording through the estimator: estimates as a bag and a table, a summary, a report."""

import json
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from rft_ros.bags.doubt_counts import counted_flags
from rft_ros.bags.motion import Motion
from rft_ros.bags.phases import Phase, Phases
from rft_ros.bags.progress import with_progress
from rft_ros.bags.reading import Recording
from rft_ros.bags.remapping import remapped_topics
from rft_ros.bags.replay_options import ReplayOptions, read_replay_options
from rft_ros.bags.statistics import statistics
from rft_ros.bags.summary import Summary
from rft_ros.bags.table import COLUMNS, ending, row
from rft_ros.bags.trace import Trace, packed
from rft_ros.bags.writing import BagWriter
from rft_ros.errors import InputError, reason_of
from rft_ros.estimator import Estimate, Estimator, Model, NoEstimate, PoseSample, Reason, Settings, TwistSample, Wrench
from rft_ros.estimator.messages import Role, Sample
from rft_ros.estimator.parameters import Values, model_of, settings_of
from rft_ros.estimator.warm_up import warm_up

__all__ = ["COLUMNS", "ReplayOptions", "read_replay_options", "replay", "replay_model"]


def replay_model(values: Values) -> Model:
    """The model of the parameters, ready to answer; one serves any number of replays."""
    model = model_of(values)
    warm_up(model)
    return model


def replay(
    bag: Path,
    out: Path,
    values: Values,
    *,
    remap: Sequence[str] = (),
    tare: float | None = None,
    start: float | None = None,
    end: float | None = None,
    model: Model | None = None,
    report: bool = False,
    figures: bool = False,
    label: str | None = None,
) -> Summary:
    """Push a bag's samples through the estimator and write what comes out to the folder `out`.

    `values`: the node's parameters (`read_parameter_file`). `remap`, `tare`, `start`, `end`: as in `ReplayOptions`.
    `model`: `replay_model(values)`, if it is at hand. `label`: what the progress bar says, if not the bag's name.

    Writes ``estimates/`` (rosbag2, MCAP), ``estimates.csv`` (`COLUMNS`), ``summary.json`` and ``wall.json``; with
    `report` ``report.html``, with `figures` its figures as PNG. All but wall.json are the same, byte for byte, for the
    same bag, parameters and versions. A bag that cannot be used is an InputError (`Recording` lists what that can be),
    and so is a tare that the estimator refuses.
    """
    ReplayOptions(remap=tuple(remap), tare=tare, start=start, end=end)  # refuses spans that cannot be
    topics = remapped_topics(remap)
    if values["twist_source"] != "topic":
        del topics["twist"]
    if bag.resolve() in (out.resolve(), (out / "estimates").resolve()):
        raise InputError(f"bag '{bag}' lies where its own results would be written; choose another output folder")
    model = model or replay_model(values)

    began = time.perf_counter()
    if tare is not None:
        values = {**values, "sensor.bias": _bias(bag, topics, settings_of(values), model, start or 0.0, tare)}
    settings = settings_of(values)
    estimator = Estimator(settings, model)
    motion = Motion(estimator)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with Trace(out) as trace:
            with Recording(bag, topics, start=start, end=end) as recording:
                _answer_all(recording, estimator, motion, trace, out, label or bag.name)
            if not recording.counts["pose"]:
                why = f" ({recording.damage})" if recording.damage else ""
                raise InputError(f"bag '{bag}' has no message on {topics['pose']} in the part that is replayed{why}")
            whole, phases = statistics(trace)
            quality_flags, trust = counted_flags(trace)
            estimator.counts.pop("estimates", 0)
            summary = Summary(
                bag=bag.resolve().name,
                topics=topics,
                parameters=dict(values),
                bias=settings.load_cell.bias,
                messages={role: recording.counts[role] for role in topics},
                estimates=whole.estimates,
                reasons=dict(sorted(estimator.counts.items())),
                unknown_frames=dict(sorted(estimator.unknown_frames().items())),
                quality_flags=quality_flags,
                trust=trust,
                duration=(recording.time - recording.first) * 1e-9,
                damage=recording.damage,
                wrench=whole.wrench,
                rms_over_peak=whole.rms_over_peak,
                median_relative_error=whole.median_relative_error,
                phases=phases,
                seconds=time.perf_counter() - began,
            )
            (out / "summary.json").write_text(summary.json(), encoding="utf-8")
            wall = {"seconds": summary.seconds, "real_time_factor": summary.real_time_factor}
            (out / "wall.json").write_text(json.dumps(wall, indent=2) + "\n", encoding="utf-8")
            if report or figures:
                from rft_ros.bags.illustrated import draw

                draw(summary, trace, model, out, vertical=motion.vertical_axis(), page=report, pictures=figures)
    except OSError as error:
        raise InputError(f"output folder '{out}' cannot be written: {reason_of(error)}") from None
    return summary


def _answer_all(
    recording: Recording, estimator: Estimator, motion: Motion, trace: Trace, out: Path, label: str
) -> None:
    """Every sample into the estimator; every answer into table, bag and trace."""
    frame = estimator.settings.sensor_frame
    phases: Phases[_Row] = Phases(estimator.settings.rest_speed)
    with BagWriter(out / "estimates") as writer, (out / "estimates.csv").open(
        "w", encoding="utf-8", newline="\n"
    ) as table:  # fmt: skip
        table.write(",".join(COLUMNS) + "\n")

        def settle(rows: list[tuple[_Row, Phase | None]]) -> None:
            for (stamp, begun, quality_flags, numbers, state), phase in rows:
                table.write(begun + ending(phase, quality_flags))
                if numbers is not None:
                    trace.add(stamp, phase, numbers, state)

        for sample in with_progress(recording, label):
            answer = _push(estimator, sample)
            if answer is None:
                continue
            depth, moment = motion.after(answer)
            numbers = None if depth is None else packed(depth, answer)
            quality_flags = 0
            if isinstance(answer, Estimate):
                quality_flags = answer.quality_flags
                _write(writer, frame, answer)
            begun = (sample.stamp, row(depth, answer), quality_flags, numbers, estimator.state.tobytes())
            settle(phases.push(begun, moment))
        settle(phases.finish())


_Row = tuple[int, str, int, bytes | None, bytes]
"""Stamp [ns], the table's row as far as it is known, quality_flags, what goes into the trace, and the state."""


def _push(estimator: Estimator, sample: Sample) -> Estimate | NoEstimate | None:
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
        turned_away = "".join(f", {counted}" for counted in estimator.counted())
        raise InputError(f"bag '{bag}': {error} (of the first {seconds:g} s{turned_away})") from None


def _write(writer: BagWriter, frame: str, estimate: Estimate) -> None:
    writer.write_wrench("/rft/wrench_predicted", estimate.stamp, frame, estimate.predicted)
    if estimate.compensated is not None and estimate.residual is not None:
        writer.write_wrench("/rft/wrench_compensated", estimate.stamp, frame, estimate.compensated)
        writer.write_wrench("/rft/wrench_residual", estimate.stamp, frame, estimate.residual)
