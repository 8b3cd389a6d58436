"""What the doctor answers to one question about a cell."""

from typing import NamedTuple

__all__ = ["Finding"]


class Finding(NamedTuple):
    """Whether all is well, and a sentence, which says what to do if not."""

    ok: bool
    text: str
