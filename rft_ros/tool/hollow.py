"""The force on a hollow tool's facets and on its convex hull, and which of both is nearer to simulated grains.

The simulations are a box with one open side, two plates 0.3 and 0.8 of their width apart, and a rake, in beads of 3 mm
(docs/where-it-fails.md). Grains in a narrow gap or in a box move along with the tool, so that it acts as its hull.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft import (
    FORCE,
    MEDIA,
    alpha_y_model,
    checked_states,
    treers2021,
    wrenches,
)
from rft_ros.tool.solids import are_inside, convex_hull, crossings
from rft_ros.tool.tool import Tool, tool_of_mesh

Array = NDArray[np.float64]

# of the tool's middle extent: a gap in which grains move along; 0.3 did, 0.8 did not
_NARROW_SHARE = 1.0 / 3.0
_POINT_COUNT = 1000  # in the tool's hull
_MAX_PAIR_COUNT = 100_000_000  # of a point and a facet
_SPEED_M_S = 0.01

# of the larger force: a smaller difference is less than the error of the model
_SAME_FORCE_SHARE = 0.1

_HULL = "use the hull (mesh.hull, --hull), as in simulated grains"
_HULL_OF_DRAGS = (
    "use the hull (mesh.hull, --hull), as in simulated drags; presses were not simulated"
)
_FILLS = "use the facets at first, and the hull (mesh.hull, --hull) when the hollow is full, as in simulated grains"
_FILLED_ADVICE = "use the hull (mesh.hull, --hull), which the tool fills"
_NOT_KNOWN = "close the surface in CAD to know which one to use"
_FACETS_ARE_NEARER = "use the facets, which are nearer"
_HULL_IS_NEARER = "use the hull (mesh.hull, --hull), which is nearer"

# Of two plates 0.8 of their width apart, which are dragged: the simulated force is 1.3 to 1.9 times that of one. The
# model's is 2 times on the facets, and 1.47 times on the hull (test_tool_hollow.py). Of a box that is pressed mouth
# first: the median errors of studies.concave_tools.
_ERRORS = (
    "where the facets carry more, as two plates 0.8 of their width apart that are dragged in simulated grains, their"
    " force is 5 to 54 % too large, and that of the hull between 23 % too small and 13 % too large; where they carry"
    " less, as a box pressed mouth first, the median error is 33 % on the facets and 51 % on the hull"
)


_WHEEL = (
    "a wheel with grousers: use the hull with law agarwal2023, medium.surface_friction 0.8 and no memory, which is"
    " nearest to the measured pull (docs/accuracy.md)"
)
_RIM_RATIO = 0.5
"""Of a wheel's radius: nearer to its axle it has no gaps between grousers."""
_ROUND_RATIO = 0.05
"""Difference of the two extents across the axle of a wheel."""


def describe_hollow(tool: Tool) -> list[str]:
    """Lines of text: for two presses and two drags, the forces on facets and hull, and which one to use.

    A press goes along -z of the tool frame, or along +z for one that hangs from an arm's flange. A wide hollow has
    another line with the errors of both, and a wheel with grousers one with the law to use.
    """
    surface = convex_hull(tool.corners)
    hull = tool_of_mesh(
        surface, name=tool.name, frame=tool.frame, integration=tool.facets.integration
    )
    hollow = _points_in_hollows(tool, hull)
    advice = _supported(tool, hollow)
    lines = [
        "force on the tool, buried to its top, on its facets and on its convex hull (zeta 1, no memory):"
    ]
    hangs = tool.bounds[0, 2] >= 0.0  # all of it on the side to which z of a flange points
    for motion, direction, is_turned, known_advice in (
        ("press along -z", (0.0, 0.0, -1.0), False, advice.press),
        ("press along +z", (0.0, 0.0, -1.0), True, advice.turned_press),
        ("drag along x", (1.0, 0.0, 0.0), hangs, advice.drag),
        ("drag along y", (0.0, 1.0, 0.0), hangs, advice.drag),
    ):
        on_facets = _resistance(tool, direction, is_turned=is_turned)
        on_hull = _resistance(hull, direction, is_turned=is_turned)
        use = known_advice or _nearer(on_facets, on_hull)
        lines.append(f"{motion}: {on_facets:.3g} and {on_hull:.3g} N; {use}")
    if advice.errors:
        lines.append(advice.errors)
    if _is_wheel(tool, hollow):
        lines.append(_WHEEL)
    return lines


