"""Makes a tool of plates from a mesh file: finds, reads and checks the file, refines and reduces the plates."""

from rft_ros.tool.locate import is_mesh_path, locate_mesh
from rft_ros.tool.tool import Tool, describe_tool, load_tool, tool_of_mesh

__all__ = ["Tool", "describe_tool", "is_mesh_path", "load_tool", "locate_mesh", "tool_of_mesh"]
