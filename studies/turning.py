"""Flat faces that turn in place, in docs/where-it-fails.md: ``python -m studies.turning`` prints both figures.

A disc that is pressed, and then turned at that height; and a ring that may sink under its load while it turns.
"""

import numpy as np
import trimesh
from numpy.typing import NDArray

from rft_ros.rft import Memory, wrenches_in_time
from rft_ros.simulation import Grains
from rft_ros.tool import Tool, tool_of_mesh
from studies.choice import REMEMBERED
from studies.dem import modelled

__all__ = ["sinkage_of_ring", "turned_disc"]

Array = NDArray[np.float64]

DISC_RADIUS_M = 0.015
DISC_DEPTH_M = 0.02
DISC_PATHS_M = (0.0, 0.002, 0.005, 0.010, 0.016, 0.025, 0.040, 0.060, 0.080)
"""Paths of the rim at which the force was simulated."""

RING_RADII_M = (0.15, 0.2)
RING_ZETA = 0.6
RING_LOADS_KG = (25.0, 50.0, 100.0, 200.0)
RING_PATHS_M = (0.061, 0.3)
"""Paths of the middle of the ring's width."""

_THICKNESS_M = 0.003
_STEP_M = 2e-4
_RATE_RADPS = 0.1
_SETTLE_S = 2.0  # over which the load grows
_GRAVITY_MPS2 = 9.81


def turned_disc() -> tuple[Array, Array]:
    """Upward force [N] and torque against the turn [N mm] of the disc at `DISC_PATHS_M`, in the beads of `dem`."""
    radii = np.linspace(0.0, DISC_RADIUS_M, 6)
    tool = _turned(radii)
    _, zeta = modelled(REMEMBERED)
    heights = np.arange(0.001, -DISC_DEPTH_M, -_STEP_M)
    paths = np.arange(0.0, DISC_PATHS_M[-1] + _STEP_M, _STEP_M)
    angles = paths / DISC_RADIUS_M
    states = np.zeros((len(heights) + len(paths), 13))
    states[:, 2] = np.append(heights, np.full(len(paths), -DISC_DEPTH_M))
    states[: len(heights), 6] = 1.0
    states[: len(heights), 9] = -_RATE_RADPS * DISC_RADIUS_M
    states[len(heights) :, 5] = np.sin(0.5 * angles)
    states[len(heights) :, 6] = np.cos(0.5 * angles)
    states[len(heights) + 1 :, 12] = _RATE_RADPS
    rows = wrenches_in_time(tool.plates, REMEMBERED.made(zeta), states, Memory(tool.plates))
    turning = rows[len(heights) :]
    at = np.rint(np.array(DISC_PATHS_M) / _STEP_M).astype(int)
    return turning[at, 2], -1e3 * turning[at, 5]


def sinkage_of_ring(load: float) -> tuple[float, ...]:
    """Sinkage [m] of a ring that carries a load [kg], from the begin of its turn to each of `RING_PATHS_M`."""
    middle = float(np.mean(RING_RADII_M))
    grains = Grains(_turned(np.linspace(*RING_RADII_M, 4)), REMEMBERED.made(RING_ZETA))
    inverse_inertia = np.zeros((6, 6))
    inverse_inertia[2, 2] = 1.0 / load
    dt = _STEP_M / (_RATE_RADPS * middle)
    height = 0.0
    sinking = 0.0
    heights = []
    settling = round(_SETTLE_S / dt)
    for k in range(settling + round(RING_PATHS_M[-1] / _STEP_M) + 1):
        turn = _STEP_M / middle * max(k - settling, 0)
        gravity = _GRAVITY_MPS2 * min(k / settling, 1.0)
        wrench = grains.step(
            position=(0.0, 0.0, height),
            quaternion=(0.0, 0.0, np.sin(0.5 * turn), np.cos(0.5 * turn)),
            twist=(0.0, 0.0, sinking, 0.0, 0.0, _RATE_RADPS if k >= settling else 0.0),
            dt=dt,
            inverse_inertia=inverse_inertia,
            free_acceleration=(0.0, 0.0, -gravity, 0.0, 0.0, 0.0),
        )
        sinking += dt * (wrench[2] / load - gravity)
        height += dt * sinking
        heights.append(height)
    turning = heights[settling:]
    return tuple(turning[0] - turning[round(path / _STEP_M)] for path in RING_PATHS_M)


def _turned(radii: Array) -> Tool:
    """A disc, or a ring if the first radius is over 0, in annuli of 72 facets; its lower face is at the origin."""
    outline = [(r, 0.0) for r in radii]
    outline += [(r, _THICKNESS_M) for r in radii[::-1]]
    corners = np.array([*outline, outline[0]])
    mesh = trimesh.creation.revolve(corners, sections=72)
    return tool_of_mesh(mesh, name="turned", integration="refined", tolerance=0.0)


def main() -> None:
    """Print both."""
    forces, torques = turned_disc()
    for path, force, torque in zip(DISC_PATHS_M, forces, torques, strict=True):
        print(f"disc, {1e3 * path:g} mm of rim: {force:.2f} N, {torque:.1f} N mm")
    for load in RING_LOADS_KG:
        sinkages = ", ".join(f"{1e3 * s:.0f}" for s in sinkage_of_ring(load))
        print(f"ring, {load:g} kg: {sinkages} mm")


if __name__ == "__main__":
    main()
