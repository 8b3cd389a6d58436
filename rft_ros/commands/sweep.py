"""Run a design study: tools × motions × media, on all cores or a cluster.

rft sweep config/sweep_example.yaml -o out/sweep
"""

import argparse
import tempfile
from pathlib import Path

from rft_ros.errors import InputError, reason_of

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
        help="folder for the results; a stopped sweep continues",
    )
    command.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="run on this Dask cluster (default: processes here)"
    )
    command.add_argument("--workers", type=int, metavar="N", help="number of processes here (default: one per core)")
    command.add_argument("--format", choices=("csv", "parquet"), default="csv", help="kind of table (default csv)")


def run(arguments: argparse.Namespace) -> int:
    """Sweep; exit status 1 if no variant has numbers."""
    from rft_ros.sweeps.design import read_design
    from rft_ros.sweeps.run import run as sweep

    if arguments.workers is not None and arguments.workers < 1:
        raise InputError(f"--workers is {arguments.workers}; it must be at least 1")
    design = read_design(arguments.study)
    _make_folder(arguments.output)
    report = sweep(
        design,
        arguments.output,
        scheduler=arguments.scheduler,
        workers=arguments.workers,
        form=arguments.format,
    )
    print("\n".join(report.lines()))
    return 1 if report.failed == report.rows else 0


def _make_folder(folder: Path) -> None:
    """Make the folder before the work begins; InputError where it cannot be made or written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):  # a folder's permissions alone do not decide
            pass
    except OSError as error:
        raise InputError(f"output folder '{folder}' cannot be written: {reason_of(error)}") from None
