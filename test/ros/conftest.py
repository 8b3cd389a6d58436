import contextlib
import itertools
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'rft_ros[ros]'")
sys.path.insert(0, str(Path(__file__).parent))

from distribution import own_domain
from harness import WAIT, Harness, NodeProcess

os.environ.update(own_domain())


@pytest.fixture(scope="session", autouse=True)
def ros() -> Iterator[None]:
    import rclpy

    from rft_ros.estimator.warm_up import prepare
    from rft_ros.node import swap

    # on a busy machine a file may take longer to check than a node in use waits
    swap._ANSWERS_WITHIN = WAIT
    prepare()  # else a node's first start compiles learning while tests use it
    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture
def start_node() -> Iterator[Callable[..., Harness]]:
    """Start a node in this process, with arguments that follow ``--ros-args``."""
    with contextlib.ExitStack() as started:
        yield lambda *arguments, **options: started.enter_context(
            contextlib.closing(Harness(*arguments, **options))
        )


@pytest.fixture
def start_process(tmp_path: Path) -> Iterator[Callable[..., NodeProcess]]:
    """Start a node as a user does; it is stopped at the end if it still runs."""
    with contextlib.ExitStack() as started:
        logs = (tmp_path / f"node{k}.log" for k in itertools.count())
        yield lambda *arguments, **options: started.enter_context(
            contextlib.closing(NodeProcess(*arguments, log=next(logs), **options))
        )


@pytest.fixture(scope="module")
def rft() -> Iterator[Harness]:
    """One node on the shipped plate in this process, shared by a module's tests; each restores what it changes."""
    with contextlib.closing(Harness("-p", "mesh.file:=plate").wait_ready()) as rft:
        yield rft
