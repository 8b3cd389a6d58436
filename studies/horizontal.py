"""A vertical plate dragged horizontally at an angle: the origin of the velocity weights (paper Fig. 3)."""

import math

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rft_ros.rft import Plates
from rft_ros.rft.traction import A1, A2, A3, B1, B2, B3
from rft_ros.sweeps.motions import plate_drag
from studies.paper import ALPHA_Y, BELOW_90, drag_force, law, leading_face, plate
from studies.result import (
    BLACK,
    BLUE,
    GREY,
    ORANGE,
    VERMILION,
    StudyResult,
    label_axes,
    new_figure,
    published_against_ours,
)

__all__ = ["DEPTH", "PSI", "PUBLISHED", "drag_forces", "fitted_forces", "study"]

Array = NDArray[np.float64]

PSI = np.arange(0.0, 91.0, 5.0)
"""Angles from the direction of motion to the plate's normal [deg]."""

DEPTH = 0.0255
"""Depth of the plate's centre [m]: its upper edge at the surface. This project does not know the paper's depth."""

PUBLISHED = {"F1 raw": 1.5, "F1": 0.9, "F23": 5.8}
"""Greatest measured forces [N]; F1 is F1 raw less the force on the plate's thin edges."""

_PRINTED_A4, _PRINTED_B4 = 0.41, 4.31
_BELOW = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.13), "frameon": False}


def drag_forces(plates: Plates, alpha_y: str) -> tuple[Array, Array, Array]:
    """F1, F23 and the part of F23 along e2 at every `PSI` [N], positive against the motion."""
    forces = np.array(
        [
            drag_force(plates, law(alpha_y), plate_drag(psi_deg=min(psi, BELOW_90), depth=DEPTH))
            for psi in PSI
        ]
    )
    return -forces[:, 0], np.hypot(forces[:, 1], forces[:, 2]), -forces[:, 1]


def fitted_forces(psi_deg: Array) -> tuple[Array, Array]:
    """F1 and F23 [N] by the released code's fits to the measurements, before they are scaled to 1."""
    u, w = np.sin(np.deg2rad(psi_deg)), np.cos(np.deg2rad(psi_deg))
    return (
        A1 * (np.tanh(A2 * u - A3) + math.tanh(A3)),
        B1 * (np.arctanh(B2 * w - B3) + math.atanh(B3)),
    )


def study() -> StudyResult:
    """Forces along and across the plate over ψ, beside the published fits."""
    tool = plate()
    faces = {model: drag_forces(leading_face(tool), model) for model in ALPHA_Y}
    whole = {model: drag_forces(tool.plates, model) for model in ALPHA_Y}
    f1_max = {model: faces[model][0].max() for model in ALPHA_Y}
    raw_max = {model: whole[model][0].max() for model in ALPHA_Y}
    f23_max, f2_max = faces["constant"][1].max(), faces["constant"][2].max()
    edges = raw_max["constant"] - f1_max["constant"]
    both = "α_y constant {:.2f} N, linear {:.2f} N"
    return StudyResult(
        name="horizontal",
        title="Vertical plate dragged horizontally at an angle ψ (Fig. 3)",
        figure=_draw(faces, whole),
        table=published_against_ours(
            (
                "maximum F1 with the thin edges",
                f"{PUBLISHED['F1 raw']} N",
                both.format(*raw_max.values()),
            ),
            (
                "maximum F1 without the thin edges",
                f"{PUBLISHED['F1']} N",
                both.format(*f1_max.values()),
            ),
            (
                "force on the thin edges",
                f"{PUBLISHED['F1 raw'] - PUBLISHED['F1']:.1f} N",
                f"{edges:.2f} N (3.2 mm thick)",
            ),
            (
                "maximum F23",
                f"{PUBLISHED['F23']} N",
                f"{f23_max:.2f} N ({f2_max:.2f} N of it horizontal)",
            ),
            (
                "maximum F1 over maximum F23 (does not depend on the depth)",
                f"{PUBLISHED['F1'] / PUBLISHED['F23']:.2f}",
                "α_y constant {:.2f}, linear {:.2f}".format(
                    *(f1_max[m] / f23_max for m in ALPHA_Y)
                ),
            ),
        ),
    )


def _draw(
    faces: dict[str, tuple[Array, Array, Array]], whole: dict[str, tuple[Array, Array, Array]]
) -> Figure:
    figure = new_figure(13.5, 5.6)
    along, across, weights = figure.subplots(1, 3)
    fine = np.linspace(0.0, 90.0, 181)
    fit1, fit23 = fitted_forces(fine)
    along.plot(fine, fit1, color=BLACK, label="published fit to the measurements")
    along.plot(
        [90.0],
        [PUBLISHED["F1"]],
        "*",
        color=BLACK,
        ms=11,
        label="published maximum, without the thin edges",
    )
    along.plot(
        [90.0],
        [PUBLISHED["F1 raw"]],
        "*",
        color=GREY,
        ms=11,
        label="published maximum, with the thin edges",
    )
    for model, colour, marker in (("constant", BLUE, "o"), ("linear", ORANGE, "s")):
        along.plot(
            PSI, faces[model][0], marker, color=colour, ms=4, label=f"ours, face, α_y {model}"
        )
        along.plot(
            PSI, whole[model][0], ":", color=colour, lw=1.2, label=f"ours with edges, α_y {model}"
        )
    label_axes(
        along, x="ψ [deg]", y="F1 against the motion [N]", title="Along the plate", legend=_BELOW
    )
    across.plot(fine, fit23, color=BLACK, label="published fit to the measurements")
    across.plot([0.0], [PUBLISHED["F23"]], "*", color=BLACK, ms=11, label="published maximum")
    across.plot(
        PSI, faces["constant"][1], "o", color=BLUE, ms=4, label="ours, face (independent of α_y)"
    )
    scaled = faces["constant"][1] * PUBLISHED["F23"] / faces["constant"][1].max()
    across.plot(
        PSI, scaled, "x", color=VERMILION, ms=5, label="ours, scaled to the published maximum"
    )
    label_axes(across, x="ψ [deg]", y="F23 [N]", title="Across the plate", legend=_BELOW)
    f1, f23 = fit1 / fit1.max(), fit23 / fit23.max()  # as Eqs. (5) and (6)
    for name, curve, force, fit, printed, colour in (
        ("f1", f1, faces["constant"][0], fit1, _PRINTED_A4, BLUE),
        ("f23", f23, faces["constant"][1], fit23, _PRINTED_B4, VERMILION),
    ):
        weights.plot(fine, curve, color=colour, label=f"{name}, released digits")
        weights.plot(
            PSI, force / force.max(), "o", color=colour, ms=4, label=f"{name} from our forces"
        )
        weights.plot(
            fine,
            fit / printed,
            "--",
            color=colour,
            lw=0.9,
            label=f"{name} divided by the printed {printed}",
        )
    label_axes(weights, x="ψ [deg]", y="Weight", title="Velocity weights", legend=_BELOW)
    figure.suptitle(
        f"51 mm plate, upright, 1 cm/s horizontally, centre {1e3 * DEPTH:.1f} mm deep, ζ = 0.33"
    )
    return figure
