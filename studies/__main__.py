"""Run studies from the project's root: python -m studies NAME.. -o DIR."""

import argparse
import sys
from importlib import import_module
from pathlib import Path

from rft_ros.errors import InputError
from studies.result import StudyResult, write_tables

__all__ = ["CHARTS", "STUDIES", "main", "run_study"]

STUDIES = (
    "horizontal",
    "plates",
    "oscillation",
    "circumnutation",
    "convergence",
    "dem",
    "wheel",
    "driven_wheel",
    "stability",
    "memory",
)
"""The studies that `all` runs. A study is a module with ``study()``, which returns a `StudyResult` or several."""

CHARTS = ("models", "learning", "coverage", "ground")
"""Studies that take minutes; `all` leaves them out."""


def run_study(name: str) -> tuple[StudyResult, ...]:
    """The results of a study by name. Imports its module."""
    found: StudyResult | tuple[StudyResult, ...] = import_module(f"studies.{name}").study()
    return (found,) if isinstance(found, StudyResult) else found


def main(arguments: list[str] | None = None) -> int:
    """Run the studies and print their tables; exit status."""
    names = (*STUDIES, *CHARTS, "all")
    parser = argparse.ArgumentParser(prog="python -m studies", description=__doc__)
    parser.add_argument(
        "names", metavar="NAME", nargs="+", choices=names, help=f"{', '.join(names)}"
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, help="folder for figures and tables"
    )
    parser.add_argument(
        "--docs",
        type=Path,
        action="append",
        default=[],
        help="page whose tables to rewrite; may be repeated",
    )
    given = parser.parse_args(arguments)
    results: list[StudyResult] = []
    for name in STUDIES if "all" in given.names else given.names:
        print(f"study {name}", file=sys.stderr, flush=True)
        for result in run_study(name):
            files = result.write(given.output)
            results.append(result)
            print(
                f"{result.title}\n\n{result.table.markdown()}\n"
                + "\n".join(f"-> {file}" for file in files)
            )
    try:
        for page in given.docs:
            print(f"-> {page}: {', '.join(write_tables(page, results))}")
    except (InputError, OSError) as error:
        print(f"studies: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
