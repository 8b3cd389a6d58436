"""`rft study stability`: all figures of docs/where-it-fails.md, with their numbers."""

from collections.abc import Callable
from pathlib import Path

from rft_ros.studies.outcome import Outcome
from rft_ros.studies.stability.hollow import hollow
from rft_ros.studies.stability.mesh_faults import mesh_faults
from rft_ros.studies.stability.overview import overview
from rft_ros.studies.stability.plate_sweeps import along_itself, knife_edge, level
from rft_ros.studies.stability.reversal import reversal
from rft_ros.studies.stability.speed import speed
from rft_ros.studies.stability.surface import surface
from rft_ros.studies.stability.time_step import time_step
from rft_ros.studies.stability.turning import turning
from rft_ros.studies.stability.wake import wake
from rft_ros.studies.stability.window import window
from rft_ros.studies.stability.withdrawal import withdrawal

__all__ = ["CASES", "study"]

CASES: tuple[Callable[[], Outcome], ...] = (
    overview,
    level,
    along_itself,
    knife_edge,
    reversal,
    window,
    withdrawal,
    turning,
    surface,
    speed,
    wake,
    hollow,
    mesh_faults,
    time_step,
)
"""Each bad place, in the order of the page."""


def study(data: Path | None = None) -> tuple[Outcome, ...]:
    """All cases; they need no data but the shipped meshes, so that `data` is not looked at."""
    del data
    return tuple(case() for case in CASES)
