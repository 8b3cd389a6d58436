"""The command that runs recorded bags through the estimator."""

import argparse
import sys
from pathlib import Path

from rft_ros.bags.reading import bag_name, check_recordings
from rft_ros.bags.replay import replay as run
from rft_ros.bags.replay import replay_model, results
from rft_ros.bags.summary import Summary, check, read_limits
from rft_ros.commands import options, warnings
from rft_ros.errors import InputError
from rft_ros.estimator import Reason
from rft_ros.parameters import named_files
from rft_ros.progress import busy, say_compiling


def replay_options(command: argparse.ArgumentParser) -> None:
    several = f"{options.RECORDING}; with several bags, each gets a folder below DIR"
    command.add_argument("bag", type=Path, nargs="+", metavar="BAG", help=several)
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the results"
    )
    options.share(command, *options.RECORDING_OPTIONS)
    tare = "take the load cell's bias from the first S seconds; 0: none (default: the parameter file's, else none)"
    command.add_argument("--tare", type=options.number, metavar="S", help=tare)
    limits = "exit with 1 if a metric of a bag's summary is outside its limits"
    command.add_argument("--check", type=Path, metavar="LIMITS.yaml", help=limits)
    command.add_argument("--no-report", action="store_true", help="write no report.html")


def replay(arguments: argparse.Namespace) -> int:
    """rft replay out/demo/bag --params config/demo.yaml --tare 2 -o out/replay"""
    bags = arguments.bag
    out = arguments.output
    limits = read_limits(arguments.check) if arguments.check else {}
    config, chosen = options.recording(arguments)
    folders = [out / name for name in folder_names(bags)] if len(bags) > 1 else [out]
    written = [file for folder in folders for file in results(folder)]
    options.refuse_inputs(arguments, *written, also=named_files(config))
    if (
        len(bags) == 1
    ):  # of several, a bag that cannot be used does not keep the others from theirs
        check_recordings(bags, config, chosen)
    with busy("preparing the tool"):
        model = replay_model(config, on_cold_cache=say_compiling)
    print(f"model: {model.in_words}", flush=True)
    warnings.warn_of(model.tool)
    warnings.warn_of_law(model.law)

    status = 0
    for bag, folder in zip(bags, folders, strict=True):
        try:
            summary = run(bag, folder, config, chosen, model=model, report=not arguments.no_report)
        except InputError as error:
            if len(bags) == 1:
                raise
            print(f"rft replay: {error}", file=sys.stderr, flush=True)
            status = 1
            continue
        print("\n".join(summary.lines()))
        print(
            f"-> {folder / ('summary.json' if arguments.no_report else 'report.html')}", flush=True
        )
        status |= _status(summary, limits)
    return status


def folder_names(bags: list[Path]) -> list[str]:
    """A unique folder name for each bag: the bag's name without suffix, followed by "_2" if it is taken."""
    names: list[str] = []
    for bag in bags:
        name = Path(bag_name(bag)).stem if bag.is_file() else bag_name(bag)
        while name in names:
            name += "_2"
        names.append(name)
    return names


def _status(summary: Summary, limits: dict[str, tuple[float, float]]) -> int:
    """Exit status: 1 if a limit is exceeded, or if the bag has no estimate. Prints the limits, or an error."""
    checks = check(limits, summary)
    if checks:
        print("\n".join([f"{summary.bag}: limits", *(line for _, line in checks)]), flush=True)
    status = int(not all(kept for kept, _ in checks))
    if not summary.estimates:
        status = 1
        why = ""
        if summary.reasons:
            reason = max(summary.reasons, key=summary.reasons.__getitem__)
            in_words = f"{reason}: {Reason(reason).sentence}"
            why = f"; most often {summary.unknown_frames.get(reason, in_words)}"
        none = (
            f"bag '{summary.bag}' has no estimate for its {summary.messages['pose']:,} poses{why}"
        )
        print(f"rft replay: {none}", file=sys.stderr, flush=True)
    return status
