"""Fit load cell, surface, ζ, α_y and velocity weights to recorded bags."""

import argparse
from pathlib import Path

from rft_ros.commands.options import finite
from rft_ros.errors import InputError

__all__ = ["add_options", "run"]


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument("bags", type=Path, nargs="+", metavar="BAG", help="rosbag2 folder, .mcap file, ROS 1 .bag")
    command.add_argument("--params", type=Path, required=True, metavar="FILE.yaml", help="the node's parameter file")
    command.add_argument("-o", "--output", type=Path, required=True, metavar="CALIBRATED.yaml", help="what to write")
    command.add_argument(
        "--fit",
        action="append",
        metavar="PART",
        help="fit only sensor, surface, zeta, mobilization, alpha_y or weights (f1, f23), and exit with 1 if the data"
        " cannot tell it; may be repeated (default: whatever they tell)",
    )
    command.add_argument(
        "--alpha-y",
        choices=("auto", "constant", "linear", "table"),
        default="auto",
        help="α_y over β (default auto: linear where the data are sure of a slope, else constant)",
    )
    command.add_argument(
        "--mesh",
        action="append",
        default=[],
        metavar="BAG=FILE",
        help="mesh of the tool in the bag of that name, where it is not the parameter file's; may be repeated",
    )
    command.add_argument("--figure", type=Path, metavar="FILE.png", help="draw the penetrations")
    command.add_argument(
        "--remap", action="append", default=[], metavar="FROM:=TO", help="as ~/pose:=/tool_pose; may be repeated"
    )
    command.add_argument("--tare", type=finite, metavar="S", help="zero each bag's load cell over its first S seconds")
    command.add_argument("--start", type=finite, metavar="S", help="begin S seconds into each bag")
    command.add_argument("--end", type=finite, metavar="S", help="stop S seconds into each bag")


def run(arguments: argparse.Namespace) -> int:
    """Calibrate; exit status 1 if something asked for by --fit, or everything, was refused."""
    from rich.console import Console

    from rft_ros.bags.replay import read_replay_options
    from rft_ros.calibration import PARTS, Options, calibrate, read_track
    from rft_ros.calibration.calibrated_file import write_calibrated
    from rft_ros.calibration.figure import draw_penetrations
    from rft_ros.calibration.overview import print_overview
    from rft_ros.estimator.parameter_file import read_parameter_file

    parts = tuple(arguments.fit or PARTS)
    for part in parts:
        if part not in PARTS:
            raise InputError(f"--fit '{part}' is none of {', '.join(PARTS)}")
    values = read_parameter_file(arguments.params)
    section = read_replay_options(arguments.params)
    meshes = _meshes(arguments.mesh, [bag.resolve().name for bag in arguments.bags])
    span = {name: getattr(arguments, name) for name in ("tare", "start", "end")}
    span = {name: getattr(section, name) if value is None else value for name, value in span.items()}
    for name, seconds in span.items():
        if seconds is not None and not 0.0 <= seconds <= 1e9:
            raise InputError(f"{name} is {seconds} s; it must be a number of seconds from 0 on")
    tracks = [
        read_track(
            bag,
            {**values, "mesh.file": meshes.get(bag.resolve().name, values["mesh.file"])},
            remap=[*section.remap, *arguments.remap],
            start=span["start"],
            end=span["end"],
        )
        for bag in arguments.bags
    ]
    result = calibrate(tracks, values, Options(parts=parts, tare=span["tare"], alpha_y=arguments.alpha_y))
    console = Console()
    print_overview(result, console)
    if arguments.figure and result.zeta:
        draw_penetrations(result.zeta, arguments.figure)
    if not result.findings:
        console.print("nothing could be told; no file was written")
        return 1
    for path in write_calibrated(arguments.output, arguments.params, result, tracks):
        console.print(f"-> {path}", soft_wrap=True)
    return 1 if arguments.fit and result.refusals else 0


def _meshes(rules: list[str], bags: list[str]) -> dict[str, str]:
    """Mesh file by bag's name, from rules BAG=FILE."""
    meshes = {}
    for rule in rules:
        bag, separator, file = rule.partition("=")
        if not separator or not file or bag not in bags:
            raise InputError(f"--mesh '{rule}' is not BAG=FILE with one of the bags {', '.join(bags)}")
        meshes[bag] = file
    return meshes
