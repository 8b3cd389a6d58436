"""Check a cell's set-up: inputs, frames, QoS, load cell, surface, mesh, running node.

rft doctor my_cell.yaml --bag recording
rft doctor my_cell.yaml --remap ~/pose:=/tool_pose --seconds 10
"""

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands.options import BAG, number_option, recording, remap_option
from rft_ros.errors import InputError
from rft_ros.progress import busy

if TYPE_CHECKING:
    from rft_ros.bags.checkup import Finding
    from rft_ros.parameters import Model, Settings


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("params", type=Path, metavar="FILE.yaml", help="the node's own parameter file")
    command.add_argument("--bag", type=Path, metavar="BAG", help=f"{BAG} (default: listen to ROS)")
    command.add_argument("--node", default="/rft", metavar="NAME", help="the node with its namespace (default /rft)")
    remap_option(command)
    number_option(command, "--seconds", "S", "how long to listen to ROS [s] (default 5)", 5.0)


def run(arguments: argparse.Namespace) -> int:
    """Check; exit status 1 if something is to be done."""
    from rft_ros.bags.checkup import Checkup
    from rft_ros.bags.playback import topics_of
    from rft_ros.bags.reading import Recording
    from rft_ros.parameters import model_of, node_parameters, settings_of

    arguments.node = "/" + arguments.node.strip("/")
    values, options = recording(arguments)
    topics = topics_of(values, options.remap, arguments.node)
    named = node_parameters(arguments.params, arguments.node)
    with busy("preparing the tool"):
        model = model_of({**values, "tolerance": 0.0})
    findings = [_compiled(model, settings_of(values))]
    if arguments.bag:
        checkup = Checkup(values, model, named=named, topics=topics, tare=options.tare)
        with Recording(arguments.bag, topics, start=options.start, end=options.end, optional=tuple(topics)) as messages:
            checkup.push(messages.fixed, messages.first)
            for sample in messages:
                checkup.push(sample, messages.time)
    else:
        try:
            from rft_ros.node.listen import Listener
        except ImportError as error:
            raise InputError(
                f"listening needs ROS 2 ({error.name} is missing): source a ROS 2 setup file, or give --bag"
            ) from None
        with ExitStack() as stack:
            stack.enter_context(busy(f"listening for {arguments.seconds:g} s"))
            listener = stack.enter_context(Listener(arguments.node))
            finding, bias = listener.compare(values, arguments.params)
            checkup = Checkup({**values, "sensor.bias": bias}, model, named=named, topics=topics)
            findings += [finding, *listener.listen(topics, arguments.seconds, checkup.push)]
    findings += checkup.findings()
    print("\n".join(map(str, findings)))
    return 0 if all(finding.ok for finding in findings) else 1


def _compiled(model: "Model", settings: "Settings") -> "Finding":
    from rft_ros.bags.checkup import Finding
    from rft_ros.estimator.warm_up import code_of, prepare

    def stop() -> None:
        raise InputError("run rft warm-up, or the node's first start compiles for some ten seconds")

    try:
        prepare(code_of(model, settings), on_cold_cache=stop)
    except InputError as error:
        return Finding(False, f"compiled: no; {error}")
    return Finding(True, "compiled: yes")
