"""Replay a recording through the estimator: estimates as a bag and a table, a summary, a report."""

import time
from collections import Counter, deque
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import fields, replace
from pathlib import Path
from typing import NamedTuple

from rft_ros.bags.estimates import COLUMNS, LEARNED_COLUMNS, Trace, csv_row, learned_numbers
from rft_ros.bags.phases import LowestPoint, Phase, Phases
from rft_ros.bags.playback import ReplayOptions, play, topics_of, unposed
from rft_ros.bags.reading import Recording, bag_name
from rft_ros.bags.statistics import Group, count_flags, statistics
from rft_ros.bags.summary import Summary, warnings_of
from rft_ros.bags.writing import BagWriter, check_replaceable
from rft_ros.errors import InputError
from rft_ros.estimator import (
    Estimate,
    Estimator,
    Measurement,
    Model,
    NoEstimate,
    Reason,
    Sample,
    Settings,
    Wrench,
    WrenchSample,
)
from rft_ros.estimator.messages import Role
from rft_ros.estimator.warm_up import code_of, prepare
from rft_ros.files import refuse_overwriting, whole_folder
from rft_ros.ground import write_height_map
from rft_ros.parameters import Values, model_of, named_files, settings_of

__all__ = ["GROUND", "replay", "replay_model", "results"]

GROUND = "ground.csv"
"""The ground at the end, for `ground.file`."""

_SECOND_LAG = 0.005
_METRICS = ("rms_over_peak", "median_relative_error", "within_sigma", "within_two_sigma")

# what a replay may write beside estimates/
_FILES = ("estimates.csv", "summary.json", "report.html", GROUND)


def results(out: Path) -> list[Path]:
    """What a replay may write to the folder `out`."""
    return [out / name for name in ("estimates", *_FILES)]


def replay_model(values: Values) -> Model:
    """Load and compile the model that the parameters describe; it serves any number of replays."""
    model = model_of(values)
    prepare(code_of(model, settings_of(values)))
    return model


def replay(
    bag: Path,
    out: Path,
    values: Values,
    options: ReplayOptions | None = None,
    *,
    model: Model | None = None,
    report: bool = False,
    label: str | None = None,
) -> Summary:
    """Play a bag through the estimator and write the results to the folder `out`.

    `values`: the node's parameters (`read_parameter_file`). `options`: None for the whole bag without tare. `model`:
    `replay_model(values)`, to share it between replays. `label`: of the progress bar (default: bag name).

    Writes ``estimates/`` (rosbag2, MCAP), ``estimates.csv`` (`COLUMNS`) and ``summary.json``; with a map
    of the ground `GROUND`, with `report` ``report.html``. The same bag, parameters and versions give the same bytes.
    Rows and messages are in the order in which the poses arrived; each message has its pose's
    stamp. An earlier replay in `out` is replaced as a whole, at the end.

    Raises InputError for a bag that cannot be used (`Recording`), for an input where the results would be written, and
    for a tare that is refused.
    """
    options = options or ReplayOptions()
    topics = topics_of(values, options.remap)
    refuse_overwriting(results(out), [bag, *named_files(values)])
    model = model or replay_model(values)

    began = time.perf_counter()
    if options.tare:
        bias = _bias(bag, topics, settings_of(values), model, options.start or 0.0, options.tare)
        values = {**values, "sensor.bias": bias}
    settings = settings_of(values)
    estimator = Estimator(settings, model)
    motion = LowestPoint(estimator)
    check_replaceable(out / "estimates")
    with whole_folder(out, ("estimates", *_FILES)) as part, ExitStack() as traces:
        trace = traces.enter_context(Trace(part))
        learning_errors = _LearningErrors(settings, model, traces, part)
        with Recording(bag, topics, start=options.start, end=options.end) as recording:
            label = label or bag_name(bag)
            issues = _write_estimates(recording, estimator, motion, trace, part, label, learning_errors)
        if not recording.counts["pose"]:
            why = f" ({recording.damage})" if recording.damage else ""
            what = f"message on {topics['pose']}" if "pose" in topics else unposed(estimator)
            raise InputError(f"bag '{bag}' has no {what} in the part that is replayed{why}")
        if estimator.ground is not None:
            write_height_map(part / GROUND, estimator.ground)
        rows = trace.rows()
        whole, phases = statistics(rows)
        quality_flags, trust = count_flags(rows)
        estimator.counts.pop("estimates", 0)
        summary = Summary(
            **{field.name: getattr(whole, field.name) for field in fields(Group)},
            bag=bag_name(bag),
            topics=topics,
            parameters=dict(values),
            bias=settings.load_cell.bias,
            messages={role: recording.counts[role] for role in ("pose", *topics)},
            reasons=dict(sorted(estimator.counts.items())),
            unknown_frames=dict(sorted(estimator.unknown_frames().items())),
            quality_flags=quality_flags,
            trust=trust,
            duration=(recording.time - recording.first) * 1e-9,
            damage=recording.damage,
            warnings=warnings_of(whole, phases, issues),
            learning=learning_errors.finish(),
            phases=phases,
            seconds=time.perf_counter() - began,
        )
        (part / "summary.json").write_text(summary.json(), encoding="utf-8")
        if report:
            from rft_ros.bags.replay_report import draw

            vertical = motion.vertical_axis()
            draw(summary, rows, model, part / "report.html", vertical=vertical, ground=estimator.ground)
    return summary


