"""Bounds of plausible sizes, depths and forces. An input beyond them is in another unit, such as millimetres."""

from rft_ros.tool import Tool
from rft_ros.tool.check import LARGEST, SMALLEST

__all__ = ["DEEPEST", "DEEPEST_OF_SIZE", "HIGHEST", "LARGEST_FORCE", "begins_in_grains", "deepest", "is_plausible_tool"]
__all__ += ["sentence_on"]

LARGEST_FORCE = 5e5
"""Greatest plausible force [N], more than that of any arm and than the breakout force of an excavator of 50 t."""

HIGHEST = 50.0
"""Greatest plausible height of a tool frame above the surface [m]."""

DEEPEST, DEEPEST_OF_SIZE = 0.3, 10.0
"""Greatest plausible depth: the first [m] plus the second times the tool's largest extent. Small probes go deep."""


def deepest(tool: Tool) -> float:
    """The greatest plausible depth of the tool's lowest point [m]."""
    return DEEPEST + DEEPEST_OF_SIZE * tool.size


def is_plausible_tool(tool: Tool) -> bool:
    """Whether a tool of this size can move through grains on an arm."""
    return SMALLEST <= tool.size <= LARGEST


def begins_in_grains(depth: float) -> str:
    """A sentence on a first estimate that is at this depth in the grains [m]."""
    advice = "if the tool was in the air there, check mesh.origin, mesh.quaternion and surface_height"
    return f"the first estimate is {1e3 * depth:.1f} mm deep in the grains: {advice}"


def sentence_on(tool: Tool, *, depth: float, force: float) -> str:
    """A sentence on what is implausible, or "". `depth`: of the tool's lowest point [m], negative in the air.

    `force`: on the tool [N].
    """
    if depth > deepest(tool):
        return (
            f"the tool's lowest point is {depth:g} m deep, {depth / tool.size:,.0f} times the tool's size; poses and"
            " surface_height are in metres: are these in millimetres?"
        )
    if not is_plausible_tool(tool):
        return (
            f"the tool's largest extent is {tool.size:g} m; mesh.scale (--scale) is in metres per mesh unit, 0.001 for"
            " a mesh in millimetres"
        )
    if depth < -HIGHEST:
        return (
            f"the tool is {-depth:g} m above the grains; poses and surface_height are in metres: are these in"
            " millimetres?"
        )
    if force > LARGEST_FORCE:
        return (
            f"the force is {force:g} N, more than any arm's; poses are in metres and mesh.scale (--scale) is in metres"
            " per mesh unit: is one of them in millimetres?"
        )
    return ""
