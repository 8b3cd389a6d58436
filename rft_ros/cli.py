"""The command ``rft``: works without ROS. Exit status 0 done, 1 failed, 2 wrong usage or unusable input."""

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rft_ros.errors import InputError

__all__ = ["main"]

# Each command imports what it needs when it runs, so that `rft --help` answers at once.


def _predict(arguments: argparse.Namespace) -> int:
    from rft_ros.estimator.alpha_y_table import read_alpha_y_table
    from rft_ros.rft import ALPHA_Y_MODELS, alpha_y_model, medium_named, treers2021, wrenches
    from rft_ros.states_file import read_states, write_wrenches
    from rft_ros.tool import load_tool

    times, states = read_states(arguments.states)
    tool = load_tool(arguments.mesh, scale=arguments.scale, origin=arguments.origin)
    for finding in tool.findings:
        print(f"warning: {tool.name}: {finding.message}", file=sys.stderr)
    named = arguments.alpha_y in ALPHA_Y_MODELS and arguments.alpha_y != "table"
    try:
        medium = medium_named(arguments.medium)
        table = None if named else read_alpha_y_table(arguments.alpha_y)
        law = treers2021(
            medium, alpha_y_model(arguments.alpha_y if named else "table", medium, table), zeta=arguments.zeta
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    write_wrenches(arguments.output, times, wrenches(tool.plates, law, states, surface_height=arguments.surface_height))
    print(f"{len(states)} states, {len(tool.plates)} plates of {tool.name} -> {arguments.output}")
    return 0


def _check_mesh(arguments: argparse.Namespace) -> int:
    from rft_ros.tool import describe_tool, load_tool

    tool = load_tool(arguments.file, scale=arguments.scale, origin=arguments.origin)
    print("\n".join(describe_tool(tool)))
    return 1 if tool.findings else 0


def _replay(arguments: argparse.Namespace) -> int:
    from rft_ros.bags.replay import ReplayOptions, read_replay_options, replay
    from rft_ros.estimator.parameter_file import read_parameter_file
    from rft_ros.estimator.parameters import defaults

    file = arguments.params
    values = read_parameter_file(file) if file else defaults()
    options = read_replay_options(file) if file else ReplayOptions()
    given = {name: getattr(arguments, name) for name in ("tare", "start", "end")}
    summary = replay(
        arguments.bag,
        arguments.output,
        values,
        remap=[*options.remap, *arguments.remap],
        **{name: getattr(options, name) if value is None else value for name, value in given.items()},
    )
    print("\n".join(summary.lines()))
    return 0


def _demo(arguments: argparse.Namespace) -> int:
    try:
        from rft_ros.node.demo import demo
    except ImportError as error:
        raise InputError(f"the demo needs ROS 2 ({error.name} is missing): pip install 'rft_ros[ros]'") from None
    return demo(arguments.output, seconds=arguments.seconds)


def _finite(text: str) -> float:
    value = float(text)
    if value != value or value in (float("inf"), float("-inf")):
        raise argparse.ArgumentTypeError(f"'{text}' is not a finite number")
    return value


def _mesh_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--scale", type=_finite, default=0.001, metavar="M", help="metres per mesh unit (default 0.001)"
    )
    command.add_argument(
        "--origin",
        type=_finite,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X", "Y", "Z"),
        help="where the tool frame's origin lies, in mesh-file coordinates and units (default 0 0 0)",
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="rft",
        description="The wrench that dry granular material puts on a moving tool, by 3D Resistive Force Theory.",
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, run: Callable[[argparse.Namespace], int], text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(run=run)
        return sub

    predict = command("predict", _predict, "Wrench at each state of a CSV file.")
    predict.add_argument("states", type=Path, metavar="STATES.csv", help="header t,px,py,pz,qx,qy,qz,qw,vx,..,wz (SI)")
    predict.add_argument("--mesh", required=True, metavar="FILE", help="path, package:// URI or name of a shipped mesh")
    _mesh_options(predict)
    predict.add_argument("--medium", default="generic", metavar="NAME", help="medium (default generic)")
    predict.add_argument("--zeta", type=_finite, default=1.0, help="the medium's scale factor (default 1.0)")
    predict.add_argument(
        "--alpha-y", default="constant", metavar="MODEL", help="constant, linear or a TABLE.csv (default constant)"
    )
    predict.add_argument("--surface-height", type=_finite, default=0.0, metavar="Z", help="world z of the surface [m]")
    predict.add_argument("--integration", default="centroid", choices=("centroid",), help="rule for the plates")
    predict.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.csv", help="t,fx,fy,fz,tx,ty,tz")

    check = command("check-mesh", _check_mesh, "Say what a mesh file holds and what is wrong with it.")
    check.add_argument("file", metavar="FILE", help="path, package:// URI or name of a shipped mesh")
    _mesh_options(check)

    replay = command("replay", _replay, "Run a recorded bag through the estimator.")
    replay.add_argument(
        "bag", type=Path, metavar="BAG", help="rosbag2 folder (MCAP or sqlite3), .mcap file, ROS 1 .bag"
    )
    replay.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the results")
    replay.add_argument("--params", type=Path, metavar="FILE.yaml", help="the node's own parameter file")
    replay.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="as ~/pose:=/tool_pose; may be repeated"
    )
    replay.add_argument("--tare", type=_finite, metavar="S", help="take the load cell's bias from the first S seconds")
    replay.add_argument("--start", type=_finite, metavar="S", help="begin S seconds into the bag")
    replay.add_argument("--end", type=_finite, metavar="S", help="stop S seconds into the bag")

    demo = command("demo", _demo, "A virtual arm, a real node, the live table (needs ROS: pip install 'rft_ros[ros]').")
    demo.add_argument("-o", "--output", type=Path, default=Path("out/demo"), metavar="DIR", help="default out/demo")
    demo.add_argument("--seconds", type=_finite, default=12.0, help="how long the arm moves (default 12)")
    return parser


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    parsed = _parser().parse_args(arguments)
    try:
        status: int = parsed.run(parsed)
        return status
    except InputError as error:
        print(f"rft {parsed.command}: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"rft {parsed.command}: interrupted", file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
