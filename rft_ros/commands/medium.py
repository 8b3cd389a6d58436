"""The command that fits a medium to a measured stress map."""

import argparse
import sys
from pathlib import Path

import numpy as np

from rft_ros.errors import InputError
from rft_ros.files import refuse_overwriting
from rft_ros.parameters import read_stress_map, write_medium
from rft_ros.parameters.stress_map import MediumFit
from rft_ros.parameters.stress_map import fit_medium as fitted_medium
from rft_ros.report import check_figure, write_stress_figure


def fit_medium_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of `rft fit-medium`."""
    command.add_argument(
        "map",
        type=Path,
        metavar="MAP.csv",
        help="measured map: header beta_deg,gamma_deg,alpha_x,alpha_z [N/cm³], conventions of docs/method.md",
    )
    command.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="MEDIUM.yaml",
        help="file to write: the nine coefficients, for medium.file and --medium",
    )
    command.add_argument(
        "--figure",
        type=Path,
        metavar="MAP.png",
        help="picture to write: measured, fitted and their difference (PNG, SVG or PDF; needs matplotlib)",
    )


def fit_medium(arguments: argparse.Namespace) -> int:
    """rft fit-medium my_map.csv -o my_medium.yaml --figure my_map.png"""
    file = arguments.map
    output = arguments.output
    figure = arguments.figure
    if output.suffix.lower() not in (".yaml", ".yml"):
        raise InputError(f"output '{output}' must end in .yaml")
    outputs = [output]
    if figure is not None:
        check_figure(figure)
        outputs.append(figure)
    refuse_overwriting(outputs, [file])
    measured = read_stress_map(file)
    try:
        fit = fitted_medium(measured, name=output.stem)
    except ValueError as error:
        raise InputError(f"stress map '{file}': {error}") from None
    write_medium(output, fit, source=file.name)
    if figure is not None:
        write_stress_figure(figure, measured, fit)
    for doubt in fit.medium.doubts:
        print(f"warning: {file}: {doubt}", file=sys.stderr)
    print("\n".join(_described(fit, len(measured.beta))))
    print(f"-> {' and '.join(map(str, outputs))}")
    return 0


def _described(fit: MediumFit, cells: int) -> list[str]:
    """Lines of text that describe a fit."""
    lines = [f"{cells} cells, RMS stress {fit.size:.4f} N/cm³"]
    for name, value in fit.medium.coefficients.items():
        error = fit.errors[name]
        certainty = "not identifiable" if np.isnan(error) else f"± {error:.4f}"
        lines.append(f"  {name:4} {value:8.4f} N/cm³ {certainty}")
    lines += fit.remarks
    lines.append(
        f"RMS of the residual: {fit.misfit:.4f} N/cm³ with these coefficients, "
        f"{fit.misfit_scaled:.4f} with the generic medium with medium.zeta {fit.zeta:.3g}"
    )
    return lines
