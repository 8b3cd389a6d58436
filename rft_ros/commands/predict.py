"""Commands that compute wrenches at given states: predict them, and draw them."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands import options
from rft_ros.errors import InputError
from rft_ros.progress import busy

if TYPE_CHECKING:
    from rft_ros.report.animation import Animation


def predict_options(command: argparse.ArgumentParser) -> None:
    header = "header t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz [s, m, quaternion, m/s, rad/s]; world axes, z up"
    command.add_argument("states", type=Path, metavar="STATES.csv", help=header)
    command.add_argument("--mesh", required=True, metavar="FILE", help=options.MESH)
    options.share(command, *options.PLACED, *options.OF_LAW)
    length = "displacement [m] to reach 63 percent of full resistance at 30 mm depth, for states in order of time"
    options.add_number(command, "--mobilization-length", "M", f"{length} (default 0: no memory)", 0.0)
    options.share(command, "--surface-height", "--integration")
    fewest = "use the fewest plates within this share of the force in any motion, such as 0.01 (default 0: full tool)"
    options.add_number(command, "--tolerance", "SHARE", fewest, 0.0)
    header = "file to write: t,fx,fy,fz,tx,ty,tz [s, N, N m], on the tool, world axes, about the tool frame's origin"
    options.output(command, "OUT.csv", header)


def predict(arguments: argparse.Namespace) -> int:
    """Predict the wrench at each state of a CSV file.

    rft predict states.csv --mesh my_tool.stl --zeta 0.33 --alpha-y linear -o wrenches.csv
    """
    from rft_ros.rft import COLUMNS
    from rft_ros.states_file import read_states, wrenches_along, write_wrenches

    options.refuse_inputs(arguments, arguments.output)
    times, states = read_states(arguments.states)
    tool = options.tool_of(arguments, arguments.mesh, tolerance=arguments.tolerance)
    if tool.reduction:
        print(f"{tool.name}: {tool.reduction}")
    options.warn_of(tool)
    law = options.law_of(arguments)
    lengths = {name: getattr(arguments, name) for name in ("mobilization_length", "surface_height")}
    with busy("computing"):  # the first call compiles
        where = f"states file '{arguments.states}'"
        result = wrenches_along(tool.plates, law, times, states, where=where, **lengths)
    write_wrenches(arguments.output, times, result)
    wet = int((result[:, COLUMNS.index("submerged_area")] > 0.0).sum())
    print(f"{len(states)} states, {wet} in the grains, {len(tool.plates)} plates of {tool.name} -> {arguments.output}")
    return 0


def view_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "source", type=Path, metavar="STATES.csv|BAG", help=f"states as for rft predict, or a {options.BAG}"
    )
    states = command.add_argument_group("for states")
    states.add_argument("--mesh", metavar="FILE", help=options.MESH)
    options.share(states, *options.PLACED, *options.OF_LAW, "--surface-height")
    options.share(command.add_argument_group("for a bag"), *options.OF_RECORDING)
    options.output(command, "OUT.html", "page to write")


def view(arguments: argparse.Namespace) -> int:
    """Draw a tool moving through the grains: an animated page.

    rft view states.csv --mesh my_tool.stl --zeta 0.33 -o tool.html
    rft view out/demo/bag --params config/demo.yaml -o tool.html
    """
    from rft_ros.report.animation import animation_figure
    from rft_ros.report.page import write_figure

    if arguments.output.suffix != ".html":
        raise InputError(f"'{arguments.output}' must end in .html")
    of_states = arguments.source.suffix == ".csv"
    other = "for a bag" if of_states else "for states"
    for option in next(g for g in arguments.own._action_groups if g.title == other)._group_actions:
        if getattr(arguments, option.dest) != option.default:
            raise InputError(f"{option.option_strings[0]} is {other}, not for '{arguments.source}'")
    options.refuse_inputs(arguments, arguments.output)
    scene = _of_states(arguments) if of_states else _of_bag(arguments)
    with busy("drawing"):
        write_figure(arguments.output, animation_figure(scene), title=scene.title)
    print(f"{len(scene.labels)} moments of {scene.title} -> {arguments.output}")
    return 0


def _of_states(arguments: argparse.Namespace) -> "Animation":
    from rft_ros.report.animation import animate
    from rft_ros.states_file import read_states

    if arguments.mesh is None:
        raise InputError(f"states file '{arguments.source}' needs --mesh, the tool that moves")
    moving = read_states(arguments.source)
    tool = options.tool_of(arguments, arguments.mesh)
    law = options.law_of(arguments)
    return animate(tool.name, tool, law, *moving, surface_height=arguments.surface_height)


def _of_bag(arguments: argparse.Namespace) -> "Animation":
    from rft_ros.bags.playback import states_of
    from rft_ros.parameters import model_of, named_files, settings_of
    from rft_ros.report.animation import animate

    values, part = options.recording(arguments)
    options.refuse_inputs(arguments, arguments.output, also=named_files(values))
    model, height = model_of(values), settings_of(values).surface_height
    *moving, ground = states_of(arguments.source, values, model, part)
    title = f"{model.tool.name}{' (law without memory)' if model.mobilization_length > 0.0 else ''}"
    return animate(title, model.tool, model.law, *moving, surface_height=height, ground=ground)
