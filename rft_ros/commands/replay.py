"""Run recorded bags through the estimator.

rft replay out/demo/bag --params config/demo.yaml --tare 2 -o out/replay
"""

import argparse
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands.options import (
    BAG,
    number_option,
    output_option,
    recording,
    recording_options,
    refuse_inputs,
    warn_of,
)
from rft_ros.errors import InputError
from rft_ros.progress import busy

if TYPE_CHECKING:
    from rft_ros.bags.limits import Limit
    from rft_ros.bags.summary import Summary


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("bag", type=Path, nargs="+", metavar="BAG", help=f"{BAG}; several get a folder each below DIR")
    output_option(command, "DIR", "folder for the results")
    recording_options(command)
    tare = "take the load cell's bias from the first S seconds; 0: none (default: the parameter file's, else none)"
    number_option(command, "--tare", "S", tare)
    command.add_argument(
        "--check", type=Path, metavar="LIMITS.yaml", help="exit with 1 if a metric of a bag's summary exceeds a limit"
    )
    command.add_argument("--no-report", action="store_true", help="write no report.html")


def run(arguments: argparse.Namespace) -> int:
    from rft_ros.bags.batch import comparison_lines, folder_names, replay_each
    from rft_ros.bags.limits import read_limits
    from rft_ros.bags.replay import replay, replay_model, results
    from rft_ros.parameters import named_files

    limits = read_limits(arguments.check) if arguments.check else []
    values, options = recording(arguments)
    folders = [arguments.output / name for name in folder_names(arguments.bag)]
    for folder in folders if len(folders) > 1 else [arguments.output]:
        refuse_inputs(arguments, *results(folder), also=named_files(values))
    with busy("preparing the tool"):  # the first call compiles
        model = replay_model(values)
    warn_of(model.tool)

    one = partial(replay, values=values, options=options, model=model, report=not arguments.no_report)
    if len(arguments.bag) == 1:
        summary = one(arguments.bag[0], arguments.output)
        print("\n".join(summary.lines()), flush=True)
        print(f"-> {arguments.output / ('summary.json' if arguments.no_report else 'report.html')}")
        return max(_checked({summary.bag: summary}, limits), _empty(summary))
    summaries = {}
    for name, outcome in replay_each(arguments.bag, arguments.output, one):
        if isinstance(outcome, InputError):
            print(f"rft replay: {outcome}", file=sys.stderr, flush=True)
        else:
            print("\n".join(outcome.lines()), flush=True)
            summaries[name] = outcome
    failed = len(summaries) < len(arguments.bag)
    print("\n".join([f"{len(summaries)} of {len(arguments.bag)} bags replayed", *comparison_lines(summaries)]))
    empty = max(map(_empty, summaries.values()), default=0)
    return max(_checked(summaries, limits), empty, 1 if failed else 0)


def _empty(summary: "Summary") -> int:
    """Print an error for a bag without any estimate; exit status 1 for it."""
    if summary.estimates:
        return 0
    poses, why = summary.messages["pose"], ""
    if summary.reasons:
        reason = max(summary.reasons, key=summary.reasons.__getitem__)
        why = f"; most often {summary.unknown_frames.get(reason, reason)}"
    print(f"rft replay: bag '{summary.bag}' has no estimate for its {poses:,} poses{why}", file=sys.stderr, flush=True)
    return 1


def _checked(summaries: "dict[str, Summary]", limits: "list[Limit]") -> int:
    from rft_ros.bags.limits import check, limit_lines

    kept = True
    for name, summary in summaries.items() if limits else ():
        checks = check(limits, summary)
        print("\n".join([f"{name}: limits", *limit_lines(checks)]))
        kept &= all(limit.allows(value) for limit, value in checks)
    return 0 if kept else 1
