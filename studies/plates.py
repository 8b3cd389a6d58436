"""Inclined plates: stress over depth along e1, e2 and E3, with both models of α_y (paper Figs. 5 and 6)."""

import itertools
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.rft import Plates, wrenches
from rft_ros.sweeps.motions import plate_drag
from studies.dem import CALIBRATION, RUNS, DemRun, fitted_zeta, median_error, read_run, smoothed
from studies.paper import (
    ALPHA_Y,
    BELOW_90,
    ZETA,
    drag_force,
    face_depths,
    in_plate_axes,
    law,
    leading_face,
    plate,
)
from studies.pictures import legend_below
from studies.result import (
    BLUE,
    GREEN,
    VERMILION,
    StudyResult,
    label_axes,
    new_figure,
    published_against_ours,
)

__all__ = ["BETAS", "PHIS", "PSI", "Point", "gamma_deg", "simulated_points", "stresses", "study"]

Array = NDArray[np.float64]

BETAS, PHIS = (30.0, 60.0, 90.0), (0.0, 30.0, 60.0)
"""Tilts of the plate and descents of the motion in Figs. 5 and 6 [deg]."""

PSI = np.arange(0.0, 91.0, 5.0)
"""Angles from the level direction of motion to the plate's e2 [deg]."""

_AXES = (("e1", BLUE, "o"), ("e2", VERMILION, "s"), ("E3", GREEN, "^"))
_TOWARDS = np.array([-1.0, -1.0, 1.0])  # along e1 and e2 the force is against the motion
_DEM_PLATE = re.compile(r"plate_b(\d+)_psi(\d+)_phi(\d+)")
_DEEP = 0.1  # m; no edge of a plate reaches the surface, and force is linear in depth


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A simulated plate: stress over depth and ζ [N/cm³], positive against the motion along e1 and e2, and upwards.

    `measured`: in the simulation. `model`: the same plate with its edges, α_y constant. `error`: median relative error
    of the force vector over the whole run, as in the study `dem`.
    """

    run: str
    beta: float
    psi: float
    phi: float
    measured: tuple[float, ...]
    model: tuple[float, ...]
    error: float


def gamma_deg(phi_deg: float, psi_deg: float) -> float:
    """Intrusion angle γ in the plate's own plane [deg]: tan γ = tan φ / cos ψ."""
    phi, psi = np.deg2rad(phi_deg), np.deg2rad(psi_deg)
    return float(np.rad2deg(np.arctan2(np.sin(phi), np.cos(phi) * np.cos(psi))))


def stresses(plates: Plates, beta: float, phi: float, alpha_y: str) -> Array:
    """Stress over depth and ζ [N/cm³] along e1, e2 (against the motion) and E3 at every `PSI`, shape [n, 3]."""
    drags = [
        plate_drag(beta_deg=beta, phi_deg=phi, psi_deg=min(psi, BELOW_90), depth=_DEEP)
        for psi in PSI
    ]
    unit = 1e6 * ZETA * plates.area * face_depths(plates, drags[0].at(0.0))[0]
    return np.array([_TOWARDS * drag_force(plates, law(alpha_y), drag) / unit for drag in drags])


def simulated_points() -> tuple[Point, ...]:
    """The simulated plates: medians over the last half of their paths."""
    calibration = read_run(CALIBRATION)
    zeta = round(fitted_zeta(calibration, law("constant", zeta=1.0)), 2)
    return tuple(_point(read_run(name), zeta) for name in RUNS if _DEM_PLATE.fullmatch(name))


