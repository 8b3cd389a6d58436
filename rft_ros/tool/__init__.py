"""From a mesh file to a tool of plates: locate, read, check, refine, reduce."""

from rft_ros.tool.mesh_file import is_mesh_path, locate_mesh
from rft_ros.tool.tool import Tool, describe_tool, load_tool, tool_of_mesh

__all__ = ["Tool", "describe_tool", "is_mesh_path", "load_tool", "locate_mesh", "tool_of_mesh"]
