"""Draw a tool moving through the grains: an animated page.

rft view states.csv --mesh my_tool.stl --zeta 0.33 -o tool.html
rft view out/demo/bag --params config/demo.yaml -o tool.html
"""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands.options import (
    BAG,
    MESH,
    law_of,
    law_options,
    mesh_options,
    output_option,
    recording,
    recording_options,
    refuse_inputs,
    surface_option,
)
from rft_ros.errors import InputError
from rft_ros.progress import busy

if TYPE_CHECKING:
    from rft_ros.report.animation import Animation


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("source", type=Path, metavar="STATES.csv|BAG", help=f"states as for rft predict, or a {BAG}")
    states = command.add_argument_group("for states")
    states.add_argument("--mesh", metavar="FILE", help=MESH)
    mesh_options(states)
    law_options(states)
    surface_option(states)
    recording_options(command.add_argument_group("for a bag"))
    output_option(command, "OUT.html", "page to write")


def run(arguments: argparse.Namespace) -> int:
    from rft_ros.report.animation import animation_figure
    from rft_ros.report.page import write_figure

    if arguments.output.suffix != ".html":
        raise InputError(f"'{arguments.output}' must end in .html")
    of_states = arguments.source.suffix == ".csv"
    other = "for a bag" if of_states else "for states"
    for option in next(g for g in arguments.own._action_groups if g.title == other)._group_actions:
        if getattr(arguments, option.dest) != option.default:
            raise InputError(f"{option.option_strings[0]} is {other}, not for '{arguments.source}'")
    refuse_inputs(arguments, arguments.output)
    scene = _of_states(arguments) if of_states else _of_bag(arguments)
    with busy("drawing"):
        write_figure(arguments.output, animation_figure(scene), title=scene.title)
    print(f"{len(scene.labels)} moments of {scene.title} -> {arguments.output}")
    return 0


def _of_states(arguments: argparse.Namespace) -> "Animation":
    from rft_ros.report.animation import animate_evenly
    from rft_ros.states_file import read_states
    from rft_ros.tool import load_tool

    if arguments.mesh is None:
        raise InputError(f"states file '{arguments.source}' needs --mesh, the tool that moves")
    times, states = read_states(arguments.source)
    tool = load_tool(arguments.mesh, scale=arguments.scale, origin=arguments.origin)
    law, height = law_of(arguments), arguments.surface_height
    return animate_evenly(tool.name, tool, law, times, states, surface_height=height)


def _of_bag(arguments: argparse.Namespace) -> "Animation":
    from rft_ros.bags.playback import states_of
    from rft_ros.parameters import model_of, named_files, settings_of
    from rft_ros.report.animation import animate_evenly

    values, options = recording(arguments)
    refuse_inputs(arguments, arguments.output, also=named_files(values))
    model = model_of(values)
    times, states, ground = states_of(arguments.source, values, model, options)
    remembers = model.mobilization_length > 0.0
    title = f"{model.tool.name} (law without memory)" if remembers else model.tool.name
    height = settings_of(values).surface_height
    return animate_evenly(title, model.tool, model.law, times, states, surface_height=height, ground=ground)
