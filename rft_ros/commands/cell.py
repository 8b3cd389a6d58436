"""Commands around the running node: check a cell's set-up, show a virtual one, compile beforehand."""

import argparse
from pathlib import Path

from rft_ros.bags.playback import ReplayOptions, topics_of
from rft_ros.bags.reading import Recording
from rft_ros.bags.replay import replay
from rft_ros.calibration.checkup import Checkup, Finding
from rft_ros.commands import options
from rft_ros.errors import InputError
from rft_ros.estimator.warm_up import needed, prepare
from rft_ros.installation import program, share_directory
from rft_ros.parameters import Values, model_of, node_parameters, read_parameter_file
from rft_ros.progress import busy


def doctor_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("params", type=Path, metavar="FILE.yaml", help="the node's own parameter file")
    command.add_argument("--bag", type=Path, metavar="BAG", help=f"{options.BAG} (default: listen to ROS)")
    command.add_argument("--node", default="/rft", metavar="NAME", help="the node with its namespace (default /rft)")
    options.share(command, "--remap")
    seconds = "how long to listen to ROS [s] (default 5)"
    command.add_argument("--seconds", type=options.number, default=5.0, metavar="S", help=seconds)


def doctor(arguments: argparse.Namespace) -> int:
    """rft doctor my_cell.yaml --bag recording
    rft doctor my_cell.yaml --remap ~/pose:=/tool_pose --seconds 10
    """
    if arguments.seconds <= 0.0:
        raise InputError(f"--seconds is {arguments.seconds:g}; it must be over 0")
    arguments.node = "/" + arguments.node.strip("/")
    values, chosen = options.recording(arguments)
    topics = topics_of(values, chosen.remap, arguments.node)
    named = node_parameters(arguments.params, arguments.node)
    with busy("preparing the tool"):
        model = model_of({**values, "tolerance": 0.0})
    findings = [_compiled(values)]
    if arguments.bag:
        checkup = Checkup(values, model, named=named, topics=topics, tare=chosen.tare)
        with Recording(arguments.bag, topics, start=chosen.start, end=chosen.end, optional=tuple(topics)) as messages:
            for sample in messages:
                checkup.push(sample, messages.time)
        if messages.damage:
            findings.append((False, f"bag: {messages.damage}"))
    else:
        try:
            from rft_ros.node.listen import listener
        except ImportError as error:
            needs = f"listening needs ROS 2 ({error.name} is missing)"
            raise InputError(f"{needs}: source a ROS 2 setup file, or give --bag") from None
        with busy(f"listening for {arguments.seconds:g} s"), listener(arguments.node) as ros:
            finding, bias = ros.compare(values, arguments.params)
            checkup = Checkup({**values, "sensor.bias": bias}, model, named=named, topics=topics)
            findings += [finding, *ros.listen(topics, arguments.seconds, checkup.push)]
    findings += checkup.findings()
    print("\n".join(f"{'OK ' if ok else 'FIX'} {text}" for ok, text in findings))
    return 0 if all(ok for ok, _ in findings) else 1


def _compiled(values: Values) -> Finding:
    def stop() -> None:
        raise InputError("run rft warm-up, or the node's first start compiles for some ten seconds")

    try:
        prepare(needed(values), on_cold_cache=stop)
    except InputError as error:
        return False, f"compiled: no; {error}"
    return True, "compiled: yes"


def demo_options(command: argparse.ArgumentParser) -> None:
    out, seconds = "folder for bag and report (default out/demo)", "how long the arm moves [s] (default 12)"
    command.add_argument("-o", "--output", type=Path, default=Path("out/demo"), metavar="DIR", help=out)
    command.add_argument("--seconds", type=options.number, default=12.0, metavar="S", help=seconds)
    feels = "a simulated arm that feels the node's forces (needs mujoco)"
    command.add_argument("--mujoco", action="store_true", help=feels)


def demo(arguments: argparse.Namespace) -> int:
    """rft demo --seconds 20 -o out/demo
    rft demo --mujoco -o out/demo_mujoco
    """
    try:
        from rft_ros.node.demo import demo as run
    except ImportError as error:
        raise InputError(
            f"the demo needs ROS 2 ({error.name} is missing): source a ROS 2 setup file, or run"
            " pip install ros-jazzy-common-interfaces 'ros-rclpy[fastrtps]'"
        ) from None

    parameters = share_directory("rft_ros") / "config" / ("mujoco_arm.yaml" if arguments.mujoco else "demo.yaml")
    tare = 1.5 if arguments.mujoco else 2.0  # s in which the arm rests in the air
    bag, out = arguments.output / "bag", arguments.output / "replay"
    run(bag, parameters, seconds=arguments.seconds, mujoco=arguments.mujoco)
    print(f"the same offline: {program()} replay {bag} --params {parameters} --tare {tare:g} -o {out}")
    summary = replay(bag, out, read_parameter_file(parameters), ReplayOptions(tare=tare), report=True)
    print("\n".join([*summary.lines(), f"-> {out / 'report.html'}"]))
    return 0


def warm_up(_arguments: argparse.Namespace) -> int:
    """rft warm-up"""
    prepare(on_cold_cache=lambda: print("compiling, ten seconds or more ...", flush=True))
    print("everything is compiled")
    return 0
