"""The method: 3D granular Resistive Force Theory, with numpy and numba only.

After Treers, Cao, Stuart, IEEE RA-L 6(2), 2021, on the 2D stresses of Li, Zhang, Goldman, Science 339, 2013.

Conventions. Force ON the tool BY the grains; SI units; world axes with z up, E3 its unit vector; quaternions xyzw;
torque about the origin of the tool frame.

`docs/method.md` writes the equations out; "Eq. (n)" in this package means one of these, not one in the papers:

- (1) depth and velocity of a plate, (2) its directions, (3) its angles: `kernel`, from `frames` and `plates`
- (4) stresses per depth in the plane of e2 and z: `media`; (7) along e1: `alpha_y`
- (5), (6) weights of the velocity components, (8) traction per depth of a plate that leads: `traction`
- (9) wrench, a superposition of independent plates, and (9a) the share of a plate that leads: `wrench`, `kernel`
- (10) memory: `memory`
- (11) inertia of the grains: `grains`, with what all laws have in common
- (12) the second law: `agarwal2023`

The package `kernel` makes them fast; `arguments` checks inputs.

Example: the wrench of one downward-facing plate of 4 cm², 1 cm deep, pushed straight down at 1 cm/s.

>>> from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, treers2021, wrenches
>>> plates = Plates.from_arrays([[0, 0, 0]], [[0, 0, -1]], [4e-4])
>>> law = treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]), zeta=0.33)
>>> state = checked_states([0, 0, -0.01, 0, 0, 0, 1, 0, 0, -0.01, 0, 0, 0])
>>> round(float(wrenches(plates, law, state)[0, 2]), 3)  # fz [N]
1.32
"""

from rft_ros.rft.agarwal2023 import SURFACE_FRICTION, Agarwal2023
from rft_ros.rft.alpha_y import ALPHA_Y_MODELS, AlphaY, Constant, Linear, Table, alpha_y_model
from rft_ros.rft.displacement import SLACK, displacements_between, displacements_followed
from rft_ros.rft.frames import (
    ANGULAR_VELOCITY,
    AXES,
    BY_HEIGHT,
    COLUMNS,
    FORCE,
    MOMENTS,
    POSE,
    POSITION,
    QUATERNION,
    SENSITIVITIES,
    STATE,
    SUBMERGED_AREA,
    TORQUE,
    TWIST,
    VELOCITY,
    WRENCH,
    checked_states,
    quaternion_products,
    rotate_vectors,
    rotation_matrices,
    rotation_matrix,
    unit_quaternion,
)
from rft_ros.rft.grains import INERTIA, SpeedLimits
from rft_ros.rft.media import MEDIA, Medium, medium_named
from rft_ros.rft.memory import Memory
from rft_ros.rft.plates import INTEGRATIONS, Integration, Plates
from rft_ros.rft.traction import (
    LAW_NUMBERS,
    LAWS,
    Law,
    Treers2021,
    described,
    law_named,
    treers2021,
)
from rft_ros.rft.wrench import LEVEL, plate_forces, wrenches, wrenches_in_time

__all__ = [
    "ALPHA_Y_MODELS",
    "ANGULAR_VELOCITY",
    "AXES",
    "BY_HEIGHT",
    "COLUMNS",
    "FORCE",
    "INERTIA",
    "INTEGRATIONS",
    "LAWS",
    "LAW_NUMBERS",
    "LEVEL",
    "MEDIA",
    "MOMENTS",
    "POSE",
    "POSITION",
    "QUATERNION",
    "SENSITIVITIES",
    "SLACK",
    "STATE",
    "SUBMERGED_AREA",
    "SURFACE_FRICTION",
    "TORQUE",
    "TWIST",
    "VELOCITY",
    "WRENCH",
    "Agarwal2023",
    "AlphaY",
    "Constant",
    "Integration",
    "Law",
    "Linear",
    "Medium",
    "Memory",
    "Plates",
    "SpeedLimits",
    "Table",
    "Treers2021",
    "alpha_y_model",
    "checked_states",
    "described",
    "displacements_between",
    "displacements_followed",
    "law_named",
    "medium_named",
    "plate_forces",
    "quaternion_products",
    "rotate_vectors",
    "rotation_matrices",
    "rotation_matrix",
    "treers2021",
    "unit_quaternion",
    "wrenches",
    "wrenches_in_time",
]
