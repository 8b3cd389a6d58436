"""A tool's own wake: how much of the force comes from grains that the tool has displaced before."""

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from rft_ros.rft import plate_forces
from rft_ros.studies.figure import BLACK, BLUE, GREY, label_axes, new_figure
from rft_ros.studies.motions import Circumnutation, sample
from rft_ros.studies.outcome import Outcome, TextTable
from rft_ros.studies.paper import law, root_tip

__all__ = ["PITCHES", "share_in_wake", "wake"]

PITCHES = (0.01, 0.015, 0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.12)
"""Of the helix [m]; the paper sees forces deviate at 20 mm and not at 40 mm."""

_DEEP = 0.5e-3  # [m] inside a former place of the tool; less is the facets' own size

_POSES = 100  # along the path


def share_in_wake(pitch: float) -> float:
    """Share of the force on a root tip, at the end of a helix 60 mm deep, from facets where the tool has been [1]."""
    tool = root_tip()
    plates = tool.plates
    _, states = sample(Circumnutation(pitch=pitch, travel=0.06), _POSES)
    last = states[-1]
    force = np.linalg.norm(plate_forces(plates, law("constant"), last), axis=1)
    places = Rotation.from_quat(last[3:7]).apply(plates.packed[:3].T.copy()) + last[:3]
    sides = np.unique(
        ConvexHull(tool.vertices).equations.round(9), axis=0
    )  # outward normals and offsets: the root is convex
    passed = np.zeros(len(plates), dtype=np.bool_)
    for state in states[:-1]:
        left = np.flatnonzero(~passed)
        there = Rotation.from_quat(state[3:7]).inv().apply(places[left] - state[:3])
        passed[left] = (there @ sides[:, :3].T + sides[:, 3]).max(axis=1) < -_DEEP
    return float(force[passed].sum() / force.sum())


def wake() -> Outcome:
    """The share over the pitch."""
    shares = [share_in_wake(pitch) for pitch in PITCHES]
    figure = new_figure(7.0, 3.6)
    axes = figure.subplots()
    axes.plot([1e3 * p for p in PITCHES], [100.0 * s for s in shares], "o-", color=BLUE)
    axes.axvspan(0.0, 40.0, color="0.93")
    for at, height, text in ((20.0, 0.97, "the paper sees forces deviate"), (40.0, 0.85, "the paper's model holds")):
        axes.axvline(at, color=BLACK if at == 20.0 else GREY, lw=1.0, ls="--")
        axes.text(at + 1.0, height * 100.0 * max(shares), text, fontsize=8, va="top")
    axes.set_xlim(0.0, None)
    axes.set_ylim(0.0, None)
    label_axes(axes, x="Pitch of the helix [mm]", y="Force from its own wake [%]")
    axes.set_title("A root tip tilted by 10°, turning about the vertical while it goes down", fontsize=10)
    return Outcome(
        name="fails_wake",
        title="A tool in its own wake",
        figure=figure,
        numbers={"fails_wake": {"pitch_m": PITCHES, "share_of_force_in_wake": shares}},
        table=TextTable(
            header=("pitch", "share of the force from where the tool has been"),
            rows=tuple((f"{1e3 * p:.0f} mm", f"{100.0 * s:.0f} %") for p, s in zip(PITCHES, shares, strict=True)),
        ),
    )
