"""A driven wheel with grousers over its slip: the slope that it holds, its torque and its sinkage.

``../shared/data/mgru3``, whose README says how it was measured: a wheel that is free to sink, in GRC-1 simulant. At a
slip the grains' force along the ground over that across it is the tangent of the slope.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import trimesh
from numpy.typing import NDArray

from rft_ros.rft import Agarwal2023, Law
from rft_ros.simulation import Grains
from rft_ros.tool import Tool, tool_of_mesh
from studies.choice import REMEMBERED
from studies.result import (
    BLACK,
    BLUE,
    ORANGE,
    VERMILION,
    StudyResult,
    TextTable,
    label_axes,
    new_figure,
)

__all__ = ["DATA", "LOAD", "ZETA", "Drive", "drive", "measured", "study", "wheel"]

Array = NDArray[np.float64]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "mgru3"
"""The folder of the measurements."""

LOAD = 17.5 * 9.81
"""Load on the wheel [N]."""

ZETA = 1.0
"""No press of this simulant is known."""

_RIM = 0.225  # m
_TIP = 0.25  # m
_WIDTH = 0.18  # m
_GROUSERS = 24
_GROUSER = 0.005  # m thick
_TURN_RATE = 0.8  # rad/s
_STEP = 0.0025  # m of the tips' path
_PATH = 0.5  # m of the tips' path; steady in its last quarter
_GRAVITY = 9.81  # m/s²
_NO_MEMORY = 1e-5  # m: the simulator needs some


class Drive(NamedTuple):
    """A wheel in steady motion: the slope that it holds [deg], its torque [N m], and the sinkage of its tips [m]."""

    slope: float
    torque: float
    sinkage: float


@cache
def wheel(*, hull: bool) -> Tool:
    """The wheel, or its convex hull. Its axle lies along x, through the tool frame's origin."""
    half = 0.5 * _GROUSER
    profile = []
    for tooth in range(_GROUSERS):
        turn = 2.0 * np.pi * tooth / _GROUSERS
        radial = np.array([np.cos(turn), np.sin(turn)])
        across = np.array([-np.sin(turn), np.cos(turn)])
        profile += [
            _RIM * radial - half * across,
            _TIP * radial - half * across,
            _TIP * radial + half * across,
            _RIM * radial + half * across,
        ]
        middle = turn + np.pi / _GROUSERS
        profile.append(_RIM * np.array([np.cos(middle), np.sin(middle)]))
    ring = np.array(profile)
    n = len(ring)
    rings = [scale * ring for scale in (1.0, 0.6)]
    points = [
        np.column_stack([np.full(n, x), r]) for x in (-0.5 * _WIDTH, 0.5 * _WIDTH) for r in rings
    ]
    centres = np.array([[-0.5 * _WIDTH, 0.0, 0.0], [0.5 * _WIDTH, 0.0, 0.0]])
    faces = []
    for k in range(n):
        j = (k + 1) % n
        left, left_in, right, right_in = (np.array([k, j]) + n * side for side in range(4))
        quads = ((left, right), (left_in, left), (right, right_in))
        for (a, b), (c, d) in quads:
            faces += [(a, b, c), (b, d, c)]
        faces += [(left_in[1], left_in[0], 4 * n), (right_in[0], right_in[1], 4 * n + 1)]
    mesh = trimesh.Trimesh(np.vstack([*points, centres]), faces, process=False)
    trimesh.repair.fix_normals(mesh)
    shape = mesh.convex_hull if hull else mesh
    return tool_of_mesh(shape, name="driven wheel", integration="refined", tolerance=0.0)


def measured() -> Array:
    """Slip and slope [deg] as measured, shape [n, 2]."""
    rows = np.genfromtxt(
        DATA / "slip_slope.csv", delimiter=",", names=True, dtype=None, encoding="utf-8"
    )
    of_rig = rows[rows["source"] == "measured"]
    return np.column_stack([of_rig["slip"], of_rig["slope_deg"]])


def drive(law: Law, slip: float, *, hull: bool) -> Drive:
    """The steady motion of the wheel at a slip: only its height is free, and it carries `LOAD`."""
    dt = _STEP / (_TURN_RATE * _TIP)
    speed = (1.0 - slip) * _TURN_RATE * _TIP
    grains = Grains(wheel(hull=hull), law)
    inverse_inertia = np.zeros((6, 6))
    inverse_inertia[2, 2] = _GRAVITY / LOAD
    free_acceleration = np.array([0.0, 0.0, -_GRAVITY, 0.0, 0.0, 0.0])
    count = round(_PATH / _STEP)
    wrenches = np.empty((count, 6))
    heights = np.empty(count)
    height = _TIP
    sinking = 0.0
    for k in range(count):
        turn = _TURN_RATE * dt * k
        wrenches[k] = grains.step(
            position=(0.0, speed * dt * k, height),
            quaternion=(-np.sin(0.5 * turn), 0.0, 0.0, np.cos(0.5 * turn)),
            twist=(0.0, speed, sinking, -_TURN_RATE, 0.0, 0.0),
            dt=dt,
            inverse_inertia=inverse_inertia,
            free_acceleration=free_acceleration,
        )
        sinking += dt * _GRAVITY * (wrenches[k, 2] / LOAD - 1.0)
        height += dt * sinking
        heights[k] = height
    steady = slice(-count // 4, None)
    force = wrenches[steady].mean(axis=0)
    return Drive(
        slope=float(np.degrees(np.arctan2(force[1], force[2]))),
        torque=float(force[3]),
        sinkage=float(_TIP - heights[steady].mean()),
    )


def study() -> tuple[StudyResult, ...]:
    """Slope, torque and sinkage over slip of three models on the hull; none where the data are absent."""
    if not DATA.is_dir():
        return ()
    models = (
        ("default", REMEMBERED.made(ZETA), BLUE),
        ("agarwal2023 with memory", Agarwal2023(zeta=ZETA, mobilization_length=0.003), ORANGE),
        (
            "agarwal2023, friction 0.8, no memory",
            Agarwal2023(zeta=ZETA, surface_friction=0.8, mobilization_length=_NO_MEMORY),
            VERMILION,
        ),
    )
    points = measured()
    figure = new_figure(6.0, 3.6)
    axes = figure.subplots()
    axes.plot(points[:, 0], points[:, 1], "o", color=BLACK, label="measured")
    rows = [[f"{slip:.2f}", f"{slope:.0f}°"] for slip, slope in points]
    for name, law, colour in models:
        found = [drive(law, slip, hull=True) for slip in points[:, 0]]
        axes.plot(points[:, 0], [one.slope for one in found], color=colour, label=name)
        for row, one in zip(rows, found, strict=True):
            row.append(f"{one.slope:.1f}°, {one.torque:.0f} N m, {1e3 * one.sinkage:.0f} mm")
    label_axes(axes, x="Slip", y="Slope held [deg]", legend={"loc": "upper left"})
    return (
        StudyResult(
            name="driven_wheel",
            title="A driven wheel with grousers: slope held, torque and sinkage over slip",
            figure=figure,
            table=TextTable(
                header=("slip", "measured slope", *(name for name, *_ in models)),
                rows=tuple(tuple(row) for row in rows),
            ),
        ),
    )
