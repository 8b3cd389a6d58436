"""Write a tool with the fewest plates that its motions need.

rft reduce my_tool.stl --tolerance 0.01 -o my_tool.npz
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands.options import (
    MESH,
    integration_option,
    mesh_options,
    number_option,
    output_option,
    recording,
    refuse_inputs,
)
from rft_ros.errors import InputError
from rft_ros.progress import busy

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rft_ros.tool import Tool


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("mesh", metavar="MESH", help=MESH)
    mesh_options(command)
    integration_option(command)
    size = command.add_mutually_exclusive_group()
    allowed = "error allowed, as a share of force, at the 95th percentile of motions not used to choose (default 0.025)"
    number_option(size, "--tolerance", "SHARE", allowed, 0.025)
    most = "at most this many plates, regardless of the error (default: --tolerance decides)"
    size.add_argument("--plates", type=int, metavar="N", help=most)
    command.add_argument(
        "--scene",
        metavar="STATES.csv|BAG|FAMILY",
        help="choose plates for these motions only: a states file as for rft predict, a recorded bag, or the name of a"
        " family of motions (straight, plate_drag, oscillating_insertion, circumnutation) at its defaults (default: any"
        " motion)",
    )
    command.add_argument(
        "--params", type=Path, metavar="FILE.yaml", help="for a recorded bag: the node's parameter file"
    )
    height = "world z of the surface in the scene [m] (default: the parameter file's, or 0)"
    number_option(command, "--surface-height", "Z", height)
    output_option(command, "OUT.npz", "file to write; accepted wherever a mesh is")


def run(arguments: argparse.Namespace) -> int:
    from rft_ros.tool import load_tool
    from rft_ros.tool.reduce import reduced_for_any_motion, reduced_for_scene
    from rft_ros.tool.reduced_file import SUFFIX, save_reduced

    count, tolerance = arguments.plates, arguments.tolerance
    if count is not None and count < 1:
        raise InputError(f"--plates is {count}; it must be at least 1")
    if not 0.0 < tolerance <= 1.0:
        raise InputError(f"--tolerance is {tolerance:g}; it must be over 0, and at most 1")
    if arguments.output.suffix.lower() != SUFFIX:
        raise InputError(f"output '{arguments.output}' must end in {SUFFIX}, the suffix of reduced tools")
    refuse_inputs(arguments, arguments.output)
    tool = load_tool(arguments.mesh, scale=arguments.scale, origin=arguments.origin, integration=arguments.integration)
    if tool.reduction:
        raise InputError(f"mesh file '{tool.file}' is already a reduced tool; reduce the mesh that it was made from")
    states = None if arguments.scene is None else _scene(arguments, tool)
    with busy("choosing plates"):
        if states is None:
            plates, reduction = reduced_for_any_motion(tool.facets, tool.corners, tolerance, count=count)
        else:
            plates, reduction = reduced_for_scene(tool.facets, states, tolerance, count=count)
    save_reduced(arguments.output, tool, plates, reduction, scale=arguments.scale, origin=arguments.origin)
    print(f"{tool.name} for {reduction.motions}, {plates.integration}: {reduction} -> {arguments.output}")
    origin = " ".join(f"{v:g}" for v in arguments.origin)
    print(f"its lengths are the mesh's: use it with the same scale, {arguments.scale:g}, and origin, {origin}")
    return 0


def _scene(arguments: argparse.Namespace, tool: "Tool") -> "NDArray[np.float64]":
    """The scene's states, the surface at z = 0."""
    from rft_ros.bags.playback import states_of
    from rft_ros.parameters import model_of, settings_of
    from rft_ros.states_file import read_states
    from rft_ros.sweeps.motions import FAMILIES, sample

    name = arguments.scene
    values, options = recording(arguments)
    surface = arguments.surface_height
    if name in FAMILIES:
        states = sample(FAMILIES[name](), 600)[1]
    elif Path(name).is_dir() or Path(name).suffix in (".bag", ".mcap", ".db3"):
        states = states_of(Path(name), values, model_of(values, tool=tool), options)[1]
    elif Path(name).suffix or Path(name).exists():
        states = read_states(Path(name))[1]
    else:
        raise InputError(f"--scene '{name}' is not a file or a family of motions ({', '.join(FAMILIES)})")
    states[:, 2] -= settings_of(values).surface_height if surface is None else surface
    return states
