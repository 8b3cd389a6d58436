"""Limits of the model itself: speeds beyond quasi-static, and a tool in its own wake."""

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rft_ros.rft import MEDIA, POSITION, QUATERNION, plate_forces
from rft_ros.sweeps.motions import circumnutation, sample
from studies.paper import ZETA, law, root_tip
from studies.parameter_sweep import Array
from studies.result import BLACK, BLUE, GREEN, GREY, VERMILION, StudyResult, label_axes, new_figure, result_of_rows

__all__ = ["PITCHES", "inertia_over_weight", "share_in_wake", "speed", "wake"]

_DENSITY = 1500.0  # of packed glass beads or sand [kg/m³]

_TESTED, _INERTIAL = 0.025, 0.2  # the paper's fastest, and where inertia begins to matter [m/s]

_SPEEDS = np.geomspace(0.005, 2.0, 60)

_DEPTHS = (0.005, 0.02, 0.08)  # m


def inertia_over_weight(speed: Array, depth: float) -> Array:
    """ρ v² over the pressure ζ α_z(0, 90°) d under a level plate moving down [1]; speeds [m/s], depth [m]."""
    m = MEDIA["generic"]
    alpha_z = m.A00 + m.A10 + m.B11 + m.B01 + m.Bm11
    return _DENSITY * speed**2 / (ZETA * alpha_z * 1e6 * depth)


def speed() -> StudyResult:
    """Inertia over the model's force, by order of magnitude, over speed at three depths."""
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    for depth, colour, dash in zip(_DEPTHS, (VERMILION, BLUE, GREEN), ("-", "--", "-."), strict=True):
        share = 100.0 * inertia_over_weight(_SPEEDS, depth)
        axes.loglog(1e3 * _SPEEDS, share, dash, color=colour, label=f"{1e3 * depth:.0f} mm deep")
    for limit, text in ((_TESTED, "paper's fastest"), (_INERTIAL, "flagged: inertial")):
        axes.axvline(1e3 * limit, color=GREY, lw=1.0)
        axes.text(1e3 * limit * 0.97, 100.0, text, rotation=90, fontsize=8, va="top", ha="right")
    axes.set_ylim(1e-3, 200.0)
    label_axes(axes, x="Speed [mm/s]", y="Inertia / model's force [%]", legend={})
    axes.set_title("A level plate moving down: ρ v² over the model's pressure", fontsize=10)
    rows = [(v, d, float(inertia_over_weight(np.array([v]), d)[0])) for v in (_TESTED, _INERTIAL, 1.0) for d in _DEPTHS]
    return result_of_rows(
        "fails_speed",
        "Faster than quasi-static",
        figure,
        rows,
        ("speed", "speed_m_s", "{:.0f} mm/s", 1e3),
        ("depth", "depth_m", "{:.0f} mm", 1e3),
        ("inertia / model's force", "inertia_over_force", "{:.2g} %", 100.0),
    )


PITCHES = (0.01, 0.015, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.12)
"""Pitches of the helix [m]. The paper sees forces deviate at 20 mm and not at 40 mm."""

_DEEP = 0.5e-3  # m inside a former place of the tool; less is facet size

_POSES = 100  # along the path


def share_in_wake(pitch: float) -> float:
    """Share of a root tip's force from facets in its own wake [1], at the end of a helix 60 mm deep."""
    tool = root_tip()
    plates = tool.plates
    _, states = sample(circumnutation(pitch=pitch, travel=0.06), _POSES)
    last = states[-1]
    force = np.linalg.norm(plate_forces(plates, law("constant"), last), axis=1)
    places = Rotation.from_quat(last[3:7]).apply(plates.centroids.T.copy()) + last[:3]
    sides = np.unique(
        ConvexHull(tool.vertices).equations.round(9), axis=0
    )  # outward normals and offsets: the root is convex
    passed = np.zeros(len(plates), dtype=np.bool_)
    for state in states[:-1]:
        left = np.flatnonzero(~passed)
        there = Rotation.from_quat(state[QUATERNION]).inv().apply(places[left] - state[POSITION])
        passed[left] = (there @ sides[:, :3].T + sides[:, 3]).max(axis=1) < -_DEEP
    return float(force[passed].sum() / force.sum())


def wake() -> StudyResult:
    """The share over the pitch."""
    shares = [share_in_wake(pitch) for pitch in PITCHES]
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    axes.plot([1e3 * p for p in PITCHES], [100.0 * s for s in shares], "o-", color=BLUE)
    axes.axvspan(0.0, 40.0, color="0.93")
    for at, height, text in (
        (20.0, 0.97, "20 mm: forces deviate in the paper"),
        (40.0, 0.85, "40 mm: the paper's model holds"),
    ):
        axes.axvline(at, color=BLACK if at == 20.0 else GREY, lw=1.0, ls="--")
        axes.text(at + 1.0, height * 100.0 * max(shares), text, fontsize=8, va="top")
    axes.set_xlim(0.0, None)
    axes.set_ylim(0.0, None)
    label_axes(axes, x="Pitch of the helix [mm]", y="Force from its own wake [%]")
    axes.set_title("A root tip tilted by 10°, turning about the vertical while it goes down", fontsize=10)
    return result_of_rows(
        "fails_wake",
        "A tool in its own wake",
        figure,
        list(zip(PITCHES, shares, strict=True)),
        ("pitch", "pitch_m", "{:.0f} mm", 1e3),
        ("share of the force from where the tool has been", "share_of_force_in_wake", "{:.0f} %", 100.0),
    )
