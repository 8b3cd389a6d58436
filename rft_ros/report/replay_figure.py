"""One figure of a replay: measured, predicted and residual force over time, and vertical force over depth."""

import csv
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

__all__ = ["draw_replay"]

_POINTS = 4000  # a line, more than a figure resolves

_KINDS = {"compensated": ("measured", "#1f77b4"), "predicted": ("predicted", "#d62728"), "residual": ("residual", "0.55")}


def draw_replay(table: Path, picture: Path, *, title: str) -> None:
    """Draw the estimates.csv of a replay to a PNG file."""
    from matplotlib.figure import Figure

    columns = _read(table)
