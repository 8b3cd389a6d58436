"""Commands about a tool: check its mesh, reduce its plates, try variants of its design."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.commands import options
from rft_ros.errors import InputError
from rft_ros.progress import busy

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rft_ros.tool import Tool


def check_mesh_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("file", metavar="FILE", help=options.MESH)
    options.share(command, *options.PLACED)


def check_mesh(arguments: argparse.Namespace) -> int:
    """Report what a mesh file holds and what is wrong with it.

    rft check-mesh my_tool.stl --scale 0.001
    """
    from rft_ros.tool import describe_tool

    tool = options.tool_of(arguments, arguments.file)
    print("\n".join(describe_tool(tool)))
    return 1 if tool.issues else 0


def reduce_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("mesh", metavar="MESH", help=options.MESH)
    options.share(command, *options.PLACED, "--integration")
    allowed = "error allowed, as a share of force, at the 95th percentile of motions not used to choose (default 0.025)"
    options.add_number(command, "--tolerance", "SHARE", allowed, 0.025)
    scene = (
        "choose plates for these motions only: a states file, a recorded bag, or a family of motions (straight,"
        " plate_drag, oscillating_insertion, circumnutation) (default: any motion)"
    )
    options.add(command, "--scene", "STATES.csv|BAG|FAMILY", scene)
    file = "for a recorded bag: the node's parameter file"
    options.add(command, "--params", "FILE.yaml", file, type=Path)
    height = "world z of the surface in the scene [m] (default: the parameter file's, or 0)"
    options.add_number(command, "--surface-height", "Z", height)
    options.output(command, "OUT.npz", "file to write; accepted wherever a mesh is")


def reduce(arguments: argparse.Namespace) -> int:
    """Write a tool with the fewest plates that its motions need.

    rft reduce my_tool.stl --tolerance 0.01 -o my_tool.npz
    """
    from rft_ros.tool.mesh_file import SUFFIX, save_reduced
    from rft_ros.tool.reduce import reduced_for_any_motion, reduced_for_scene

    tolerance = arguments.tolerance
    if not 0.0 < tolerance <= 1.0:
        raise InputError(f"--tolerance is {tolerance:g}; it must be over 0, and at most 1")
    if arguments.output.suffix.lower() != SUFFIX:
        raise InputError(f"output '{arguments.output}' must end in {SUFFIX}, the suffix of reduced tools")
    options.refuse_inputs(arguments, arguments.output)
    tool = options.tool_of(arguments, arguments.mesh)
    if tool.reduction:
        raise InputError(f"mesh file '{tool.file}' is already a reduced tool; reduce the mesh that it was made from")
    states = None if arguments.scene is None else _scene(arguments, tool)
    with busy("choosing plates"):
        if states is None:
            plates, reduction = reduced_for_any_motion(tool.facets, tool.corners, tolerance)
        else:
            plates, reduction = reduced_for_scene(tool.facets, states, tolerance)
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

    name, surface = arguments.scene, arguments.surface_height
    values, chosen = options.recording(arguments)
    if name in FAMILIES:
        states = sample(FAMILIES[name](), 600)[1]
    elif Path(name).is_dir() or Path(name).suffix in (".bag", ".mcap", ".db3"):
        states = states_of(Path(name), values, model_of(values, tool=tool), chosen)[1]
    elif Path(name).suffix or Path(name).exists():
        states = read_states(Path(name))[1]
    else:
        raise InputError(f"--scene '{name}' is not a file or a family of motions ({', '.join(FAMILIES)})")
    states[:, 2] -= settings_of(values).surface_height if surface is None else surface
    return states


def sweep_options(command: argparse.ArgumentParser) -> None:
    study = "tools, motions and media, as in config/sweep_example.yaml"
    command.add_argument("study", type=Path, metavar="STUDY.yaml", help=study)
    options.output(command, "DIR", "folder for the results; a stopped sweep continues")
    options.add(command, "--scheduler", "tcp://HOST:PORT", "run on this Dask cluster (default: processes here)")
    options.add(command, "--workers", "N", "number of processes here (default: one per core)", type=int)
    command.add_argument("--format", choices=("csv", "parquet"), default="csv", help="kind of table (default csv)")


def sweep(arguments: argparse.Namespace) -> int:
    """Run a design study: tools × motions × media, on all cores or a cluster.

    rft sweep config/sweep_example.yaml -o out/sweep
    """
    from rft_ros.sweeps.design import read_design
    from rft_ros.sweeps.run import run

    if arguments.workers is not None and arguments.workers < 1:
        raise InputError(f"--workers is {arguments.workers}; it must be at least 1")
    design, out, form = read_design(arguments.study), arguments.output, arguments.format
    written = (out / name for name in ("study.json", "chunks", "results.csv", f"results.{form}"))
    options.refuse_inputs(arguments, *written, also=design.files())
    report = run(design, out, scheduler=arguments.scheduler, workers=arguments.workers, form=form)
    print("\n".join(report.lines()))
    return 1 if report.failed == report.rows else 0  # every variant failed
