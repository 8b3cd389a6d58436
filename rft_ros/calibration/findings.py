"""What a fit came to: a value with its standard error and goodness of fit, or the reason why it cannot be told."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

__all__ = ["CannotTell", "Finding", "Refusal", "mean_of"]


class CannotTell(Exception):  # noqa: N818 (it is an answer, not a fault)
    """The data do not hold what was asked for: one sentence with the numbers that say so."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A fitted quantity: `values` and their standard `errors` in `unit`; `goodness` of the fit in words and numbers.

    `source`: what it was fitted to. `parameter`: the node's parameter that takes the values; "" for what has none.
    """

    name: str
    values: tuple[float, ...]
    errors: tuple[float, ...]
    unit: str
    goodness: str
    source: str
    parameter: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Refusal:
    """What could not be told, and the sentence that says why."""

    name: str
    why: str


def mean_of(values: Sequence[float], errors: Sequence[float]) -> tuple[float, float]:
    """Mean of repeated measurements and its standard error.

    The error is the greater of what the scatter between them and what their own standard errors make of it: two or
    three repetitions may agree by chance, and none of them knows what differs between them (the bed, the packing).
    """
    n = len(values)
    own = float(np.sqrt(np.sum(np.square(errors)))) / n
    between = float(np.std(values, ddof=1)) / n**0.5 if n > 1 else 0.0
    return float(np.mean(values)), max(own, between)
