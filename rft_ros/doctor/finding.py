"""The doctor's answer to one question about a cell."""

from typing import NamedTuple

__all__ = ["Finding"]


class Finding(NamedTuple):
    """Whether the set-up is right in one point, and a sentence on it, which says what to do if it is not."""

    ok: bool
    text: str
