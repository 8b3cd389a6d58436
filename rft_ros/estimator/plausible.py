"""Bounds of what a cell can be: beyond them an input is in another unit, as poses or meshes in millimetres."""

from rft_ros.tool import Tool

__all__ = ["HIGHEST", "LARGEST_FORCE", "deepest", "is_plausible_tool", "sentence_on"]

LARGEST_FORCE = 5e5
"""[N]: more than any arm's, and than an excavator of 50 t breaks out."""

HIGHEST = 50.0
"""Height of a tool frame above the surface [m]."""

_LARGEST, _SMALLEST = 10.0, 1e-3  # m, largest extent of a tool: a bulldozer's blade has 7; a mesh in µm may have less
_DEEPEST, _DEEPEST_OF_SIZE = 0.3, 10.0  # m, and of the tool's largest extent: probes are small and go deep


def deepest(tool: Tool) -> float:
    """The greatest plausible depth of the tool's lowest point [m]."""
    return _DEEPEST + _DEEPEST_OF_SIZE * tool.size


def is_plausible_tool(tool: Tool) -> bool:
    """Whether a tool of this size can move through grains on an arm."""
    return _SMALLEST <= tool.size <= _LARGEST


def sentence_on(tool: Tool, *, depth: float, force: float) -> str:
    """What cannot be of a tool with its lowest point at a depth [m], negative in the air, and a force [N]; or ""."""
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
