"""`rft doctor`: check a cell's set-up, from a recording or beside the running node."""

import argparse
import re
from pathlib import Path

from rft_ros.bags.options import topics_of
from rft_ros.commands import options
from rft_ros.doctor.checkup import Cell, compiled, examine_bag
from rft_ros.errors import InputError
from rft_ros.parameters import model_of, node_parameters
from rft_ros.progress import busy

_ROS_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+")


def doctor_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("params", type=Path, metavar="FILE.yaml", help="the node's own parameter file")
    command.add_argument("--bag", type=Path, metavar="BAG", help=f"{options.RECORDING} (default: listen to ROS)")
    command.add_argument("--node", default="/rft", metavar="NAME", help="the node with its namespace (default /rft)")
    options.share(command, "--remap")
    seconds = "time to listen to ROS [s] (default 5)"
    command.add_argument("--seconds", type=options.number, default=5.0, metavar="S", help=seconds)


def doctor(arguments: argparse.Namespace) -> int:
    """rft doctor my_cell.yaml --bag recording
    rft doctor my_cell.yaml --remap ~/pose:=/tool_pose --seconds 10
    """
    if arguments.seconds <= 0.0:
        raise InputError(f"--seconds is {arguments.seconds:g}; it must be over 0")
    arguments.node = "/" + arguments.node.strip("/")
    if not _ROS_NAME.fullmatch(arguments.node):
        raise InputError(f"--node is '{arguments.node}'; a ROS name has letters, digits and underscores, such as /rft")
    values, chosen = options.recording(arguments)
    topics = topics_of(values, chosen.remap, arguments.node)
    named = node_parameters(arguments.params, arguments.node)
    with busy("preparing the tool"):
        model = model_of({**values, "tolerance": 0.0})
    cell = Cell(file=arguments.params, values=values, named=named, model=model, topics=topics)
    findings = [compiled()]
    if arguments.bag:
        findings += examine_bag(cell, arguments.bag, chosen)
    else:
        try:
            from rft_ros.doctor.running import examine_running
        except ImportError as error:
            needs = f"listening needs ROS 2 ({error.name} is missing)"
            raise InputError(f"{needs}: source a ROS 2 setup file, or give --bag") from None
        with busy(f"listening for {arguments.seconds:g} s"):
            findings += examine_running(cell, arguments.node, seconds=arguments.seconds)
    print("\n".join(f"{'OK ' if finding.ok else 'FIX'} {finding.text}" for finding in findings))
    return 0 if all(finding.ok for finding in findings) else 1
