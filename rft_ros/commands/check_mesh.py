"""Report what a mesh file holds and what is wrong with it.

rft check-mesh my_tool.stl --scale 0.001
"""

import argparse

from rft_ros.commands.options import MESH, mesh_options


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("file", metavar="FILE", help=MESH)
    mesh_options(command)


def run(arguments: argparse.Namespace) -> int:
    """Check; exit status 1 if something is wrong with the mesh."""
    from rft_ros.tool import describe_tool, load_tool

    tool = load_tool(arguments.file, scale=arguments.scale, origin=arguments.origin)
    print("\n".join(describe_tool(tool)))
    return 1 if tool.issues else 0
