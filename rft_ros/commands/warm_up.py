"""Compile all machine code that node and replay can need, so that no start and no change of a parameter waits for it.

rft warm-up
"""

import argparse


def add_options(_command: argparse.ArgumentParser) -> None:
    pass


def run(_arguments: argparse.Namespace) -> int:
    from rft_ros.estimator.warm_up import EVERY_CODE, prepare

    prepare(*EVERY_CODE, on_cold_cache=lambda: print("compiling, half a minute or more ...", flush=True))
    print("everything is compiled")
    return 0
