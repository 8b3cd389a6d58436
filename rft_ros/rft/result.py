"""The columns of a result, by name: the wrench, the submerged area, and the optional sensitivities.

Compiled code, the estimator and studies take their columns from here, and address no column by a number.
"""

__all__ = ["AXES", "BY_HEIGHT", "COLUMNS", "FORCE", "MOMENTS", "SENSITIVITIES", "SUBMERGED_AREA", "TORQUE", "WIDTH"]
__all__ += ["WRENCH"]

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")
"""Components of a wrench: force [N], torque about the tool frame's origin [N m]."""

COLUMNS = (*AXES, "submerged_area")
"""Columns of a result: force [N], torque about the tool frame's origin [N m], area below the surface [m²]."""

FORCE, TORQUE, WRENCH, SUBMERGED_AREA = slice(0, 3), slice(3, 6), slice(0, 6), 6
"""The parts of a result, as slices of its columns; the last is one column."""

SENSITIVITIES = ("dfx_dh", "dfy_dh", "dfz_dh", *(f"{r}_f{f}" for r in "xyz" for f in "xyz"))
"""Further columns: derivative of the force by the surface height [N/m], the sum of traction per depth times wet area;
and the sums over plates of r_j f_l [N m], r from the tool frame's origin, which make up the torque."""

WIDTH = len(COLUMNS) + len(SENSITIVITIES)
"""Number of columns of a result with sensitivities."""

BY_HEIGHT = slice(len(COLUMNS), len(COLUMNS) + 3)
"""The derivative of the force by the surface height in a result with sensitivities."""

MOMENTS = slice(BY_HEIGHT.stop, WIDTH)
"""The sums of r_j f_l in a result with sensitivities, row by row of r."""
