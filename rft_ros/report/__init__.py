"""Figures and web pages of replays and of a tool in the grains."""

from rft_ros.report.animation import (
    TRACTION,
    Animation,
    DrawnMotion,
    animate,
    drawn_mesh,
    tool_figure,
)
from rft_ros.report.page import Figure, Table, write_page
from rft_ros.report.stress_figure import check_figure, write_stress_figure

__all__ = [
    "TRACTION",
    "Animation",
    "DrawnMotion",
    "Figure",
    "Table",
    "animate",
    "check_figure",
    "drawn_mesh",
    "tool_figure",
    "write_page",
    "write_stress_figure",
]
