"""Draw a tool on its way through the grains: a page that plays it, or a film.

rft view states.csv --mesh my_tool.stl --zeta 0.33 -o tool.html
rft view out/demo/bag --params config/demo.yaml -o tool.gif
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
    recording,
    recording_options,
    surface_option,
)
from rft_ros.errors import InputError
from rft_ros.progress import busy

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rft_ros.report.moving_tool import MovingTool
    from rft_ros.rft import Law
    from rft_ros.tool import Tool

__all__ = ["add_options", "moving_tool", "run"]

_MOMENTS = 60
_MOST_FACES = 1500


def add_options(command: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    command.add_argument("source", type=Path, metavar="STATES.csv|BAG", help=f"states as for rft predict, or a {BAG}")
    states = command.add_argument_group("for states")
    states.add_argument("--mesh", metavar="FILE", help=MESH)
    mesh_options(states)
    law_options(states)
    surface_option(states)
    recording_options(command.add_argument_group("for a bag"))
    command.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT", help="OUT.html, OUT.gif or OUT.mp4 (needs ffmpeg)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Draw; exit status."""
    from rft_ros.report.moving_tool import FILMS, write_film, write_moving_page

    suffix = arguments.output.suffix
    if suffix not in (".html", *FILMS):
        raise InputError(f"'{arguments.output}' must end in .html, {' or '.join(FILMS)}")
    parts = _of_states(arguments) if arguments.source.suffix == ".csv" else _of_bag(arguments)
    with busy("drawing"):
        scene = moving_tool(*parts)
        (write_moving_page if suffix == ".html" else write_film)(scene, arguments.output)
    print(f"{len(scene.times)} moments of {scene.title} -> {arguments.output}")
    return 0


def _of_states(arguments: argparse.Namespace):  # type: ignore[no-untyped-def]
    from rft_ros.states_file import read_states
    from rft_ros.tool import load_tool

    if arguments.mesh is None:
        raise InputError(f"states file '{arguments.source}' needs --mesh: the tool whose states they are")
    times, states = read_states(arguments.source)
    tool = load_tool(arguments.mesh, scale=arguments.scale, origin=arguments.origin)
    return tool.name, tool, law_of(arguments), times, states, arguments.surface_height


def _of_bag(arguments: argparse.Namespace):  # type: ignore[no-untyped-def]
    from rft_ros.bags.playback import states_of
    from rft_ros.estimator.parameters import model_of, settings_of

    values, options = recording(arguments)
    model = model_of(values)
    times, states = states_of(arguments.source, values, model, options)
    remembers = model.mobilization_length > 0.0
    title = f"{model.tool.name} (law at full strength, without memory)" if remembers else model.tool.name
    return title, model.tool, model.law, times, states, settings_of(values).surface_height


def moving_tool(
    title: str,
    tool: "Tool",
    law: "Law",
    times: "NDArray[np.float64]",
    states: "NDArray[np.float64]",
    surface_height: float = 0.0,
) -> "MovingTool":
    """The scene of states, shape [n, 13], at times [s], shape [n]; at most 60 moments, evenly spaced by index.

    The traction is the law's, without memory. `surface_height` [m].
    """
    import numpy as np

    from rft_ros.report.moving_tool import MovingTool
    from rft_ros.rft import plate_forces, rotation_matrix
    from rft_ros.tool.drawing import drawable

    chosen = np.unique(np.linspace(0, len(states) - 1, min(len(states), _MOMENTS)).round().astype(int))
    vertices, faces, plates = drawable(tool, most_faces=_MOST_FACES)
    forces = np.array([plate_forces(plates, law, states[k], surface_height=surface_height) for k in chosen])
    placed = [vertices @ rotation_matrix(states[k, 3:7]).T + states[k, :3] for k in chosen]
    return MovingTool(
        title=title,
        times=times[chosen],
        placed=np.array(placed),
        faces=faces,
        traction=np.linalg.norm(forces, axis=2) / plates.packed[6],
        origins=states[chosen, :3],
        forces=forces.sum(axis=1),
        surface_height=surface_height,
    )
