"""The command that fits parameters to recorded bags."""

import argparse
import sys
from pathlib import Path

from rft_ros.bags.reading import bag_name, check_recordings
from rft_ros.calibration.calibrate import PARTS
from rft_ros.calibration.calibrate import calibrate as fitted_to
from rft_ros.calibration.calibrated_file import rounded, write_calibrated
from rft_ros.calibration.track import read_track
from rft_ros.commands import options, warnings
from rft_ros.commands.machine_code import load_code
from rft_ros.errors import InputError
from rft_ros.estimator.warm_up import needed
from rft_ros.files import expanded
from rft_ros.parameters import named_files, node_parameters
from rft_ros.progress import busy
from rft_ros.tool import locate_mesh


def calibrate_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("bags", type=Path, nargs="+", metavar="BAG", help=options.RECORDING)
    params = "the node's own parameter file"
    command.add_argument("--params", type=Path, required=True, metavar="FILE.yaml", help=params)
    options.share(command, *options.RECORDING_OPTIONS[1:])
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="CALIBRATED.yaml", help="file to write"
    )
    fit = f"fit only {', '.join(PARTS[:-1])} or {PARTS[-1]}, and exit with 1 if it is not identifiable, but for"
    every = "the delay; may be repeated (default: all that are identifiable)"
    command.add_argument(
        "--fit", choices=PARTS, action="append", metavar="PART", help=f"{fit} {every}"
    )
    mesh = "mesh of the tool in the bag of that path or name, if not the parameter file's; may be repeated"
    command.add_argument("--mesh", action="append", default=[], metavar="BAG=FILE", help=mesh)


def calibrate(arguments: argparse.Namespace) -> int:
    """rft calibrate bag_1 bag_2 --params my_cell.yaml -o calibrated.yaml"""
    output = arguments.output
    config, chosen = options.recording(arguments)
    named = node_parameters(arguments.params, chosen.node)
    parts = arguments.fit or PARTS
    if chosen.tare and "sensor" not in parts and arguments.fit != ["surface"]:
        file = f"parameter file '{arguments.params}'"
        raise InputError(
            f"{file}: no fit uses its tare of {chosen.tare:g} s; add --fit sensor, which replaces it"
        )
    meshes = dict.fromkeys(arguments.bags, config.mesh.file)
    for rule in arguments.mesh:
        name, _, file = rule.partition("=")
        by_path = [bag for bag in meshes if bag == expanded(name)]
        bags = by_path or [bag for bag in meshes if bag_name(bag) == name]
        if not file or not bags:
            known = ", ".join(map(str, meshes))
            raise InputError(f"--mesh '{rule}' is not BAG=FILE with one of the bags {known}")
        meshes |= dict.fromkeys(bags, file)
    inputs = {*named_files(config), *map(locate_mesh, meshes.values())}
    options.refuse_inputs(arguments, output, also=inputs)
    check_recordings(arguments.bags, config, chosen, needs_wrench=True)
    load_code(needed(config))
    tracks = [
        read_track(bag, config.changed({"mesh.file": file}), chosen)
        for bag, file in meshes.items()
    ]
    for track in tracks:
        if track.damage:
            print(f"warning: {track.name}: {track.damage}", file=sys.stderr, flush=True)
    for tool in {track.tool.file: track.tool for track in tracks}.values():
        warnings.warn_of(tool)
    with busy("fitting"):
        trusts_surface = "surface_height" in named and "surface" not in (arguments.fit or ())
        result = fitted_to(tracks, config, parts=parts, trusts_surface=trusts_surface)
    if chosen.tare and "sensor.bias" in result.not_identifiable:
        result.not_identifiable["sensor.bias"] += f"; no fit uses the tare of {chosen.tare:g} s"
    for f in result.fitted_values:
        numbers = ", ".join(
            f"{rounded(v, e):.9g} ± {e:.2g}" for v, e in zip(f.values, f.errors, strict=True)
        )
        how = "; from ".join(filter(None, (f.goodness, f.source)))
        print(f"{f.name}: {' '.join(filter(None, (numbers, f.unit)))} ({how})")
    for motion in result.motions:
        print(motion)
    for name, why in result.not_identifiable.items():
        print(f"{name}: not identifiable: {why}")
    for sentence in result.warnings:
        print(f"warning: {sentence}", file=sys.stderr)
    if result.refusals:
        for sentence in result.refusals:
            print(f"refused: {sentence}", file=sys.stderr)
        print("no file was written")
        return 1
    if not result.fitted_values:
        print("nothing is identifiable from these bags; no file was written")
        return 1
    write_calibrated(output, arguments.params, result, tracks, node=chosen.node)
    print(f"-> {output}")
    if not arguments.fit and {f.name for f in result.fitted_values} == {"sensor.bias"}:
        advice = "push the tool straight down into the grains, pull it out, and tilt it in the air"
        print(f"only sensor.bias is identifiable from these bags; for the others {advice}")
        return 1
    # the delay needs turns in the grains, which a recording for the load cell's other values may lack
    missing = result.not_identifiable.keys() - {"sensor.delay"}
    return 1 if arguments.fit and missing else 0
