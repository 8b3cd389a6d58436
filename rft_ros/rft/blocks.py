"""Plates in blocks of neighbours, so that the kernel passes over blocks in which nothing is wet or leads.

A body moves with about half of its plates trailing, and a tool is seldom all in the grains. Skipping a single plate
would cost the vector registers more than it saves; a block of them with like normals and places is another matter.
"""

from dataclasses import dataclass
from math import cos, radians

import numpy as np
from numpy.typing import NDArray

from rft_ros.rft.compiled import inlined
from rft_ros.rft.traction import FLAT, FLAT_BLEND

__all__ = ["BLOCK", "CUT", "FLAT_OR_CUT", "PLAIN", "SKIP_DRY", "SKIP_WET", "Blocks", "blocks_of", "kind_of_block"]

BLOCK = 16
"""Plates in a block: two AVX-512 registers."""

SKIP_DRY, SKIP_WET, PLAIN, CUT, FLAT_OR_CUT = 0, 1, 2, 3, 4
"""What a block needs: nothing; its area counted; the quick loop (submerged, none horizontal); one that looks where the
surface cuts the plates; one that also looks which are horizontal."""

_LEVEL = cos(radians(FLAT_BLEND))

_SLACK = 1e-12  # of the bounds, against rounding


@dataclass(frozen=True, slots=True, eq=False)
class Blocks:
    """Plates in the kernel's order, padded to whole blocks by copies without area.

    `rows`: shape [7 or 14, m]: those of `Plates.packed`, and for the refined rule two corners from the centroid [m] and
    1 / (2 sin θ). `order`: plate of each column before the padding, shape [n]. `bounds`: shape [m / BLOCK, 20], see
    `kind_of_block`. `extents`: greatest distance of a plate's points from its centroid [m], shape [n], mesh order.
    """

    rows: NDArray[np.float64]
    order: NDArray[np.int64]
    bounds: NDArray[np.float64]
    extents: NDArray[np.float64]

    def __post_init__(self) -> None:
        for array in (self.rows, self.order, self.bounds, self.extents):
            array.flags.writeable = False


def blocks_of(rows: NDArray[np.float64]) -> Blocks:
    """Sort plates, shape [7 or 14, n], units as in `Plates.packed`, into blocks of like normals and places."""
    n = rows.shape[1]
    extents = np.zeros(n)
    if len(rows) > 7:
        first, second = rows[7:10], rows[10:13]
        extents = np.sqrt(np.max([(e * e).sum(axis=0) for e in (first, second, first + second)], axis=0))
    center = rows[:3] - rows[:3].mean(axis=1, keepdims=True)
    size = np.abs(center).max()
    # a tool's length in place weighs as much as a quarter turn of the normal
    order = _neighbours(np.vstack([rows[3:6], center / size if size > 0.0 else center]))
    padding = -n % BLOCK
    packed = np.concatenate([rows[:, order], np.repeat(rows[:, order[-1:]], padding, axis=1)], axis=1)
    packed[6, n:] = 0.0
    far = np.concatenate([extents[order], np.zeros(padding)])
    return Blocks(np.ascontiguousarray(packed), order, _bounds(packed, far), extents)


def _neighbours(features: NDArray[np.float64]) -> NDArray[np.int64]:
    """An order in which every `BLOCK` consecutive columns are alike: halved along the widest row, again and again."""

    def ordered(columns: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        if len(columns) <= BLOCK:
            return [columns]
        here = features[:, columns]
        widest = int(np.argmax(np.ptp(here, axis=1)))
        half = BLOCK * -(-len(columns) // (2 * BLOCK))
        by_size = columns[np.argsort(here[widest], kind="stable")]
        return ordered(by_size[:half]) + ordered(by_size[half:])

    return np.concatenate(ordered(np.arange(features.shape[1])))


def _bounds(rows: NDArray[np.float64], extents: NDArray[np.float64]) -> NDArray[np.float64]:
    by_block = rows.reshape(len(rows), -1, BLOCK)
    place, normal, area = by_block[:3], by_block[3:6], by_block[6]
    moment = np.cross(place, normal, axis=0)
    far = extents.reshape(-1, BLOCK)

    def box(vectors: NDArray[np.float64], more: NDArray[np.float64]) -> NDArray[np.float64]:
        low, high = (vectors - more).min(axis=2), (vectors + more).max(axis=2)
        return np.vstack([0.5 * (low + high), 0.5 * (high - low) * (1.0 + _SLACK)])

    fade = 0.5 / by_block[13].min(axis=1) if len(rows) > 7 else np.zeros(by_block.shape[1])
    boxes = box(normal, np.zeros_like(far)), box(moment, far), box(place, far)
    return np.ascontiguousarray(np.vstack([*boxes, area.sum(axis=1), fade]).T)


@inlined
def _middle(bounds, b, box, v):  # type: ignore[no-untyped-def]
    """A vector times the middle of a block's box."""
    return v[0] * bounds[b, 6 * box] + v[1] * bounds[b, 6 * box + 1] + v[2] * bounds[b, 6 * box + 2]


@inlined
def _spread(bounds, b, box, v):  # type: ignore[no-untyped-def]
    """How far a vector times what is in the box can lie from `_middle`."""
    return abs(v[0]) * bounds[b, 6 * box + 3] + abs(v[1]) * bounds[b, 6 * box + 4] + abs(v[2]) * bounds[b, 6 * box + 5]


@inlined
def kind_of_block(bounds, b, seen, below, refined):  # type: ignore[no-untyped-def]
    """Which of the five a block is, for certain; in doubt the more laborious.

    `seen`: `element.seen_from_tool`. `below`: depth of the origin. Columns of `bounds`: boxes (middle, half of the
    sides) of the normals, of r x n, and of the places; area; sine of the widest angle over which a plate begins to
    lead.
    """
    linear, angular, fastest, up, reach = seen
    depth, spread = below - _middle(bounds, b, 2, up), _spread(bounds, b, 2, up) + _SLACK * (reach + abs(below))
    if depth + spread <= 0.0:
        return SKIP_DRY
    wet = depth - spread > 0.0
    lead = _middle(bounds, b, 0, linear) + _spread(bounds, b, 0, linear)
    lead += _middle(bounds, b, 1, angular) + _spread(bounds, b, 1, angular)
    if wet and lead + (bounds[b, 19] + _SLACK) * fastest <= 0.0:
        return SKIP_WET
    tilt = abs(_middle(bounds, b, 0, up)) + _spread(bounds, b, 0, up) + _SLACK
    if tilt >= (_LEVEL if refined else FLAT):
        return FLAT_OR_CUT
    return PLAIN if wet else CUT
