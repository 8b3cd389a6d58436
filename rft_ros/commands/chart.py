"""Draw accuracy against time, for scenes and for modelling choices: a matter of minutes.

rft chart -o out/chart
"""

import argparse
import importlib.util
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands.output_folder import make_output_folder
from rft_ros.errors import InputError
from rft_ros.progress import busy, each

if TYPE_CHECKING:
    from rft_ros.studies.chart_points import Beside

__all__ = ["add_options", "run"]


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="folder for the charts")
    command.add_argument(
        "--data",
        type=Path,
        metavar="DIR",
        help="reference data with the simulated runs in dem/: draws the chart of modelling choices too",
    )
    command.add_argument(
        "--beside",
        type=Path,
        metavar="FILE.py",
        help="time and judge another implementation too: a file with the function wrench(plates, medium, zeta,"
        " alpha_y, state), such as bench/numpy_rft.py",
    )


def run(arguments: argparse.Namespace) -> int:
    """Measure and draw; exit status."""
    from rich.console import Console

    from rft_ros.commands.show_outcome import show_outcome
    from rft_ros.studies.chart import chart_outcome
    from rft_ros.studies.chart_page import chart_page, models_page
    from rft_ros.studies.chart_points import Point, points
    from rft_ros.studies.chart_scenes import scenes
    from rft_ros.studies.model_chart import model_outcome
    from rft_ros.studies.model_choice import judged_choices, wall_seconds
    from rft_ros.studies.outcome import write_outcome

    if arguments.data is not None and not (arguments.data / "dem").is_dir():
        raise InputError(f"--data '{arguments.data}' holds no folder dem")
    beside = _loaded(arguments.beside) if arguments.beside else None
    make_output_folder(arguments.output)
    found: list[Point] = []
    begun = list(scenes())
    # the bar is for a terminal only
    print(f"rft chart: times and judges the models in {len(begun)} scenes, which takes minutes", file=sys.stderr)
    for scene in each(begun, lambda scene: scene.name):
        found += points(scene, beside=beside)
    pages = {"chart": chart_page(found)}
    outcomes = [chart_outcome(found)]
    if arguments.data is not None:
        with busy("modelling choices"):
            judged, walls = judged_choices(arguments.data), wall_seconds(arguments.data)
        outcomes.append(model_outcome(judged, walls))
        pages["models"] = models_page(judged, walls)
    console = Console()
    for outcome in outcomes:
        files = write_outcome(outcome, arguments.output)
        page = arguments.output / f"{outcome.name}.html"
        page.write_text(pages[outcome.name], encoding="utf-8")
        show_outcome(console, outcome, [*files, page])
    return 0


def _loaded(file: Path) -> "Beside":
    """The function `wrench` of a Python file."""
    spec = importlib.util.spec_from_file_location(file.stem, file)
    if spec is None or spec.loader is None or not file.is_file():
        raise InputError(f"--beside '{file}' is no Python file")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    if not callable(found := getattr(module, "wrench", None)):
        raise InputError(f"--beside '{file}' has no function wrench")
    loaded: Beside = found
    return loaded
