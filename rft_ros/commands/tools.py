"""Commands about a tool: check its mesh, reduce its plates, try variants of its design."""

import argparse
from pathlib import Path

from rft_ros.commands import options, warnings
from rft_ros.errors import InputError
from rft_ros.parameters import MESH, Values, defaults, named_files, tool_of
from rft_ros.progress import busy
from rft_ros.sweeps.design import read_design
from rft_ros.sweeps.run import run
from rft_ros.tool import (
    REDUCED_SUFFIX,
    Tool,
    describe_hollow,
    describe_tool,
    locate_mesh,
    save_reduced,
)


def check_mesh_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("mesh", metavar="FILE", help=MESH)
    options.share(command, *options.PLACED)


def check_mesh(arguments: argparse.Namespace) -> int:
    """rft check-mesh my_tool.stl --scale 0.001"""
    tool = tool_of(options.values_of(arguments))
    print("\n".join(describe_tool(tool)))
    if "concave" in tool.issues:
        print("\n".join(describe_hollow(tool)))
    return 1 if tool.faults else 0


def reduce_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("mesh", metavar="MESH", help=MESH)
    options.share(command, *options.PLACED, "--integration")
    usual = defaults()["tolerance"]
    command.add_argument(
        "--tolerance",
        dest="share",
        type=options.number,
        default=usual,
        metavar="SHARE",
        help=f"greatest error of force and torque, as a share, in 95 of 100 motions (default {usual:g})",
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="OUT.npz",
        help="file to write; accepted wherever a mesh is",
    )


def reduce(arguments: argparse.Namespace) -> int:
    """rft reduce my_tool.stl --tolerance 0.01 -o my_tool.npz"""
    tolerance = arguments.share
    output = arguments.output
    if not 0.0 < tolerance <= 1.0:
        raise InputError(f"--tolerance is {tolerance:g}; it must be over 0, and at most 1")
    if output.suffix.lower() != REDUCED_SUFFIX:
        raise InputError(
            f"output '{output}' must end in {REDUCED_SUFFIX}, the suffix of reduced tools"
        )
    values = options.values_of(arguments)
    options.refuse_inputs(arguments, output, also=named_files(values))
    mesh = locate_mesh(values["mesh.file"])
    if mesh.suffix.lower() == REDUCED_SUFFIX:
        raise InputError(
            f"mesh file '{mesh}' is already a reduced tool; reduce the mesh that it was made from"
        )
    with busy("choosing plates"):
        tool = tool_of({**values, "tolerance": tolerance})
    warnings.warn_of(tool)
    save_reduced(output, tool)
    print(f"{tool.name}, {tool.plates.integration}: {tool.reduction} -> {output}")
    print(_same_options(tool, values))
    return 0


def _same_options(tool: Tool, values: Values) -> str:
    """The options for a file that is written in the coordinates and units of the tool's mesh."""
    origin = " ".join(f"{v:g}" for v in values["mesh.origin"])
    rotation = " ".join(f"{v:g}" for v in values["mesh.quaternion"])
    return (
        "use it with the options of the mesh: "
        f"--scale {tool.frame.scale:g} --origin {origin} --rotate {rotation}"
    )


def sweep_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "study",
        type=Path,
        metavar="STUDY.yaml",
        help="tools, motions and media, as in config/sweep_example.yaml",
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for the results; a stopped sweep continues",
    )
    command.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="run on this Dask cluster (default: processes here)",
    )
    command.add_argument(
        "--workers", type=int, metavar="N", help="number of processes here (default: one per core)"
    )


def sweep(arguments: argparse.Namespace) -> int:
    """rft sweep config/sweep_example.yaml -o out/sweep"""
    if arguments.workers is not None and arguments.workers < 1:
        raise InputError(f"--workers is {arguments.workers}; it must be at least 1")
    design = read_design(arguments.study)
    table = arguments.output / "results.csv"
    options.refuse_inputs(arguments, table, also=design.files())
    computed, failed = run(
        design, arguments.output, scheduler=arguments.scheduler, workers=arguments.workers
    )
    rows = len(design.variants)
    print(f"{rows:,} variants, {computed:,} computed, {failed:,} without numbers -> {table}")
    return 1 if failed == rows else 0
