"""Run a design study: tools x motions x media x models, on all cores or a cluster.

rft sweep config/sweep_example.yaml -o out/sweep
"""

import argparse
from pathlib import Path

__all__ = ["add_options", "run"]


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument(
        "study", type=Path, metavar="STUDY.yaml", help="tools, motions and media, as in config/sweep_example.yaml"
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder for the results; a sweep that was stopped goes on",
    )
    command.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="run on this Dask cluster (default: processes here)"
    )
    command.add_argument("--workers", type=int, metavar="N", help="processes here (default: one a core)")
    command.add_argument("--format", choices=("csv", "parquet"), default="csv", help="kind of table (default csv)")


def run(arguments: argparse.Namespace) -> int:
    """Sweep; exit status 1 if not one variant has numbers."""
    from rft_ros.commands.output_folder import make_output_folder
    from rft_ros.errors import InputError
    from rft_ros.sweeps.design import read_design
    from rft_ros.sweeps.run import run as sweep

    if arguments.workers is not None and arguments.workers < 1:
        raise InputError(f"--workers is {arguments.workers}; it must be at least 1")
    design = read_design(arguments.study)
    make_output_folder(arguments.output)
    report = sweep(
        design,
        arguments.output,
        scheduler=arguments.scheduler,
        workers=arguments.workers,
        form=arguments.format,
    )
    print("\n".join(report.lines()))
    return 1 if report.failed == report.rows else 0
