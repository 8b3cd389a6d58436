"""The answer to one question about a cell."""

from collections.abc import Iterable
from typing import NamedTuple

__all__ = ["Finding", "listed"]


class Finding(NamedTuple):
    """Whether the set-up is right in one point, and a sentence on it, which says what to do if it is not."""

    ok: bool
    text: str


def listed(numbers: Iterable[float]) -> str:
    """Numbers as a parameter file takes them."""
    return "[" + ", ".join(f"{round(n, 4) + 0.0:g}" for n in numbers) + "]"
