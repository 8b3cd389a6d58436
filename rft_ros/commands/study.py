"""Compute the paper's studies again, beside the published numbers.

rft study oscillation -o out/studies
"""

import argparse
from pathlib import Path

from rft_ros.commands.output_folder import make_output_folder
from rft_ros.errors import InputError
from rft_ros.progress import busy
from rft_ros.studies.registry import STUDIES

__all__ = ["add_options", "run"]

ALL = "all"


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument("name", metavar="NAME", choices=(*STUDIES, ALL), help=f"{', '.join(STUDIES)}, or {ALL}")
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="folder for figures (PNG, SVG), CSV and tables"
    )
    command.add_argument(
        "--data",
        type=Path,
        metavar="DIR",
        help="reference data: needed by dem; gives plates its measured points, and the studies the authors' meshes",
    )
    command.add_argument(
        "--docs",
        type=Path,
        action="append",
        default=[],
        metavar="FILE.md",
        help="write the tables between their marks in this file too; may be repeated",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the studies; exit status."""
    from rich.console import Console

    from rft_ros.commands.show_outcome import show_outcome
    from rft_ros.studies.marked import write_marked
    from rft_ros.studies.outcome import write_outcome
    from rft_ros.studies.registry import run_study

    data: Path | None = arguments.data
    if data is not None and not data.is_dir():
        raise InputError(f"--data '{data}' is no folder")
    for file in arguments.docs:
        if not file.is_file():
            raise InputError(f"--docs '{file}' is no file")
    names = [arguments.name]
    if arguments.name == ALL:
        names = [name for name, study in STUDIES.items() if data is not None or not study.needs_data]
    make_output_folder(arguments.output)
    console = Console()
    tables: dict[str, str] = {}
    for number, name in enumerate(names, start=1):
        with busy(f"study {name}, {number} of {len(names)}"):
            outcomes = run_study(name, data)
        for outcome in outcomes:
            files = write_outcome(outcome, arguments.output)
            tables[outcome.name] = outcome.markdown()
            show_outcome(console, outcome, files)
    for name in STUDIES if arguments.name == ALL else ():
        if name not in names:
            console.print(f"left out: {name}, which needs the reference data (--data DIR)")
    for file in arguments.docs:
        console.print(f"-> {file}: {', '.join(write_marked(file, tables))}", soft_wrap=True, highlight=False)
    return 0