def _is_wheel(tool: Tool, hollow: Array) -> bool:
    """Whether a tool is round about an axis of its frame, with hollows near its rim only. `hollow`: points, [n, 3]."""
    low, high = tool.bounds
    extents = high - low
    if not len(hollow):
        return False
    for axle in range(3):
        axes_across = [axle - 2, axle - 1]
        first, second = extents[axes_across]
        distance = np.linalg.norm((hollow - 0.5 * (low + high))[:, axes_across], axis=1)
        is_round = abs(first - second) <= _ROUND_RATIO * first
        if is_round and distance.min() >= 0.5 * _RIM_RATIO * first:
            return True
    return False


def _nearer(on_facets: float, on_hull: float) -> str:
    """Which of both forces [N] is nearer to that on a tool with a wide hollow, which grains fill only in part.

    Where the facets carry more, one of them counts although another one moves the grains ahead of it. Where they carry
    less, the hull closes an opening through which grains move.
    """
    difference = abs(on_facets - on_hull) / max(on_facets, on_hull)
    if difference <= _SAME_FORCE_SHARE:
        return f"use either, since they differ by {100.0 * difference:.0f} % only"
    return _HULL_IS_NEARER if on_facets > on_hull else _FACETS_ARE_NEARER


def _resistance(
    tool: Tool, direction: tuple[float, float, float], *, is_turned: bool = False
) -> float:
    """Force against a motion along a direction of the world [N], of a tool whose top is at the surface.

    `is_turned`: z of the tool frame points down, in place of up.
    """
    velocity = _SPEED_M_S * np.array(direction)
    attitude = (1.0, 0.0, 0.0, 0.0) if is_turned else (0.0, 0.0, 0.0, 1.0)
    low, high = tool.bounds[:, 2]
    top = -low if is_turned else high
    state = checked_states([0.0, 0.0, -top, *attitude, *velocity, 0.0, 0.0, 0.0])
    medium = MEDIA["generic"]
    law = treers2021(medium, alpha_y_model("linear", medium))
    force = wrenches(tool.facets, law, state)[0, FORCE]
    return float(-force @ direction)


class _Advice(NamedTuple):
    """What to use for a press along -z, for one along +z, and for a drag; "" if the forces decide.

    `errors`: then the sentence on a hollow that grains fill only in part.
    """

    press: str
    turned_press: str
    drag: str
    errors: str = ""


def _supported(tool: Tool, hollow: Array) -> _Advice:
    """What simulated grains support for each motion: facets, hull, or the nearer one. `hollow`: points, [n, 3]."""
    if {"not_closed", "inconsistent_winding", "inside_out"} & tool.issues.keys():
        return _Advice(_NOT_KNOWN, _NOT_KNOWN, _NOT_KNOWN)
    walls = _walls_around(hollow, tool)
    if not walls.size:
        return _Advice(_FILLED_ADVICE, _FILLED_ADVICE, _FILLED_ADVICE)
    is_open = np.isinf(walls)
    if np.median(is_open.sum(axis=(0, 1))) <= 1.0:
        down, up = is_open[2].mean(axis=1) > 0.5
        return _Advice(_FILLS if down else _HULL, _FILLS if up else _HULL, _HULL)
    gap = np.median(walls.sum(axis=1).min(axis=0))
    narrow = _NARROW_SHARE * tool.width
    if gap <= narrow:
        return _Advice(_HULL_OF_DRAGS, _HULL_OF_DRAGS, _HULL)
    width = f"{1e3 * gap:.3g} mm wide" if np.isfinite(gap) else "open"
    errors = f"neither is right: the hollow is {width}, and grains fill it up to {1e3 * narrow:.3g} mm only; {_ERRORS}"
    return _Advice("", "", "", errors)


def _points_in_hollows(tool: Tool, hull: Tool) -> Array:
    """Points in the hull but outside of the tool, shape [n, 3] [m]."""
    triangles = tool.vertices[tool.faces]
    count = min(_POINT_COUNT, _MAX_PAIR_COUNT // len(triangles))
    low, high = tool.bounds
    points = np.random.default_rng(0).uniform(low, high, (count, 3))
    in_hull = points[are_inside(points, hull.vertices[hull.faces])]
    return np.asarray(in_hull[~are_inside(in_hull, triangles)])


def _walls_around(hollow: Array, tool: Tool) -> Array:
    """The distance from points to the tool along -x, +x, -y, +y, -z and +z [m].

    `hollow`: shape [n, 3]. Result: shape [3, 2, n]; infinite where the tool is not met.
    """
    triangles = tool.vertices[tool.faces]
    walls = np.full((3, 2, len(hollow)), np.inf)
    for axis in range(3):
        order = [axis - 2, axis - 1, axis]
        for k, (heights, _) in enumerate(crossings(hollow[:, order], triangles[..., order])):
            walls[axis, 0, k] = min(-heights[heights < 0.0], default=np.inf)
            walls[axis, 1, k] = min(heights[heights > 0.0], default=np.inf)
    return walls
