"""Compile the machine code that node and replay need, ahead of their first start.

rft warm-up --params my_cell.yaml
"""

import argparse
from pathlib import Path


def add_options(command: argparse.ArgumentParser) -> None:
    command.add_argument(
        "--params",
        type=Path,
        metavar="FILE.yaml",
        help="a parameter file: also compile what its density or its map of the ground needs",
    )


def run(arguments: argparse.Namespace) -> int:
    from rft_ros.estimator.warm_up import warm_up_all, warm_up_for
    from rft_ros.parameters import defaults, read_parameter_file

    def announce() -> None:
        print("compiling, half a minute or more ...", flush=True)

    values = read_parameter_file(arguments.params) if arguments.params else defaults()
    warm_up_all(memory=True, learning=True, on_cold_cache=announce)
    warm_up_for(values, on_cold_cache=announce)
    print("everything is compiled")
    return 0
