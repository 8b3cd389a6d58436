"""Compile the machine code that node and replay need, ahead of their first start.

rft warm-up
"""

import argparse

__all__ = ["add_options", "run"]


def add_options(_command: argparse.ArgumentParser) -> None:
    """Declare nothing: the command has no arguments."""


def run(_arguments: argparse.Namespace) -> int:
    """Compile; exit status 0."""
    from rft_ros.estimator.warm_up import warm_up_all

    def announce() -> None:
        print("compiling, a minute or more ...", flush=True)

    warm_up_all(memory=True, learning=True, on_cold_cache=announce)
    print("everything is compiled")
    return 0
