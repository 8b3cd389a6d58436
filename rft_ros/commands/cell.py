"""Commands that run or check a robot cell: `rft demo`, `rft doctor` and `rft warm-up`."""

import argparse
import shlex
from collections.abc import Sequence
from pathlib import Path

from rft_ros.bags.options import (
    REPLAY_SECTION,
    ReplayOptions,
    merged_rules,
    read_replay_options,
    topics_of,
)
from rft_ros.bags.replay import replay
from rft_ros.commands import options
from rft_ros.commands.machine_code import load_code
from rft_ros.diagnosis import TOOL_TOLERANCE_SHARE, Finding
from rft_ros.doctor.checkup import Cell, examine_bag
from rft_ros.errors import InputError
from rft_ros.installation import program, share_directory
from rft_ros.parameters import Value, named_files, node_parameters, read_parameter_file
from rft_ros.parameters.file import write_changed
from rft_ros.progress import busy, line_if_long


def doctor_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "params", type=Path, metavar="FILE.yaml", help="the node's own parameter file"
    )
    command.add_argument(
        "--bag", type=Path, metavar="BAG", help=f"{options.RECORDING} (default: listen to ROS)"
    )
    options.share(command, "--node", "--remap", "--columns")
    seconds = "longest time to listen to ROS [s] (default 30); it ends once air, press and drags were seen"
    command.add_argument("--seconds", type=options.number, default=30.0, metavar="S", help=seconds)
    write = "write the parameter file with the values that mend the findings, but for those with several causes"
    command.add_argument("--write", dest="output", type=Path, metavar="NEW.yaml", help=write)


def doctor(arguments: argparse.Namespace) -> int:
    """rft doctor my_cell.yaml --bag recording
    rft doctor my_cell.yaml --bag recording --write mended.yaml
    rft doctor my_cell.yaml --remap ~/pose:=/tool_pose --seconds 10
    """
    if arguments.seconds <= 0.0:
        raise InputError(f"--seconds is {arguments.seconds:g}; it must be over 0")
    config, chosen = options.recording(arguments)
    if arguments.output:
        options.refuse_inputs(arguments, arguments.output, also=named_files(config))
    topics = topics_of(config, chosen.remap, chosen.node)
    named = node_parameters(arguments.params, chosen.node)
    with busy("preparing the tool"):
        # as coarse as the judge makes it for its fits: no estimate is printed
        model = config.changed({"tolerance": TOOL_TOLERANCE_SHARE}).model()
    load_code()  # of the node, too, so that its start is quick
    cell = Cell(file=arguments.params, config=config, named=named, model=model, topics=topics)
    if arguments.bag:
        with line_if_long(f"examining {arguments.bag}"):
            findings = examine_bag(cell, arguments.bag, chosen)
    else:
        try:
            from rft_ros.doctor.running import examine_running
        except ImportError as error:
            needs = f"listening needs ROS 2 ({error.name} is missing)"
            raise InputError(f"{needs}: source a ROS 2 setup file, or give --bag") from None
        findings = examine_running(
            cell,
            chosen.node,
            seconds=arguments.seconds,
            needs_node=arguments.node is not None,
        )
    for finding in findings:
        print(_label(finding), finding.text)
    if arguments.output:
        _write_remedies(arguments, findings, node=chosen.node)
    return 0 if all(finding.ok for finding in findings) else 1


def _label(finding: Finding) -> str:
    if finding.is_note:
        return "NOTE"
    return "OK " if finding.ok else "FIX"


def _write_remedies(
    arguments: argparse.Namespace, findings: Sequence[Finding], *, node: str
) -> None:
    """Write the parameter file with the remedies, but for those beside which other explanations fit alike.

    Rules of topics, also those of the command line, are written for replay and calibration.
    """
    changes: dict[str, Value] = {}
    unsure = []
    for finding in findings:
        if finding.alike:
            unsure.append(finding.name)
        else:
            changes |= finding.remedy
    rules = [*arguments.remap, *(finding.remap for finding in findings if finding.remap)]
    others = {}
    if rules:
        written = read_replay_options(arguments.params).remap
        others[REPLAY_SECTION] = {"remap": merged_rules(written, rules)}
    write_changed(arguments.output, arguments.params, changes, node=node, others=others)
    sentence = f"-> {arguments.output} with {', '.join([*changes, *rules]) or 'no change'}"
    if unsure:
        sentence += (
            f"; nothing was written for {', '.join(unsure)}, which several causes explain alike"
        )
    print(sentence)


def demo_options(command: argparse.ArgumentParser) -> None:
    out = "folder for bag and report (default out/demo)"
    seconds = "how long the arm moves [s] (default 12)"
    command.add_argument(
        "-o", "--output", type=Path, default=Path("out/demo"), metavar="DIR", help=out
    )
    command.add_argument("--seconds", type=options.number, default=12.0, metavar="S", help=seconds)


def demo(arguments: argparse.Namespace) -> int:
    """rft demo --seconds 20 -o out/demo"""
    try:
        from rft_ros.demo.run import demo as run
    except ImportError as error:
        raise InputError(
            f"the demo needs ROS 2 ({error.name} is missing): source a ROS 2 setup file, or run"
            " pip install ros-jazzy-common-interfaces 'ros-rclpy[fastrtps]'"
        ) from None

    parameters = share_directory("rft_ros") / "config" / "demo.yaml"
    tare = 2.0  # s at the beginning, in which the arm rests in the air
    bag = arguments.output / "bag"
    out = arguments.output / "replay"
    run(bag, parameters, seconds=arguments.seconds)
    same = ["replay", str(bag), "--params", str(parameters), "--tare", f"{tare:g}", "-o", str(out)]
    print(f"the same offline: {program()} {shlex.join(same)}")
    values = read_parameter_file(parameters).values
    summary = replay(bag, out, values, ReplayOptions(tare=tare), report=True)
    print("\n".join([*summary.lines(), f"-> {out / 'report.html'}"]))
    return 0


def warm_up_options(_command: argparse.ArgumentParser) -> None:
    pass


def warm_up(_arguments: argparse.Namespace) -> int:
    """rft warm-up"""
    load_code()
    print("everything is compiled")
    return 0
