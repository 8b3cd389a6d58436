"""The command that fits parameters to recorded bags."""

import argparse
import math
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands import options
from rft_ros.errors import InputError
from rft_ros.progress import busy

if TYPE_CHECKING:
    from rich.console import Console

    from rft_ros.calibration.calibrate import Calibration


def calibrate_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("bags", type=Path, nargs="+", metavar="BAG", help=options.BAG)
    options.add(command, "--params", "FILE.yaml", "the node's own parameter file", type=Path, required=True)
    options.share(command, *options.OF_RECORDING[1:])
    options.output(command, "CALIBRATED.yaml", "file to write")
    fit = "fit only sensor, surface, zeta, mobilization or alpha_y, and exit with 1 if it is not identifiable;"
    every = "may be repeated (default: all that are identifiable)"
    options.add(command, "--fit", "PART", f"{fit} {every}", action="append")
    models = "α_y over β: constant, linear, table or auto: linear if the slope is significant (default auto)"
    choices = ("auto", "constant", "linear", "table")
    options.add(command, "--alpha-y", "MODEL", models, "auto", choices=choices)
    mesh = "mesh of the tool in the bag of that name, if not the parameter file's; may be repeated"
    options.add(command, "--mesh", "BAG=FILE", mesh, [], action="append")
    figure = "draw the penetrations to this file (default: no figure)"
    options.add(command, "--figure", "FILE.html", figure, type=Path)
    tare = "zero each bag's load cell over its first S seconds; 0: none (default: the parameter file's, else none)"
    options.add_number(command, "--tare", "S", tare)


def calibrate(arguments: argparse.Namespace) -> int:
    """Fit load cell, surface, ζ, memory and α_y to recorded bags.

    rft calibrate bag_1 bag_2 --params my_cell.yaml --figure fits.html -o calibrated.yaml
    """
    from rich.console import Console

    from rft_ros.bags.playback import mounted
    from rft_ros.bags.reading import bag_name
    from rft_ros.calibration.calibrate import PARTS
    from rft_ros.calibration.calibrate import calibrate as fitted_to
    from rft_ros.calibration.calibrated_file import alpha_y_table, write_calibrated
    from rft_ros.calibration.track import read_track
    from rft_ros.parameters import named_files

    parts = tuple(arguments.fit or PARTS)
    for part in parts:
        if part not in PARTS:
            raise InputError(f"--fit '{part}' is not one of {', '.join(PARTS)}")
    figure, output = arguments.figure, arguments.output
    if figure and figure.suffix != ".html":
        raise InputError(f"--figure '{figure}' does not end in .html")
    values, chosen = options.recording(arguments)
    options.refuse_inputs(arguments, *filter(None, (output, alpha_y_table(output), figure)), also=named_files(values))
    values = mounted(arguments.bags[0], values, chosen)
    meshes = _meshes(arguments.mesh, [bag_name(bag) for bag in arguments.bags])
    tracks = [
        read_track(bag, {**values, "mesh.file": meshes.get(bag_name(bag), values["mesh.file"])}, chosen)
        for bag in arguments.bags
    ]
    for tool in {track.tool.file: track.tool for track in tracks}.values():
        options.warn_of(tool)
    with busy("fitting"):
        result = fitted_to(tracks, values, parts=parts, tare=chosen.tare, alpha_y=arguments.alpha_y)
    console = Console()
    print_overview(result, console)
    if not result.fitted:
        console.print("nothing is identifiable from these bags; no file was written")
        return 1
    for path in write_calibrated(output, arguments.params, result, tracks):
        console.print(f"-> {path}", soft_wrap=True)
    if figure and result.penetrations:
        _draw_penetrations(result, figure)
    return 1 if arguments.fit and result.not_identifiable else 0


def _meshes(rules: list[str], bags: list[str]) -> dict[str, str]:
    meshes = {}
    for rule in rules:
        bag, separator, file = rule.partition("=")
        if not separator or not file or bag not in bags:
            raise InputError(f"--mesh '{rule}' is not BAG=FILE with one of the bags {', '.join(bags)}")
        meshes[bag] = file
    return meshes


def print_overview(result: "Calibration", console: "Console") -> None:
    """Print the fitted values with standard errors and goodness of fit, what is not identifiable and why, and notes."""
    from rich.table import Column, Table
    from rich.text import Text

    if result.fitted:
        heads = [Column(head, no_wrap=True) for head in ("fitted", "value ± error", "unit")]
        table = Table(*heads, Column("goodness of fit; from", overflow="fold"), box=None, pad_edge=False)
        for f in result.fitted:
            values = "\n".join(_with_error(v, e) for v, e in zip(f.values, f.errors, strict=True))
            how = "; from ".join(filter(None, (f.goodness, f.source)))
            table.add_row(*(Text(cell) for cell in (f.name, values, f.unit, how)))
        console.print(table)
    if result.not_identifiable:
        console.print()
        table = Table(Column("not identifiable", no_wrap=True), "why", box=None, pad_edge=False)
        for name, why in result.not_identifiable.items():
            table.add_row(Text(name), Text(why))
        console.print(table)
    for note in result.notes:
        console.print(Text(f"note: {note}"))


def _with_error(value: float, error: float) -> str:
    """Value ± standard error, to two digits of the error."""
    if not error > 0.0:
        return f"{value:.6g}"
    places = max(0, 1 - math.floor(math.log10(error)))
    return f"{value:.{places}f} ± {error:.{places}f}"


def _draw_penetrations(result: "Calibration", file: Path) -> None:
    """Draw measured and predicted force over depth on a page, one panel for each penetration."""
    from rft_ros.report.charts import Panels
    from rft_ros.report.page import write_figure

    found = result.penetrations
    panels = Panels(len(found), same_x=False, height=330 * len(found))
    for number, p in enumerate(found):
        at, x, name = (number + 1, 1), 1e3 * p.depth, f"{p.bag}: own ζ {p.zeta:.2f}"
        panels.line(at, "measured, less bias and tool weight", x, p.measured, colour="measured")
        panels.line(at, "RFT with its own ζ", x, p.zeta * p.predicted, colour="z")
        if (others := p.others) is not None:
            panels.line(at, "RFT with the mean ζ of the others", x, others * p.predicted, colour="predicted")
            panels.line(at, "residual of that", x, p.measured - others * p.predicted, colour="residual")
            name += f", ζ of the others {others:.2f} (RMS {100 * p.misfit(others):.1f} % of the peak)"
        panels.label(at, x=f"Depth of the lowest point [mm]; {name}", y="Vertical force [N]")
    zeta = next(f for f in result.fitted if f.name == "medium.zeta")
    title = f"Vertical penetration: ζ = {zeta.values[0]:.3f} ± {zeta.errors[0]:.3f}"
    panels.figure.update_layout(title=title)
    write_figure(file, panels.figure, title=title)
