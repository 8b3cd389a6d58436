"""A picture of a measured stress map: measured, fitted, and their difference side by side."""

import importlib.util
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import whole
from rft_ros.parameters.stress_map import MediumFit, StressMap

Array = NDArray[np.float64]

_PANEL_AREA_PT2 = 30_000.0  # area of a panel [pt²], which the cells of a full map fill
_FORMATS = (".png", ".svg", ".pdf")


def check_figure(file: Path) -> None:
    """Raise InputError if the file's suffix is no known format, or if matplotlib is not installed."""
    if file.suffix.lower() not in _FORMATS:
        raise InputError(f"figure '{file}' must end in {', '.join(_FORMATS)}")
    if importlib.util.find_spec("matplotlib") is None:
        raise InputError(f"figure '{file}' needs matplotlib: pip install matplotlib")


def write_stress_figure(file: Path, measured: StressMap, fit: MediumFit) -> None:
    """Write a picture with a row for α_z and one for α_x; `check_figure` first. Raises InputError."""
    from matplotlib.figure import Figure  # optional, and takes a third of a second
    from matplotlib.ticker import MultipleLocator

    figure = Figure(figsize=(10.0, 6.4), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    model_stresses = fit.medium.stresses(measured.beta, measured.gamma)
    quantities = (
        (r"$\alpha_x$", measured.alpha_x, model_stresses[0]),
        (r"$\alpha_z$", measured.alpha_z, model_stresses[1]),
    )
    beta = np.rad2deg(measured.beta)
    gamma = np.rad2deg(measured.gamma)
    style = {"cmap": "RdBu_r", "marker": "s", "s": _PANEL_AREA_PT2 / len(beta), "linewidths": 0.0}
    for (name, stress, model), row in zip(reversed(quantities), panels, strict=True):
        is_known = np.isfinite(stress)
        most = float(np.abs(np.concatenate([stress[is_known], model])).max())
        pictures = {
            "measured": stress,
            "fitted": np.where(is_known, model, np.nan),
            "measured - fitted": stress - model,
        }
        for axes, (title, values) in zip(row, pictures.items(), strict=True):
            is_finite = np.isfinite(values)
            points = axes.scatter(
                beta[is_finite],
                gamma[is_finite],
                c=values[is_finite],
                vmin=-most,
                vmax=most,
                **style,
            )
            rms = f", RMS {np.sqrt(np.nanmean(values**2)):.3f}" if is_known.any() else ""
            axes.set_title(f"{name} {title}{rms} N/cm³", fontsize=9)
            axes.set_facecolor("#d0d0d0")  # of missing cells
        figure.colorbar(points, ax=row, label=f"{name} [N/cm³]")
        row[0].set_ylabel(r"intrusion angle $\gamma$ [deg]")
    for axes in panels[-1]:
        axes.set_xlabel(r"attack angle $\beta$ [deg]")
        axes.xaxis.set_major_locator(MultipleLocator(45.0))
        axes.yaxis.set_major_locator(MultipleLocator(45.0))
    figure.suptitle(
        f"{fit.medium.name}: RMS of the fit {fit.misfit:.3f} N/cm³; grey: no cell", fontsize=10
    )
    with whole(file, "figure") as part:
        figure.savefig(
            part, dpi=120, metadata={"Date": None} if file.suffix.lower() == ".svg" else None
        )
