"""The kinds of motion of a tool in the grains: by the direction in which its middle goes, and by how much it turns.

A model's ζ differs between them: a face that is pressed meets fresh grains, one that slides along itself does not.
"""

import numpy as np
from numpy.typing import NDArray

MOTIONS = ("press", "drag", "turn", "withdrawal")
"""The kinds: down by over 45°, neither up nor down, turning such as rolling, and up by over 45°."""

LEAST_PATH = 0.005
"""Path [m] from which on a kind of motion counts: less is a corner of another one."""

_STEEP = np.sin(np.deg2rad(45.0))
_TURNING = 0.5  # a wheel that rolls without slip turns by 1, a wheel that is dragged by 0


def kinds_of_motion(moved: NDArray[np.float64], turned: NDArray[np.float64]) -> NDArray[np.str_]:
    """The kind of each of n motions, shape [n]: a name of `MOTIONS`.

    `moved`: displacement of the tool's middle in world axes, shape [n, 3], or its velocity. `turned`: angle [rad] times
    half of the tool's largest extent, shape [n], in the unit of `moved`.
    """
    distance = np.linalg.norm(moved, axis=1)
    rise = moved[:, 2]
    cases = [turned > _TURNING * distance, rise < -_STEEP * distance, rise > _STEEP * distance]
    return np.select(cases, ["turn", "press", "withdrawal"], "drag")