class _LearningErrors:
    """Runs beside a replay, by name: without learning, with learning at `learning_lag`, and with a lag of 5 mm.

    No runs if `learning_mode` is off. `traces` closes their scratch files, which are in `folder`.
    """

    def __init__(self, settings: Settings, model: Model, traces: ExitStack, folder: Path) -> None:
        runs = {"off": replace(settings, learning_mode="off")}
        for lag in (settings.learning_lag, _SECOND_LAG):
            runs[f"{1e3 * lag:g} mm"] = replace(settings, learning_mode="apply", learning_lag=lag)
        self._runs = {
            name: (Estimator(own, model), traces.enter_context(Trace(folder)), deque[Estimate]())
            for name, own in (runs.items() if settings.learning_mode != "off" else ())
        }

    def push(self, sample: Sample) -> None:
        """Push a sample of the replay into every run."""
        for estimator, trace, waiting in self._runs.values():
            answer = estimator.push(sample)
            if isinstance(answer, Estimate):
                waiting.append(answer)
            self._collect(estimator, trace, waiting)

    def _collect(self, estimator: Estimator, trace: Trace, waiting: deque[Estimate]) -> None:
        for measurement in estimator.measurements():
            # depth and state are those of a later pose; `finish` uses neither
            trace.add(estimator.depth(), waiting.popleft(), measurement, None, estimator.state.tobytes())

    def finish(self) -> dict[str, dict[str, float | None]]:
        """Metrics of `Group` over all estimates of each run, after the last sample; by name of the run and the metric.

        No prediction uses its own load-cell sample.
        """
        found = {}
        for name, (estimator, trace, waiting) in self._runs.items():
            estimator.finish()
            self._collect(estimator, trace, waiting)
            group, _ = statistics(trace.rows())
            found[name] = {metric: getattr(group, metric) for metric in _METRICS}
        return found


class _Row(NamedTuple):
    """A pose's answer, depth of the tool's lowest point [m] if known, the estimator's state, `learned_numbers`."""

    answer: Estimate | NoEstimate
    depth: float | None
    state: bytes
    learned: tuple[float, ...]


def _write_estimates(
    recording: Recording,
    estimator: Estimator,
    motion: LowestPoint,
    trace: Trace,
    out: Path,
    label: str,
    learning_errors: _LearningErrors,
) -> Counter[str]:
    """Play the recording; write each pose to table, bag and trace once its phase and measurement are known.

    Returns at how many poses learning had each of its issues.
    """
    issues: Counter[str] = Counter()
    phases: Phases[_Row] = Phases(estimator.settings.rest_speed)
    waiting: deque[tuple[_Row, Phase | None]] = deque()
    measurements: deque[Measurement] = deque()
    frame = estimator.settings.sensor_frame
    with BagWriter(out / "estimates") as writer, (out / "estimates.csv").open(
        "w", encoding="utf-8", newline="\n"
    ) as table:  # fmt: skip
        table.write(",".join(COLUMNS + (LEARNED_COLUMNS if estimator.learning else ())) + "\n")

        def write_complete_rows() -> None:
            measurements.extend(estimator.measurements())
            while waiting and (measurements or isinstance(waiting[0][0].answer, NoEstimate)):
                (answer, depth, state, learned), phase = waiting.popleft()
                measurement = None
                if isinstance(answer, Estimate):
                    measurement = measurements.popleft()
                    _write(writer, frame, answer, measurement)
                table.write(csv_row(depth, answer, measurement, phase, learned))
                if depth is not None:
                    trace.add(depth, answer, measurement, phase, state, learned)

        for sample, answer in play(recording, estimator, label):
            learning_errors.push(sample)
            if answer is not None:
                depth, moment = motion.after(answer)
                learned = learned_numbers(estimator.learning.belief()) if estimator.learning else ()
                issues.update(map(str, estimator.learning.issues()) if estimator.learning else ())
                waiting.extend(phases.push(_Row(answer, depth, estimator.state.tobytes(), learned), moment))
                write_complete_rows()
        waiting.extend(phases.finish())
        write_complete_rows()
    return issues


def _write(writer: BagWriter, frame: str, estimate: Estimate, measurement: Measurement) -> None:
    writer.write_wrench("/rft/wrench_predicted", estimate.stamp, frame, estimate.predicted)
    writer.write_wrench("/rft/wrench_sigma", estimate.stamp, frame, estimate.sigma)
    if measurement.compensated is not None and measurement.residual is not None:
        writer.write_wrench("/rft/wrench_compensated", estimate.stamp, frame, measurement.compensated)
        writer.write_wrench("/rft/wrench_residual", estimate.stamp, frame, measurement.residual)


def _bias(
    bag: Path, topics: Mapping[Role, str], settings: Settings, model: Model, start: float, seconds: float
) -> Wrench:
    """The estimator's tare over the first `seconds`, beginning at the first pose with a known velocity."""
    estimator = Estimator(settings, model)
    begin = newest = 0
    with Recording(bag, topics, start=start, end=start + seconds) as recording:
        for sample, answer in play(recording, estimator, bag_name(bag)):
            if isinstance(sample, WrenchSample):
                newest = sample.stamp
            elif answer is not None and not begin and (isinstance(answer, Estimate) or answer.reason is Reason.AT_REST):
                begin = answer.stamp
    try:
        return estimator.tare((newest - begin) * 1e-9 if 0 < begin < newest else seconds)
    except InputError as error:
        reasons = "".join(f", {counted}" for counted in estimator.counted())
        where = f"of the first {seconds:g} s, surface_height {settings.surface_height:g} m{reasons}"
        raise InputError(f"bag '{bag}': {error} ({where})") from None
