"""The judge of a cell, on arrays of what was sent and measured: for doctor, calibration and replay alike.

A finding is a parameter of the cell whose fit differs from the given value by more than its tolerance, or another
property of its set-up. Of several causes the one that leaves the smallest misfit is told, and those that fit alike are
named together.
"""

from rft_ros.diagnosis.evidence import Evidence, evidence_of, readings_of
from rft_ros.diagnosis.examined import examine
from rft_ros.diagnosis.finding import Finding
from rft_ros.diagnosis.fit import TOOL_TOLERANCE_SHARE
from rft_ros.diagnosis.poses import rows_of_new_poses

__all__ = [
    "TOOL_TOLERANCE_SHARE",
    "Evidence",
    "Finding",
    "evidence_of",
    "examine",
    "readings_of",
    "rows_of_new_poses",
]
