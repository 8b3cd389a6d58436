"""Draw a tool on its way through the grains: a page that plays it, a .gif or an .mp4."""

import argparse
from pathlib import Path

from rft_ros.commands.options import finite, mesh_options
from rft_ros.errors import InputError

__all__ = ["add_options", "run"]


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument("source", type=Path, metavar="STATES.csv|BAG", help="states as for `rft predict`, or a bag")
    command.add_argument("--mesh", metavar="FILE", help="for states: path, package:// URI or name of a shipped mesh")
    mesh_options(command)
    command.add_argument("--zeta", type=finite, default=1.0, help="for states: the medium's scale factor (default 1.0)")
    command.add_argument("--surface-height", type=finite, default=0.0, metavar="Z", help="for states: world z [m]")
    command.add_argument("--params", type=Path, metavar="FILE.yaml", help="for a bag: the node's parameter file")
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT", help="OUT.html, OUT.gif or OUT.mp4 (needs ffmpeg)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Draw; exit status."""
    from rft_ros.report.moving_tool import FILMS, write_film, write_moving_page
    from rft_ros.studies.view import moving_tool

    suffix = arguments.output.suffix
    if suffix not in (".html", *FILMS):
        raise InputError(f"'{arguments.output}' must end in .html, {' or '.join(FILMS)}")
    if arguments.source.suffix == ".csv":
        scene = moving_tool(*_of_states(arguments), surface_height=arguments.surface_height)
    else:
        *parts, surface_height = _of_bag(arguments)
        scene = moving_tool(*parts, surface_height=surface_height)
    (write_moving_page if suffix == ".html" else write_film)(scene, arguments.output)
    print(f"{len(scene.times)} moments of {scene.title} -> {arguments.output}")
    return 0


def _of_states(arguments: argparse.Namespace):  # type: ignore[no-untyped-def]
    from rft_ros.rft import alpha_y_model, medium_named, treers2021
    from rft_ros.states_file import read_states
    from rft_ros.tool import load_tool

    if arguments.mesh is None:
        raise InputError(f"states file '{arguments.source}' needs --mesh: the tool whose states they are")
    times, states = read_states(arguments.source)
    tool = load_tool(arguments.mesh, scale=arguments.scale, origin=arguments.origin)
    generic = medium_named("generic")
    try:
        law = treers2021(generic, alpha_y_model("constant", generic), zeta=arguments.zeta)
    except ValueError as error:
        raise InputError(str(error)) from None
    return tool, law, times, states


def _of_bag(arguments: argparse.Namespace):  # type: ignore[no-untyped-def]
    from rft_ros.bags.replay_options import ReplayOptions, read_replay_options
    from rft_ros.bags.states import states_of
    from rft_ros.estimator.parameter_file import read_parameter_file
    from rft_ros.estimator.parameters import defaults, model_of, settings_of

    values = read_parameter_file(arguments.params) if arguments.params else defaults()
    options = read_replay_options(arguments.params) if arguments.params else ReplayOptions()
    model = model_of(values)
    times, states = states_of(arguments.source, values, model, options)
    return model.tool, model.law, times, states, settings_of(values).surface_height
