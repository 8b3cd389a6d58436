"""Warnings that several commands print."""

import sys

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator import sentence_on
from rft_ros.rft import Law
from rft_ros.tool import Tool

_Array = NDArray[np.float64]

_TOUCHES = 1e-6  # m: least depth of a first state in the grains, beyond rounding


def warn_of_law(law: Law) -> None:
    """Print doubts about the values of the law on stderr."""
    for doubt in law.doubts:
        print(f"warning: {doubt}", file=sys.stderr, flush=True)


def warn_of(tool: Tool) -> None:
    """Print the faults of a tool's mesh on stderr. Concavity is no fault, and only `rft check-mesh` reports it."""
    for kind, issue in tool.issues.items():
        if kind != "concave":
            print(f"warning: {tool.name}: {issue}", file=sys.stderr, flush=True)


def warn_of_motion(
    tool: Tool, times: _Array, states: _Array, forces: _Array, *, surface_height: float
) -> None:
    """Print warnings on stderr: of implausible depths and forces in a motion, and of a first state in the grains.

    `times` [s], shape [n], `states`, shape [n, 13], `forces` [N], shape [n, 3]; `surface_height` [m].
    """
    depth = surface_height - tool.lowest_points(states)[0]
    with np.errstate(over="ignore"):  # an infinite size is implausible, too
        size = np.linalg.norm(forces, axis=1)
    doubtful = {int(k) for k in (depth.argmax(), depth.argmin(), size.argmax())}
    for k in sorted(doubtful):
        sentence = sentence_on(tool, depth=float(depth[k]), force=float(size[k]))
        if sentence:
            print(f"warning: t = {times[k]:g} s: {sentence}", file=sys.stderr, flush=True)
            return
    if len(states) > 1 and depth[0] > _TOUCHES:  # one state is no motion
        begins = f"the first state is {1e3 * depth[0]:.1f} mm deep in the grains"
        if size[0] > 0.0:  # with memory, the force builds up
            begins += f", with a force of {size[0]:.2f} N"
        advice = "to begin at the surface, begin at the tool's lowest point (rft check-mesh), or set --surface-height"
        print(f"warning: {begins}; {advice}", file=sys.stderr, flush=True)
