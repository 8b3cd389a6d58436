"""Replay a recording through the estimator: estimates as a bag and a table, a summary, a report."""

from collections.abc import Callable
from pathlib import Path

from rft_ros.bags.estimates import ReplayTable, write_estimates
from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.playback import play, reasons, tared
from rft_ros.bags.reading import Recording, bag_name, opened_recording
from rft_ros.bags.summary import Summary, statistics, summary_of
from rft_ros.bags.table import is_table
from rft_ros.bags.writing import check_replaceable
from rft_ros.diagnosis import evidence_of, examine
from rft_ros.errors import InputError
from rft_ros.estimator import Estimator
from rft_ros.estimator.pose_jumps import TWO_PUBLISHERS
from rft_ros.estimator.warm_up import needed, prepare
from rft_ros.files import refuse_overwriting, whole_folder
from rft_ros.ground import write_height_map
from rft_ros.parameters import Config, Model, Values, named_files

_JUDGED = 100_000  # rows on which hypotheses about the set-up are judged, so that a long recording needs no more memory
_FILES = ("estimates", "estimates.csv", "summary.json", "report.html", "ground.csv")


def results(out: Path) -> list[Path]:
    """The files and folders that a replay may write to the folder `out`."""
    return [out / name for name in _FILES]


def replay_model(
    parameters: Config | Values, on_cold_cache: Callable[[], None] = lambda: None
) -> Model:
    """Load and compile the model that the parameters describe; it serves any number of replays.

    `on_cold_cache` is called before something compiles.
    """
    config = Config.of(parameters)
    model = config.model()
    prepare(needed(config), on_cold_cache)
    return model


def replay(
    bag: Path,
    out: Path,
    parameters: Config | Values,
    options: ReplayOptions | None = None,
    *,
    model: Model | None = None,
    report: bool = False,
) -> Summary:
    """Play a bag through the estimator and write the results that docs/replay.md describes to the folder `out`.

    `parameters`: all, or some by name. `model`: `replay_model(parameters)`, to share it between replays. The same bag,
    parameters and versions give the same bytes. An earlier replay in the folder is replaced at the end, after success.

    Raises InputError for a bag that cannot be used (`opened_recording`), for an input where results would be written,
    and for a tare that is refused.
    """
    config = Config.of(parameters)
    options = options or ReplayOptions()
    refuse_overwriting(results(out), [bag, *named_files(config)])
    model = model or replay_model(config)
    with_bias = tared(bag, config, model, options)
    check_replaceable(out / "estimates")
    with (
        opened_recording(bag, with_bias, options) as recording,
        whole_folder(out, _FILES) as part,
    ):
        estimator = Estimator(recording.config, model)
        table = ReplayTable(estimator, part)
        others = {
            name: ReplayTable(Estimator(own, model), part)
            for name, own in _compared_configs(recording.config).items()
        }
        for sample, answer in play(recording, estimator):
            if answer is not None:
                table.add(answer)
            for other in others.values():
                its_answer = other.estimator.push(sample)
                if its_answer is not None:
                    other.add(its_answer)
        rows = table.rows()
        if not len(rows):
            why = reasons(recording, estimator)
            what = _what_gives_poses(recording, estimator)
            raise InputError(f"bag '{bag}' has no {what} in the part that is replayed ({why})")
        write_estimates(table, rows, part, shift=recording.shift)
        if estimator.ground is not None:
            write_height_map(part / "ground.csv", estimator.ground)
        evidence = evidence_of(rows[:_JUDGED], estimator)
        faults = []
        if TWO_PUBLISHERS not in table.issues:  # whose poses no judge can tell from noise
            findings = examine(evidence, search="numbers")
            faults += [finding.text for finding in findings if not finding.ok]
        if "wrench" in recording.missing and not is_table(bag):
            there = recording.missing["wrench"]
            faults.append(f"no load cell: nothing on {recording.topics['wrench']}; {there}")
        summary = summary_of(
            rows,
            faults=faults,
            issues=table.issues,
            bag=bag_name(bag),
            topics=recording.topics,
            parameters=recording.config.values,
            bias=recording.config.sensor.bias,
            messages={"pose": len(rows)}
            | {role: recording.counts[role] for role in recording.topics},
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
    named = estimator.config.frames
    frames = ", ".join(estimator.transforms.frames()) or "(none)"
    pose = f"pose of tool_frame '{named.tool}' in world_frame '{named.world}'"
    return f"{pose} from its frames {frames}"


def _compared_configs(config: Config) -> dict[str, Config]:
    """The run that a replay with learning is compared to, by its mode: off beside apply, or the reverse."""
    if config.learning.mode == "off":
        return {}
    mode = "apply" if config.learning.mode == "observe" else "off"
    return {mode: config.changed({"learning.mode": mode})}
