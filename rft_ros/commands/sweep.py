"""Run a design study: tools × motions × media, on all cores or a cluster.

rft sweep config/sweep_example.yaml -o out/sweep
"""

import argparse
from pathlib import Path

from rft_ros.commands.options import output_option, refuse_inputs
from rft_ros.errors import InputError


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "study", type=Path, metavar="STUDY.yaml", help="tools, motions and media, as in config/sweep_example.yaml"
    )
    output_option(command, "DIR", "folder for the results; a stopped sweep continues")
    command.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="run on this Dask cluster (default: processes here)"
    )
    command.add_argument("--workers", type=int, metavar="N", help="number of processes here (default: one per core)")
    command.add_argument("--format", choices=("csv", "parquet"), default="csv", help="kind of table (default csv)")


def run(arguments: argparse.Namespace) -> int:
    """Sweep; exit status 1 if every variant failed."""
    from rft_ros.sweeps.design import read_design
    from rft_ros.sweeps.run import run as sweep

    if arguments.workers is not None and arguments.workers < 1:
        raise InputError(f"--workers is {arguments.workers}; it must be at least 1")
    design, out = read_design(arguments.study), arguments.output
    written = (out / name for name in ("study.json", "chunks", f"results.{arguments.format}"))
    refuse_inputs(arguments, *written, also=design.files())
    report = sweep(
        design,
        out,
        scheduler=arguments.scheduler,
        workers=arguments.workers,
        form=arguments.format,
    )
    print("\n".join(report.lines()))
    return 1 if report.failed == report.rows else 0
