"""Figures and web pages of replays and of a tool in the grains."""

from rft_ros.report.animation import (
    TRACTION,
    Animation,
    Motion,
    animate,
    animation_figure,
    drawn_mesh,
    what_is_shown,
)
from rft_ros.report.page import Figure, Table, write_page
from rft_ros.report.stress_figure import check_figure, write_stress_figure

__all__ = [
    "TRACTION",
    "Animation",
    "Figure",
    "Motion",
    "Table",
    "animate",
    "animation_figure",
    "check_figure",
    "drawn_mesh",
]
__all__ += ["what_is_shown", "write_page", "write_stress_figure"]
