"""From a mesh file to a tool of plates: locate, read, check, refine, reduce."""

from rft_ros.installation import share_directory
from rft_ros.tool.check import MeshIssue, check_mesh
from rft_ros.tool.mesh_file import locate_mesh, read_mesh
from rft_ros.tool.reduce import Reduction
from rft_ros.tool.tool import Tool, ToolRequest, describe_tool, drawable, load_tool

__all__ = [
    "MeshIssue",
    "Reduction",
    "Tool",
    "ToolRequest",
    "check_mesh",
    "describe_tool",
    "drawable",
    "load_tool",
    "locate_mesh",
    "read_mesh",
    "share_directory",
]
