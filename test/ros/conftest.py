import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'rft_ros[ros]'")
sys.path.insert(0, str(Path(__file__).parent))

from harness import Harness, own_domain

own_domain()


@pytest.fixture(scope="session", autouse=True)
def ros() -> Iterator[None]:
    import rclpy

    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture
def start_node(tmp_path: Path) -> Iterator[Callable[..., Harness]]:
    """Start a node process with arguments; every one that still runs is stopped at the end."""
    harnesses: list[Harness] = []

    def start(*arguments: str, **options: object) -> Harness:
        namespace = f"/node{len(harnesses)}"
        rft = Harness(*arguments, namespace=namespace, log=tmp_path / f"node{len(harnesses)}.log", **options)
        harnesses.append(rft)
        return rft

    yield start
    for rft in harnesses:
        if rft.process.poll() is None:
            rft.stop()


@pytest.fixture(scope="module")
def rft(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Harness]:
    """One node on the shipped plate, shared by a module's tests; each restores what it changes."""
    rft = Harness("-p", "mesh.file:=plate", log=tmp_path_factory.mktemp("node") / "node.log").wait_ready()
    yield rft
    rft.stop()
