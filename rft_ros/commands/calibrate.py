"""Fit load cell, surface, ζ, memory and α_y to recorded bags.

rft calibrate bag_1 bag_2 --params my_cell.yaml --figure fits.png -o calibrated.yaml
"""

import argparse
from pathlib import Path

from rft_ros.commands.options import BAG, number_option, output_option, recording, recording_options, warn_of
from rft_ros.errors import InputError
from rft_ros.progress import busy


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("bags", type=Path, nargs="+", metavar="BAG", help=BAG)
    recording_options(command, required=True)
    output_option(command, "CALIBRATED.yaml", "file to write")
    command.add_argument(
        "--fit",
        action="append",
        metavar="PART",
        help="fit only sensor, surface, zeta, mobilization or alpha_y, and exit with 1 if it is not identifiable;"
        " may be repeated (default: all that are identifiable)",
    )
    command.add_argument(
        "--alpha-y",
        choices=("auto", "constant", "linear", "table"),
        default="auto",
        metavar="MODEL",
        help="α_y over β: constant, linear, table or auto: linear if the slope is significant (default auto)",
    )
    command.add_argument(
        "--mesh",
        action="append",
        default=[],
        metavar="BAG=FILE",
        help="mesh of the tool in the bag of that name, if not the parameter file's; may be repeated",
    )
    command.add_argument(
        "--figure", type=Path, metavar="FILE.png", help="draw the penetrations to this file (default: no figure)"
    )
    number_option(
        command,
        "--tare",
        "S",
        "zero each bag's load cell over its first S seconds; 0: no tare (default: the parameter file's, or none)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Calibrate; exit status 1 if nothing is identifiable, or a part named by --fit is not."""
    from rich.console import Console

    from rft_ros.bags.playback import mounted
    from rft_ros.calibration import PARTS, calibrate, read_track
    from rft_ros.calibration.calibrated_file import write_calibrated
    from rft_ros.calibration.overview import draw_penetrations, print_overview

    parts = tuple(arguments.fit or PARTS)
    for part in parts:
        if part not in PARTS:
            raise InputError(f"--fit '{part}' is not one of {', '.join(PARTS)}")
    values, options = recording(arguments)
    values = mounted(arguments.bags[0], values, options)
    meshes = _meshes(arguments.mesh, [bag.resolve().name for bag in arguments.bags])
    tracks = [
        read_track(bag, {**values, "mesh.file": meshes.get(bag.resolve().name, values["mesh.file"])}, options)
        for bag in arguments.bags
    ]
    for tool in {track.tool.file: track.tool for track in tracks}.values():
        warn_of(tool)
    with busy("fitting"):
        result = calibrate(tracks, values, parts=parts, tare=options.tare, alpha_y=arguments.alpha_y)
    console = Console()
    print_overview(result, console)
    if arguments.figure and result.zeta:
        draw_penetrations(result.zeta, arguments.figure)
    if not result.fitted:
        console.print("nothing is identifiable from these bags; no file was written")
        return 1
    for path in write_calibrated(arguments.output, arguments.params, result, tracks):
        console.print(f"-> {path}", soft_wrap=True)
    return 1 if arguments.fit and result.not_identifiable else 0


def _meshes(rules: list[str], bags: list[str]) -> dict[str, str]:
    """Mesh file by bag's name, from rules BAG=FILE."""
    meshes = {}
    for rule in rules:
        bag, separator, file = rule.partition("=")
        if not separator or not file or bag not in bags:
            raise InputError(f"--mesh '{rule}' is not BAG=FILE with one of the bags {', '.join(bags)}")
        meshes[bag] = file
    return meshes
