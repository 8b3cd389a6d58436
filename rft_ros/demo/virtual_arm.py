"""A virtual arm for the demo: pose, twist and load cell at 125 Hz of an ellipsoid that pitches while it goes down.

The motion is the paper's (Treers et al. 2021, V-A): straight down at 5 mm/s, pitching ±9° at 0.625 Hz, after a pause in
the air for a tare. The grains differ from the node's model: the vertical force is 30 % larger, the horizontal force
40 % smaller, and there is a hard layer at a depth of 25 mm. The load cell adds a bias, the tool's weight and noise, and
reads in its own frame.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rft_ros.estimator import LoadCellFrame
from rft_ros.parameters import LoadCell
from rft_ros.rft import (
    FORCE,
    MEDIA,
    MOMENTS,
    QUATERNION,
    STATE,
    TWIST,
    Law,
    alpha_y_model,
    rotation_matrix,
    treers2021,
    wrenches,
)
from rft_ros.rft.frames import Wrench
from rft_ros.sweeps.motions import oscillating_insertion
from rft_ros.tool import Tool, load_tool

Array = NDArray[np.float64]

PAUSE_S = 3.0  # s that the arm rests in the air before it moves
LAYER_DEPTH_M = 0.025  # m: depth of the tool's lowest point at which it reaches the hard layer

_RATE_HZ = 125.0  # Hz, of the poses
_STRENGTH = np.array([0.6, 0.6, 1.3])  # of the grains over the model's, world axes
_HARDNESS_RATIO = 2.0  # of the layer: its strength over that of the grains above
_TRANSITION_M = 0.002  # m: depth over which the strength changes
# starts with the ellipsoid's lowest point 2 mm above the surface
_DESCENT = oscillating_insertion(start_height=0.020)
_NOISE = (0.02, 0.02, 0.02, 0.0005, 0.0005, 0.0005)  # N, N m, standard deviations
LOAD_CELL = LoadCell(
    position=(0.0, 0.0, 0.12),
    quaternion=(1.0, 0.0, 0.0, 0.0),  # z down, as flange sensors often have it
    bias=(1.2, -0.7, 2.4, 0.03, -0.02, 0.01),
    mass=0.35,
    center_of_mass=(0.0, 0.0, 0.05),
)


def moments(seconds: float) -> Iterator[tuple[float, Array, Wrench]]:
    """Time [s], state of the tool frame, shape [13], columns `rft_ros.rft.STATE`, and raw reading of the load cell."""
    tool = load_tool("ellipsoid")
    medium = MEDIA["generic"]
    law = treers2021(medium, alpha_y_model("constant", medium), zeta=0.33)
    frame = LoadCellFrame(LOAD_CELL)
    random = np.random.default_rng(2021)
    for k in range(round(seconds * _RATE_HZ)):
        t = k / _RATE_HZ
        state = _DESCENT.at(max(t - PAUSE_S, 0.0))[0]
        if t <= PAUSE_S:
            state[TWIST] = 0.0
        outputs = np.concatenate([_grain_wrench(tool, law, state), np.zeros(6)])
        wrench, offset, _ = frame.into_sensor(state[QUATERNION], outputs)
        reading = np.add(wrench, offset) + random.normal(scale=_NOISE)
        yield t, state, tuple(reading.tolist())


def _grain_wrench(tool: Tool, law: Law, state: Array) -> Array:
    """Force [N] and torque [N m] of the virtual grains on the tool, world axes, about the tool frame's origin."""
    result = wrenches(tool.plates, law, state, threads=1, sensitivities=True)[0]
    depth = -state[STATE.index("pz")] - tool.lowest_point(rotation_matrix(state[QUATERNION]))
    strength = _STRENGTH * np.interp(
        depth, [LAYER_DEPTH_M, LAYER_DEPTH_M + _TRANSITION_M], [1.0, _HARDNESS_RATIO]
    )
    m = result[MOMENTS].reshape(3, 3) * strength
    torque = m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]
    return np.array([*(strength * result[FORCE]), *torque])
