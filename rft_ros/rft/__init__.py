"""The physics: 3D granular Resistive Force Theory (Treers, Cao, Stuart, RA-L 2021), on numpy and numba only.

Read beside the paper: `media` (Li's coefficients), `velocity_weights` (f1, f23), `alpha_y` (its models),
`traction` (one plate), `plates` and `wrench` (many plates), `mobilization` (with memory, ours), `frames` (quaternions
and states); `kernel`, `element`, `blocks`, `wet_part` and `compiled` are how the sum over plates is made fast.

Example: the wrench of one downward-facing plate of 4 cm², 1 cm deep, pushed straight down at 1 cm/s.

>>> from rft_ros.rft import MEDIA, Plates, alpha_y_model, checked_states, treers2021, wrenches
>>> plates = Plates.from_arrays([[0, 0, 0]], [[0, 0, -1]], [4e-4])
>>> law = treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]), zeta=0.33)
>>> state = checked_states([0, 0, -0.01, 0, 0, 0, 1, 0, 0, -0.01, 0, 0, 0])
>>> round(float(wrenches(plates, law, state)[0, 2]), 3)  # fz [N]
1.32
"""

from rft_ros.rft.alpha_y import ALPHA_Y_MODELS, AlphaY, Constant, Linear, Table, alpha_y_model
from rft_ros.rft.frames import STATE, checked_states, rotation_matrix, unit_quaternion
from rft_ros.rft.media import MEDIA, Medium, medium_named
from rft_ros.rft.mobilization import Memory, wrenches_in_time
from rft_ros.rft.plates import INTEGRATIONS, Integration, Plates
from rft_ros.rft.traction import Law, Treers2021, traction_per_depth, treers2021
from rft_ros.rft.wrench import COLUMNS, edge_shares, plate_forces, wrenches

__all__ = [
    "ALPHA_Y_MODELS",
    "COLUMNS",
    "INTEGRATIONS",
    "MEDIA",
    "STATE",
    "AlphaY",
    "Constant",
    "Integration",
    "Law",
    "Linear",
    "Medium",
    "Memory",
    "Plates",
    "Table",
    "Treers2021",
    "alpha_y_model",
    "checked_states",
    "edge_shares",
    "medium_named",
    "plate_forces",
    "rotation_matrix",
    "traction_per_depth",
    "treers2021",
    "unit_quaternion",
    "wrenches",
    "wrenches_in_time",
]
