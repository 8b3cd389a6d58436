"""Warnings that several commands print."""

import sys

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator import TOUCH_DEPTH_M, begins_in_grains, sentence_on
from rft_ros.rft import QUATERNION, Law, rotation_matrix
from rft_ros.tool import Tool

_Array = NDArray[np.float64]

# of the tool's height: an origin so near to its lowest point lies on the side that meets the grains
_SIDE_OF_ORIGIN = 0.1


def warn_of_law(law: Law) -> None:
    """Print doubts about the values of the law on stderr."""
    for doubt in law.doubts:
        print(f"warning: {doubt}", file=sys.stderr, flush=True)


def warn_of(tool: Tool) -> None:
    """Print the faults of a tool's mesh on stderr."""
    for fault in tool.faults:
        print(f"warning: {tool.name}: {fault}", file=sys.stderr, flush=True)


def warn_of_states(
    tool: Tool, times: _Array, states: _Array, forces: _Array, *, surface_height: float
) -> None:
    """Print warnings on stderr: of implausible depths and forces, and of a first state in the grains.

    `times` [s], shape [n], `states`, shape [n, 13], `forces` [N], shape [n, 3]; `surface_height` [m].
    """
    depths = surface_height - tool.lowest_points(states)[0]
    if _warn_of_implausible(tool, times, depths, forces):
        return
    if len(states) > 1 and depths[0] > TOUCH_DEPTH_M:  # one state is no motion
        begins = f"the first state is {1e3 * depths[0]:.1f} mm deep in the grains"
        force = np.linalg.norm(forces[0])
        if force > 0.0:  # with memory, the force builds up
            begins += f", with a force of {force:.2f} N"
        advice = "to begin at the surface, begin at the tool's lowest point (rft check-mesh), or set --surface-height"
        print(f"warning: {begins}; {advice}", file=sys.stderr, flush=True)


def note_of_origin(tool: Tool, states: _Array, *, surface_height: float) -> None:
    """Print a note on stderr if the tool meets the grains with the side on which its frame's origin lies.

    `states`, shape [n, 13]; `surface_height` [m]. That is right for an origin at the tip. A tool whose origin is at the
    flange is upside down, which no force shows.
    """
    in_grains = np.flatnonzero(tool.lowest_points(states)[0] < surface_height)
    if not len(in_grains):
        return
    axes = rotation_matrix(states[in_grains[0], QUATERNION])
    lowest = tool.lowest_point(axes)
    highest = -tool.lowest_point(-axes)
    if lowest < -_SIDE_OF_ORIGIN * (highest - lowest):
        return
    print(
        f"note: the tool meets the grains with the side of its frame's origin: it reaches from {1e3 * lowest:.1f} to"
        f" {1e3 * highest:.1f} mm above it. That is right for an origin at the tip; with an origin at an arm's flange"
        " the tool is upside down: the states of a tool that hangs have the quaternion 1 0 0 0",
        file=sys.stderr,
        flush=True,
    )


def warn_of_estimates(tool: Tool, times: _Array, depths: _Array, forces: _Array) -> None:
    """Print warnings on stderr: of implausible depths and forces, and of a first estimate in the grains.

    `times` [s] and `depths` of the lowest point [m], shape [n]; `forces` [N], shape [n, 3].
    """
    if not _warn_of_implausible(tool, times, depths, forces) and depths[0] > TOUCH_DEPTH_M:
        print(f"warning: {begins_in_grains(float(depths[0]))}", file=sys.stderr, flush=True)


def _warn_of_implausible(tool: Tool, times: _Array, depths: _Array, forces: _Array) -> bool:
    """Print the first warning of an implausible depth or force on stderr; returns whether there is one."""
    with np.errstate(over="ignore"):  # an infinite size is implausible, too
        size = np.linalg.norm(forces, axis=1)
    doubtful = {int(k) for k in (depths.argmax(), depths.argmin(), size.argmax())}
    for k in sorted(doubtful):
        sentence = sentence_on(tool, depth=float(depths[k]), force=float(size[k]))
        if sentence:
            print(f"warning: t = {times[k]:g} s: {sentence}", file=sys.stderr, flush=True)
            return True
    return False
