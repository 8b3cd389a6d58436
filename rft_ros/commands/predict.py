"""Predict the wrench at each state of a CSV file.

rft predict states.csv --mesh my_tool.stl --zeta 0.33 --alpha-y linear -o wrenches.csv
"""

import argparse
from pathlib import Path

from rft_ros.commands.options import (
    MESH,
    integration_option,
    law_of,
    law_options,
    mesh_options,
    number_option,
    output_option,
    refuse_inputs,
    surface_option,
    warn_of,
)
from rft_ros.progress import busy


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "states",
        type=Path,
        metavar="STATES.csv",
        help="header t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz [s, m, quaternion, m/s, rad/s]; world axes, z up",
    )
    command.add_argument("--mesh", required=True, metavar="FILE", help=MESH)
    mesh_options(command)
    law_options(command)
    number_option(
        command,
        "--mobilization-length",
        "M",
        "displacement [m] to reach 63 percent of full resistance at 30 mm depth, for states in order of time (default"
        " 0: no memory)",
        0.0,
    )
    surface_option(command)
    integration_option(command)
    fewest = "use the fewest plates within this share of the force in any motion, such as 0.01 (default 0: full tool)"
    number_option(command, "--tolerance", "SHARE", fewest, 0.0)
    header = "file to write: t,fx,fy,fz,tx,ty,tz [s, N, N m], on the tool, world axes, about the tool frame's origin"
    output_option(command, "OUT.csv", header)


def run(arguments: argparse.Namespace) -> int:
    from rft_ros.rft import COLUMNS
    from rft_ros.states_file import read_states, wrenches_along, write_wrenches
    from rft_ros.tool import load_tool

    refuse_inputs(arguments, arguments.output)
    times, states = read_states(arguments.states)
    tool = load_tool(
        arguments.mesh,
        scale=arguments.scale,
        origin=arguments.origin,
        integration=arguments.integration,
        tolerance=arguments.tolerance,
    )
    if tool.reduction:
        print(f"{tool.name}: {tool.reduction}")
    warn_of(tool)
    law = law_of(arguments)
    lengths = {name: getattr(arguments, name) for name in ("mobilization_length", "surface_height")}
    with busy("computing"):  # the first call compiles
        where = f"states file '{arguments.states}'"
        result = wrenches_along(tool.plates, law, times, states, where=where, **lengths)
    write_wrenches(arguments.output, times, result)
    wet = int((result[:, COLUMNS.index("submerged_area")] > 0.0).sum())
    print(f"{len(states)} states, {wet} in the grains, {len(tool.plates)} plates of {tool.name} -> {arguments.output}")
    return 0
