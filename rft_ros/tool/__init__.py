"""Makes a tool of plates from a mesh file: finds, reads and checks the file, refines and reduces the plates."""

from rft_ros.tool import solids
from rft_ros.tool.check import MAX_TOOL_SIZE_M, MIN_TOOL_SIZE_M
from rft_ros.tool.hollow import describe_hollow
from rft_ros.tool.locate import checked_mesh, is_mesh_path, locate_mesh
from rft_ros.tool.reduce import random_motions, reduced_for_any_motion
from rft_ros.tool.refine import FLAT_HALF_ANGLE, refined_plates
from rft_ros.tool.tool import (
    Tool,
    centroid_plates,
    describe_tool,
    load_tool,
    tool_of_mesh,
)
from rft_ros.tool.urdf import files_of_mesh

__all__ = [
    "FLAT_HALF_ANGLE",
    "MAX_TOOL_SIZE_M",
    "MIN_TOOL_SIZE_M",
    "Tool",
    "centroid_plates",
    "checked_mesh",
    "describe_hollow",
    "describe_tool",
    "files_of_mesh",
    "is_mesh_path",
    "load_tool",
    "locate_mesh",
    "random_motions",
    "reduced_for_any_motion",
    "refined_plates",
    "solids",
    "tool_of_mesh",
]