def _point(run: DemRun, zeta: float) -> Point:
    found = _DEM_PLATE.fullmatch(run.name)
    assert found
    beta, psi, phi = (float(angle) for angle in found.groups())
    half = slice(len(run.times) // 2, -8)
    face = leading_face(run.tool)
    unit = 1e6 * zeta * face.area * face_depths(face, run.states)
    model = wrenches(run.tool.plates, law("constant", zeta=zeta), run.states)[:, :3]
    error = median_error(run.forces, model)
    measured, predicted = (
        tuple(
            float(x)
            for x in np.median(
                (_TOWARDS * in_plate_axes(forces, psi) / unit[:, None])[half], axis=0
            )
        )
        for forces in (smoothed(run.forces), model)
    )
    return Point(
        run=run.name, beta=beta, psi=psi, phi=phi, measured=measured, model=predicted, error=error
    )


def study() -> StudyResult:
    """Stresses over ψ for nine combinations of β and φ, with the simulated plates' points."""
    face = leading_face(plate())
    found = {
        (beta, phi, model): stresses(face, beta, phi, model)
        for beta, phi, model in itertools.product(BETAS, PHIS, ALPHA_Y)
    }
    points = simulated_points()
    return StudyResult(
        name="plates",
        title="Inclined plates: stress over depth along e1, e2, E3 (Figs. 5, 6)",
        figure=_draw(found, points),
        table=published_against_ours(
            *(_row_of_beta(beta, found) for beta in BETAS),
            (
                "median errors over the plates",
                "1.2–18.8 % (against the paper's own measurements)",
                _range_of_errors(points),
            ),
        ),
    )


def _row_of_beta(
    beta: float, found: dict[tuple[float, float, str], Array]
) -> tuple[str, str, str]:
    constant, linear = (found[beta, 0.0, model][-1, 0] for model in ALPHA_Y)
    published = f"constant 0.136, linear {0.2035 - 0.0015 * beta:.4f} N/cm³"
    return (
        f"α_y at β {beta:g}° (stress along e1 at ψ = 90°)",
        published,
        f"{constant:.3f}, {linear:.4f} N/cm³",
    )


def _range_of_errors(points: tuple[Point, ...]) -> str:
    errors = [100.0 * p.error for p in points if p.psi < 90.0]
    span = f"{min(errors):.1f}–{max(errors):.1f} %"
    return f"{span} against simulated plates, without the one that moves in its own plane"


def _draw(found: dict[tuple[float, float, str], Array], points: tuple[Point, ...]) -> Figure:
    figure = new_figure(12.0, 9.0)
    panels = figure.subplots(3, 3, sharex=True, sharey="row")
    for (beta, phi), axes in zip(itertools.product(BETAS, PHIS), panels.ravel(), strict=True):
        for k, (name, colour, _) in enumerate(_AXES):
            axes.plot(
                PSI,
                found[beta, phi, "constant"][:, k],
                color=colour,
                label=f"{name}, α_y constant",
            )
        axes.plot(PSI, found[beta, phi, "linear"][:, 0], "--", color=BLUE, label="e1, α_y linear")
        for p in points:
            if (p.beta, p.phi) == (beta, phi):
                _draw_point(axes, p)
        label_axes(
            axes,
            x="ψ [deg]",
            y="Stress over ζ depth [N/cm³]",
            title=f"β = {beta:g}°, φ = {phi:g}°",
        )
        axes.label_outer()
    handles: dict[str, Any] = {}
    for axes in panels.ravel():
        handles |= {
            label: handle for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
    legend_below(figure, handles, ncols=5, fontsize=8)
    figure.suptitle(
        "Force against the motion (e1, e2) and upwards (E3) over depth, area and ζ; tan γ = tan φ / cos ψ"
    )
    return figure


def _draw_point(axes: Axes, p: Point) -> None:
    for k, (name, colour, marker) in enumerate(_AXES):
        axes.plot(
            [p.psi],
            [p.measured[k]],
            marker,
            color=colour,
            ms=7,
            ls="",
            label=f"{name}, simulated grains",
        )
        same = f"{name}, RFT, same plate"
        axes.plot(
            [p.psi], [p.model[k]], marker, color=colour, ms=10, ls="", fillstyle="none", label=same
        )
