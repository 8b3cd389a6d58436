"""Replay a recording through the estimator: estimates as a bag and a table, a summary, a report."""

from dataclasses import replace
from pathlib import Path

from rft_ros.bags.estimates import Run, write_estimates
from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.playback import play, reasons
from rft_ros.bags.reading import Recording, bag_name
from rft_ros.bags.summary import Summary, statistics, summary_of
from rft_ros.bags.writing import check_replaceable
from rft_ros.diagnosis import evidence_of, judge
from rft_ros.errors import InputError
from rft_ros.estimator import Estimate, Estimator, Reason, WrenchSample
from rft_ros.estimator.warm_up import needed, prepare
from rft_ros.files import refuse_overwriting, whole_folder
from rft_ros.ground import write_height_map
from rft_ros.parameters import Model, Settings, Values, model_of, named_files, settings_of
from rft_ros.rft.frames import Wrench

_SECOND_LAG = 0.005
_JUDGED = 100_000  # rows on which hypotheses about the set-up are judged, so that a long recording needs no more memory
_FILES = ("estimates", "estimates.csv", "summary.json", "report.html", "ground.csv")


def results(out: Path) -> list[Path]:
    """The files and folders that a replay may write to the folder `out`."""
    return [out / name for name in _FILES]


def replay_model(values: Values) -> Model:
    """Load and compile the model that the parameters describe; it serves any number of replays."""
    model = model_of(values)
    prepare(needed(values))
    return model


def replay(
    bag: Path,
    out: Path,
    values: Values,
    options: ReplayOptions | None = None,
    *,
    model: Model | None = None,
    report: bool = False,
) -> Summary:
    """Play a bag through the estimator and write the results that docs/replay.md describes to the folder `out`.

    `model`: `replay_model(values)`, to share it between replays. The same bag, parameters and versions give the same
    bytes. An earlier replay in the folder is replaced at the end, after success.

    Raises InputError for a bag that cannot be used (`Recording`), for an input where the results would be written, and
    for a tare that is refused.
    """
    options = options or ReplayOptions()
    refuse_overwriting(results(out), [bag, *named_files(values)])
    recording = Recording(bag, values, options)
    model = model or replay_model(values)
    used = dict(recording.values)
    if options.tare:
        used["sensor.bias"] = _bias(bag, used, model, options)
    settings = settings_of(used)
    estimator = Estimator(settings, model)
    check_replaceable(out / "estimates")
    with whole_folder(out, _FILES) as part:
        run = Run(estimator, part)
        others = {
            name: Run(Estimator(own, model), part)
            for name, own in _learning_settings(settings).items()
        }
        for sample, answer in play(recording, estimator):
            if answer is not None:
                run.add(answer)
            for other in others.values():
                its_answer = other.estimator.push(sample)
                if its_answer is not None:
                    other.add(its_answer)
        if not recording.counts["pose"]:
            why = reasons(recording, estimator)
            what = _what_gives_poses(recording, estimator)
            raise InputError(f"bag '{bag}' has no {what} in the part that is replayed ({why})")
        rows = run.rows()
        write_estimates(run, rows, part, shift=recording.shift)
        if estimator.ground is not None:
            write_height_map(part / "ground.csv", estimator.ground)
        evidence = evidence_of(rows[:_JUDGED], estimator)
        summary = summary_of(
            rows,
            faults=[finding.text for finding in judge(evidence) if not finding.ok],
            issues=run.issues,
            bag=bag_name(bag),
            topics=recording.topics,
            parameters=used,
            bias=settings.load_cell.bias,
            messages={role: recording.counts[role] for role in ("pose", *recording.topics)},
            reasons={reason.value: n for reason, n in sorted(estimator.counts.items())},
            unknown_frames={
                reason.value: said for reason, said in sorted(estimator.unknown_frames().items())
            },
            duration=(recording.time - recording.first) * 1e-9,
            damage=recording.damage,
            learning={name: statistics(other.rows())[0] for name, other in others.items()},
        )
        (part / "summary.json").write_text(summary.json(), encoding="utf-8")
        if report:
            from rft_ros.bags.replay_report import draw

            draw(summary, rows, estimator, part / "report.html")
    return summary


def _what_gives_poses(recording: Recording, estimator: Estimator) -> str:
    if "tf" not in recording.topics:
        return f"message on {recording.topics.get('pose')}"
    settings = estimator.settings
    frames = ", ".join(estimator.transforms.frames()) or "(none)"
    pose = f"pose of tool_frame '{settings.tool_frame}' in world_frame '{settings.world_frame}'"
    return f"{pose} from its frames {frames}"


def _learning_settings(settings: Settings) -> dict[str, Settings]:
    """Settings of the runs that a replay with learning is compared to, by name.

    One without learning, one with `learning_lag`, and one with a lag of 5 mm.
    """
    if settings.learning_mode == "off":
        return {}
    found = {"off": replace(settings, learning_mode="off")}
    for lag in (settings.learning_lag, _SECOND_LAG):
        found[f"{1e3 * lag:g} mm"] = replace(settings, learning_mode="apply", learning_lag=lag)
    return found


def _bias(bag: Path, values: Values, model: Model, options: ReplayOptions) -> Wrench:
    """The bias by a tare over the first seconds. It begins at the first pose with a known velocity."""
    start = options.start or 0.0
    seconds = options.tare or 0.0
    settings = settings_of(values)
    estimator = Estimator(settings, model)
    begin = newest = 0
    recording = Recording(bag, values, replace(options, start=start, end=start + seconds))
    for sample, answer in play(recording, estimator):
        if isinstance(sample, WrenchSample):
            newest = sample.stamp
        elif isinstance(answer, Estimate) or (
            answer is not None and answer.reason is Reason.AT_REST
        ):
            begin = begin or answer.stamp
    try:
        return estimator.tare((newest - begin) * 1e-9 if 0 < begin < newest else seconds)
    except InputError as error:
        where = f"of the first {seconds:g} s, surface_height {settings.surface_height:g} m"
        raise InputError(
            f"bag '{bag}': {error} ({where}; {reasons(recording, estimator)})"
        ) from None
