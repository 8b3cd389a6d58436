"""Commands that compute wrenches at given states: predict them, and draw them."""

import argparse
import sys
from pathlib import Path

from rft_ros.bags.playback import played_estimates, played_motion
from rft_ros.commands import options, warnings
from rft_ros.commands.machine_code import load_code
from rft_ros.errors import InputError
from rft_ros.estimator.warm_up import needed
from rft_ros.logged_columns import parse_columns
from rft_ros.parameters import MESH, Config, Model, named_files
from rft_ros.progress import busy
from rft_ros.report import DrawnMotion, Figure, tool_figure, write_page
from rft_ros.rft import FORCE, SUBMERGED_AREA, described
from rft_ros.states_file import read_states, wrenches_along, write_wrenches

_OF_EVALUATION = ("--surface-height", "--integration", "--tolerance")


def predict_options(command: argparse.ArgumentParser) -> None:
    header = "header t,px,py,pz,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz [s, m, quaternion, m/s, rad/s]; world axes, z up"
    command.add_argument(
        "states", type=Path, metavar="STATES.csv", help=f"{header}; velocities may be missing"
    )
    options.share(command, "--columns")
    command.add_argument("--mesh", required=True, metavar="FILE", help=MESH)
    options.share(command, *options.MESH_OPTIONS, *options.LAW_OPTIONS)
    options.share(command, *_OF_EVALUATION)
    _add_memory(command)
    header = "file to write: t,fx,fy,fz,tx,ty,tz [s, N, N m], on the tool, world axes, about the tool frame's origin"
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT.csv", help=header
    )


def _add_memory(command: argparse._ActionsContainer) -> None:
    alone = (
        "mobilization length of the memory [m]; the states are then evaluated in order, as one motion"
        " (default 0: no memory, each state on its own)"
    )
    command.add_argument("--mobilization-length", type=options.number, metavar="X", help=alone)


def _config_for_states(arguments: argparse.Namespace) -> Config:
    """The parameters. Memory only if its option is given: states may be in any order, unlike a recording's poses."""
    length = arguments.mobilization_length or 0.0
    return options.config_of(arguments).changed({"medium.mobilization_length": length})


def _model_for_states(config: Config) -> Model:
    """The model of the parameters, with its code compiled."""
    with busy("reading the tool"):
        model = config.model()
    load_code(frozenset({"forces"}))
    return model


def predict(arguments: argparse.Namespace) -> int:
    """rft predict states.csv --mesh my_tool.stl --zeta 0.33 --alpha-y linear -o wrenches.csv"""
    config = _config_for_states(arguments)
    options.refuse_inputs(arguments, arguments.output, also=named_files(config))
    times, states = read_states(arguments.states, parse_columns(arguments.columns or ""))
    model = _model_for_states(config)
    height = config.surface_height
    tool = model.tool
    if tool.reduction:
        print(f"{tool.name}: {tool.reduction}")
    warnings.warn_of(tool)
    warnings.warn_of_law(model.law)
    where = f"states file '{arguments.states}'"
    with busy("computing"):
        result = wrenches_along(model, times, states, surface_height=height, where=where)
    warnings.warn_of_states(tool, times, states, result[:, FORCE], surface_height=height)
    # only here, where wrenches are written: other commands need not repeat these
    warnings.note_of_origin(tool, states, surface_height=height)
    if "concave" in tool.issues:
        print(f"note: {tool.name}: {tool.issues['concave']}", file=sys.stderr, flush=True)
    write_wrenches(arguments.output, times, result)
    wet = int((result[:, SUBMERGED_AREA] > 0.0).sum())
    print(
        f"{len(states)} states, {wet} in the grains, {len(tool.plates)} plates of {tool.name} -> {arguments.output}"
    )
    grains = described(model.law)
    if not model.law.has_memory:
        usual = f"--mobilization-length {Config().medium.mobilization_length:g}"
        grains += f" (each state alone; node and replay have it: {usual} for states of one motion)"
    print(grains)
    return 0


_SHARED_FOR_STATES = (*options.MESH_OPTIONS, *options.LAW_OPTIONS, *_OF_EVALUATION)
_FOR_STATES = ("--columns", "--mesh", "--mobilization-length", *_SHARED_FOR_STATES)
_FOR_BAG = tuple(option for option in options.RECORDING_OPTIONS if option != "--columns")


def view_options(command: argparse.ArgumentParser) -> None:
    source = f"states as for rft predict, or a {options.BAG}"
    command.add_argument("source", type=Path, metavar="STATES.csv|BAG", help=source)
    states = command.add_argument_group("for states")
    options.share(states, "--columns")
    states.add_argument("--mesh", metavar="FILE", help=MESH)
    options.share(states, *_SHARED_FOR_STATES)
    _add_memory(states)
    options.share(command.add_argument_group("for a bag"), *_FOR_BAG)
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT.html", help="page to write"
    )


def view(arguments: argparse.Namespace) -> int:
    """rft view states.csv --mesh my_tool.stl --zeta 0.33 -o tool.html
    rft view out/demo/bag --params config/demo.yaml -o tool.html
    """
    source = arguments.source
    output = arguments.output
    if output.suffix != ".html":
        raise InputError(f"'{output}' must end in .html")
    of_states = source.suffix.lower() == ".csv"
    for option in _FOR_BAG if of_states else _FOR_STATES:
        if getattr(arguments, option.strip("-").replace("-", "_")) not in (None, []):
            raise InputError(
                f"{option} is for {'a bag' if of_states else 'states'}, not for '{source}'"
            )
    figure = _figure_of_states(arguments) if of_states else _figure_of_bag(arguments)
    write_page(output, [figure._replace(title="")], title=figure.title)
    print(f"{len(figure.drawn.frames)} moments of {figure.title} -> {output}")
    return 0


def _figure_of_states(arguments: argparse.Namespace) -> Figure:
    file = arguments.source
    if arguments.mesh is None:
        raise InputError(f"states file '{file}' needs --mesh, the tool that moves")
    config = _config_for_states(arguments)
    options.refuse_inputs(arguments, arguments.output, also=named_files(config))
    model = _model_for_states(config)
    times, states = read_states(file, parse_columns(arguments.columns or ""))
    height = config.surface_height
    where = f"states file '{file}'"
    with busy("computing"):
        wrenches = wrenches_along(model, times, states, surface_height=height, where=where)
    forces = wrenches[:, FORCE]
    warnings.warn_of_states(model.tool, times, states, forces, surface_height=height)
    motion = DrawnMotion(times=times, states=states, forces=forces)
    with busy("drawing"):
        return tool_figure(model.tool.name, model, motion, surface_height=height, learned=False)


def _figure_of_bag(arguments: argparse.Namespace) -> Figure:
    bag = arguments.source
    config, chosen = options.recording(arguments)
    options.refuse_inputs(arguments, arguments.output, also=named_files(config))
    with busy("reading the tool"):
        model = config.model()
    load_code(needed(config))
    rows, estimator = played_estimates(bag, config, model, chosen)
    motion = played_motion(rows, estimator, begin=rows["stamp"][0])
    warnings.warn_of_estimates(model.tool, motion.times, rows["depth"], motion.forces)
    with busy("drawing"):
        return tool_figure(
            model.tool.name,
            model,
            motion,
            surface_height=config.surface_height,
            learned=config.learning.mode == "apply",
        )
