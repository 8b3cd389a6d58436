"""The kinds of motion of a tool in the grains: by the direction in which its middle goes, and by how much it turns.

A model's ζ differs between them: a face that is pressed meets fresh grains, one that slides along itself does not.
"""

import math

from rft_ros.rft.frames import Placement

MOTIONS = ("press", "drag", "turn", "withdrawal")
"""The kinds: down by over 45°, neither up nor down, turning such as rolling, and up by over 45°."""

LEAST_PATH = 0.005
"""Path [m] from which on a kind of motion counts: less is a corner of another one."""

_STEEP = math.sin(math.radians(45.0))
_TURN_RATIO = 0.5  # a wheel that rolls without slip turns by 1, a wheel that is dragged by 0


def kind_of_motion(x: float, y: float, z: float, turned: float) -> str:
    """The kind of a motion: a name of `MOTIONS`.

    `x`, `y`, `z`: displacement of the tool's middle in world axes, or its velocity. `turned`: angle [rad] times half of
    the tool's largest extent, in the same unit.
    """
    distance = math.hypot(x, y, z)
    if turned > _TURN_RATIO * distance:
        return "turn"
    if z < -_STEEP * distance:
        return "press"
    return "withdrawal" if z > _STEEP * distance else "drag"


def kind_between(start: Placement, end: Placement, *, radius: float) -> str:
    """The kind of the motion from one place of a tool's middle to another. `radius`: half of its largest extent [m]."""
    _, angle = end.apart(start)
    a, b, c = start.position
    x, y, z = end.position
    return kind_of_motion(x - a, y - b, z - c, radius * angle)
