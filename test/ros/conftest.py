import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed: pip install 'rft_ros[ros]'")
sys.path.insert(0, str(Path(__file__).parent))

from cell import Cell, own_domain

own_domain()


@pytest.fixture(scope="session", autouse=True)
def ros() -> Iterator[None]:
    import rclpy

    rclpy.init()
    yield
    rclpy.try_shutdown()


@pytest.fixture
def start_cell(tmp_path: Path) -> Iterator[Callable[..., Cell]]:
    """Start a node process with arguments; every one that still runs is stopped at the end."""
    cells: list[Cell] = []

    def start(*arguments: str, **options: object) -> Cell:
        namespace = f"/cell{len(cells)}"
        cell = Cell(*arguments, namespace=namespace, log=tmp_path / f"node{len(cells)}.log", **options)
        cells.append(cell)
        return cell

    yield start
    for cell in cells:
        if cell.process.poll() is None:
            cell.stop()


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cell]:
    """One node on the shipped plate, shared by a module's tests; each restores what it changes."""
    cell = Cell("-p", "mesh.file:=plate", log=tmp_path_factory.mktemp("node") / "node.log").wait_ready()
    yield cell
    cell.stop()
