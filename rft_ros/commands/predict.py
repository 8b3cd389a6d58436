"""Wrench at each state of a CSV file."""

import argparse
import sys
from pathlib import Path

from rft_ros.commands.options import finite, integration_option, mesh_options
from rft_ros.errors import InputError

__all__ = ["add_options", "run"]


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument("states", type=Path, metavar="STATES.csv", help="header t,px,py,pz,qx,qy,qz,qw,vx,..,wz (SI)")
    command.add_argument("--mesh", required=True, metavar="FILE", help="path, package:// URI or name of a shipped mesh")
    mesh_options(command)
    command.add_argument("--medium", default="generic", metavar="NAME", help="medium (default generic)")
    command.add_argument("--zeta", type=finite, default=1.0, help="the medium's scale factor (default 1.0)")
    command.add_argument(
        "--alpha-y", default="constant", metavar="MODEL", help="constant, linear or a TABLE.csv (default constant)"
    )
    command.add_argument(
        "--mobilization-length",
        type=finite,
        default=0.0,
        metavar="M",
        help="path over which grains 30 mm deep come to strength; takes the states in the order of time (default 0)",
    )
    command.add_argument("--surface-height", type=finite, default=0.0, metavar="Z", help="world z of the surface [m]")
    integration_option(command)
    command.add_argument(
        "--tolerance",
        type=finite,
        default=0.0,
        metavar="SHARE",
        help="reduce the tool to the fewest plates within this share of the force in any motion (default 0: full tool)",
    )
    command.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.csv", help="t,fx,fy,fz,tx,ty,tz")


def run(arguments: argparse.Namespace) -> int:
    """Predict; exit status."""
    import numpy as np

    from rft_ros.estimator.alpha_y_table import read_alpha_y_table
    from rft_ros.rft import (
        ALPHA_Y_MODELS,
        Memory,
        alpha_y_model,
        medium_named,
        treers2021,
        wrenches,
        wrenches_in_time,
    )
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
    for finding in tool.findings:
        print(f"warning: {tool.name}: {finding.message}", file=sys.stderr)
    named = arguments.alpha_y in ALPHA_Y_MODELS and arguments.alpha_y != "table"
    try:
        medium = medium_named(arguments.medium)
        table = None if named else read_alpha_y_table(arguments.alpha_y)
        law = treers2021(
            medium, alpha_y_model(arguments.alpha_y if named else "table", medium, table), zeta=arguments.zeta
        )
    except ValueError as error:
        raise InputError(str(error)) from None
    length, surface = arguments.mobilization_length, arguments.surface_height
    if length < 0.0:
        raise InputError(f"--mobilization-length is {length:g}; it must not be negative")
    if length > 0.0:
        durations = np.diff(times, prepend=times[0])
        if (durations < 0.0).any():
            row = int(np.argmax(durations < 0.0))
            raise InputError(
                f"states file '{arguments.states}': t goes back from {times[row - 1]:g} to {times[row]:g}; "
                "with --mobilization-length the states must be in the order of time"
            )
        memory = Memory.of(tool.plates)
        result = wrenches_in_time(
            tool.plates, law, states, durations, memory, mobilization_length=length, surface_height=surface
        )
    else:
        result = wrenches(tool.plates, law, states, surface_height=surface)
    finite = np.isfinite(result).all(axis=1)
    if not finite.all():
        raise InputError(
            f"states file '{arguments.states}': the state at t = {times[np.argmin(finite)]:g} has no finite wrench;"
            " its place is too far away, or the tool or the stress too large"
        )
    write_wrenches(arguments.output, times, result)
    print(f"{len(states)} states, {len(tool.plates)} plates of {tool.name} -> {arguments.output}")
    return 0
