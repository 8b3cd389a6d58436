"""`rft warm-up`: compile the machine code, so that no node or command compiles later."""

import argparse

from rft_ros.estimator.warm_up import prepare


def warm_up(_arguments: argparse.Namespace) -> int:
    """rft warm-up"""
    prepare(lambda: print("compiling, ten seconds or more ...", flush=True))
    print("everything is compiled")
    return 0
