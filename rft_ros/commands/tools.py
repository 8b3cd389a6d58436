"""Commands about a tool: check its mesh, try variants of its design."""

import argparse
from pathlib import Path

from rft_ros.commands import options
from rft_ros.commands.machine_code import load_code
from rft_ros.errors import InputError
from rft_ros.parameters import MESH
from rft_ros.progress import busy
from rft_ros.sweeps.design import read_design
from rft_ros.sweeps.run import run
from rft_ros.tool import describe_hollow, describe_tool


def check_mesh_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("mesh", metavar="FILE", help=MESH)
    options.share(command, *options.MESH_OPTIONS)


def check_mesh(arguments: argparse.Namespace) -> int:
    """rft check-mesh my_tool.stl --scale 0.001"""
    with busy("checking the mesh"):
        tool = options.config_of(arguments).mesh.load()
    print("\n".join(describe_tool(tool)))
    if "concave" in tool.issues:
        print("\n".join(describe_hollow(tool)))
    return 1 if tool.faults else 0


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

    def compile_code() -> None:
        if arguments.scheduler is None:  # workers take the code from this machine's cache
            load_code(frozenset({"forces"}))

    computed, failed = run(
        design,
        arguments.output,
        scheduler=arguments.scheduler,
        workers=arguments.workers,
        before_workers=compile_code,
    )
    rows = len(design.variants)
    print(f"{rows:,} variants, {computed:,} computed, {failed:,} without numbers -> {table}")
    return 1 if failed == rows else 0
