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
    surface_option,
    warn_of,
)
from rft_ros.errors import InputError
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
    import numpy as np

    from rft_ros.rft import COLUMNS, Memory, wrenches, wrenches_in_time
    from rft_ros.states_file import read_states, write_wrenches
    from rft_ros.tool import load_tool

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
    length, surface = arguments.mobilization_length, arguments.surface_height
    if length < 0.0:
        raise InputError(f"--mobilization-length is {length:g}; it must not be negative")
    durations = np.diff(times, prepend=times[0])
    if length > 0.0 and (durations < 0.0).any():
        row = int(np.argmax(durations < 0.0))
        raise InputError(
            f"states file '{arguments.states}': t goes back from {times[row - 1]:g} to {times[row]:g}; "
            "with --mobilization-length the states must be in the order of time"
        )
    with busy("computing"):  # the first call compiles
        if length > 0.0:
            memory = Memory(tool.plates)
            result = wrenches_in_time(
                tool.plates, law, states, durations, memory, mobilization_length=length, surface_height=surface
            )
        else:
            result = wrenches(tool.plates, law, states, surface_height=surface)
    finite = np.isfinite(result).all(axis=1)
    if not finite.all():
        raise InputError(
            f"states file '{arguments.states}': the state at t = {times[np.argmin(finite)]:g} has no finite wrench;"
            " it is too far away, or the tool or the stress is too large"
        )
    write_wrenches(arguments.output, times, result)
    wet = int((result[:, COLUMNS.index("submerged_area")] > 0.0).sum())
    print(f"{len(states)} states, {wet} in the grains, {len(tool.plates)} plates of {tool.name} -> {arguments.output}")
    return 0
