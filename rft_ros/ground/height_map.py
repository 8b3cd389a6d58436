"""A height map: square cells with one height each, from points, from files, and to files."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import read_arrays, read_columns, whole
from rft_ros.rft.compilation import compiled

__all__ = ["MOST_CELLS", "HeightMap", "ToolBox", "read_height_map", "write_height_map"]

Array = NDArray[np.float64]
Numbers = NDArray[np.floating]

MOST_CELLS = 1 << 21
"""Greatest number of cells of a map: 8 m² of 2 mm cells, 8 MB. Points that would enlarge it further are left out."""

_FARTHEST = 1e8  # cells from the origin
_HIGHEST = 1e6  # greatest |height| [m]
_MARGIN = 2.0  # cells around the tool in which points may be the tool's own
_REACH = 700.0  # cells; points further from the tool are left out
_FEW = 16  # points in a cell
_JUMP = 3.0  # cells; grains slide at slopes far below this, so a cell that stands out further is an outlier


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolBox:
    """A tool's bounding box, placed in the world; points in it or within two cells of it are the tool's own.

    `position` [m], shape [3]; `rotation`: tool to world, shape [3, 3]; `low`, `high`: corners in the tool frame [m].
    """

    position: Array
    rotation: Array
    low: Array
    high: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightMap:
    """Heights of square cells in the world frame; immutable.

    `cell`: side of a cell [m]. `corner`: x and y of the first cell, in cells; cell (i, j) of `heights` covers x from
    (corner[0] + i) cell, and y likewise. `heights`: world z [m], shape [n, m]; NaN where nothing is known.
    """

    cell: float
    corner: tuple[float, float]
    heights: NDArray[np.float32]

    def __post_init__(self) -> None:
        self.heights.flags.writeable = False

    @classmethod
    def unknown(cls, cell: float) -> "HeightMap":
        """A map of which nothing is known; `cell` [m]."""
        return cls(cell=cell, corner=(0.0, 0.0), heights=np.full((1, 1), np.nan, dtype=np.float32))

    def points(self, *, at_most: int = MOST_CELLS) -> Array:
        """Centres of the known cells, or of every nth, and their heights: x, y, h [m], shape [k, 3]."""
        known = np.flatnonzero(~np.isnan(self.heights))
        i, j = np.unravel_index(known[:: -(-len(known) // at_most) or 1], self.heights.shape)
        x, y = (self.cell * (index + start + 0.5) for index, start in zip((i, j), self.corner, strict=True))
        return np.column_stack([x, y, self.heights[i, j].astype(np.float64)])

    def heights_at(self, x: Array, y: Array) -> Array:
        """Height of the cell at each place [m], shape as `x` and `y` [m]; NaN where nothing is known."""
        i, j = (np.floor(v / self.cell - start).astype(int) for v, start in zip((x, y), self.corner, strict=True))
        n, m = self.heights.shape
        inside = (i >= 0) & (i < n) & (j >= 0) & (j < m)
        found = np.where(inside, self.heights[np.clip(i, 0, n - 1), np.clip(j, 0, m - 1)], np.nan)
        return found.astype(np.float64)

    def with_points(self, x: Numbers, y: Numbers, z: Numbers, tool: ToolBox | None = None) -> "HeightMap":
        """The map in which each cell that the points hit takes their median height.

        `x`, `y`, `z` [m], shape [n] each. Points that are not finite, that belong to the `tool`, or that would enlarge
        the map over `MOST_CELLS` are left out, and cells that differ from the median of the cells around them by over
        three cells' sides. Releases the GIL while it computes.
        """
        p = np.array(np.vstack([x, y, z]), dtype=np.float64)
        phase = np.append(np.mod(self.corner, 1.0), 0.0)  # cells of the map that do not begin at multiples of `cell`
        p -= self.cell * phase[:, None]
        box = np.zeros(18)
        if tool is not None:
            box[:] = (
                *(tool.position - self.cell * phase),
                *tool.rotation.ravel(),
                *(tool.low - _MARGIN * self.cell),
                *(tool.high + _MARGIN * self.cell),
            )
        bounds, index = np.empty(4, dtype=np.int64), np.empty((2, p.shape[1]), dtype=np.int64)
        corner = np.floor(self.corner).astype(np.int64)
        old = np.append(corner, corner + self.heights.shape)
        if np.isnan(self.heights).all():
            old[2:] = old[:2]
        if not _cells_of(p, self.cell, box, tool is not None, old, index, bounds):
            return self
        i0, j0, i1, j1 = bounds.tolist()
        heights = np.full((i1 - i0, j1 - j0), np.nan, dtype=np.float32)
        if old[2] > old[0]:
            a, b = int(old[0]) - i0, int(old[1]) - j0
            heights[a : a + self.heights.shape[0], b : b + self.heights.shape[1]] = self.heights
        seen = np.full(heights.shape, np.nan, dtype=np.float32)
        _medians(p[2], index, i0, j0, seen)
        _take_plausible(seen, heights, _JUMP * self.cell)
        return HeightMap(cell=self.cell, corner=(i0 + float(phase[0]), j0 + float(phase[1])), heights=heights)


@compiled
def _cells_of(p, cell, box, has_tool, old, index, bounds):  # type: ignore[no-untyped-def]
    """Write each point's cell to `index`, column 0 minimal for one left out, and the new map's `bounds`.

    Returns how many points are used.
    """
    left_out = np.iinfo(np.int64).min
    for b in range(4):
        bounds[b] = old[b]
    count = 0
    for k in range(p.shape[1]):
        x, y, z = p[0, k], p[1, k], p[2, k]
        index[0, k] = left_out
        if not (abs(x) < _FARTHEST * cell and abs(y) < _FARTHEST * cell and abs(z) < _HIGHEST):  # NaN, too
            continue
        if has_tool:
            dx, dy, dz = x - box[0], y - box[1], z - box[2]
            inside = True
            if max(abs(dx), abs(dy)) > _REACH * cell:  # so that a stray point does not decide where the map lies
                continue
            for c in range(3):
                r = box[3 + c] * dx + box[6 + c] * dy + box[9 + c] * dz
                inside = inside and box[12 + c] <= r <= box[15 + c]
            if inside:
                continue
        i, j = int(np.floor(x / cell)), int(np.floor(y / cell))
        first = bounds[2] <= bounds[0]
        i0, i1 = (i, i + 1) if first else (min(bounds[0], i), max(bounds[2], i + 1))
        j0, j1 = (j, j + 1) if first else (min(bounds[1], j), max(bounds[3], j + 1))
        if (i1 - i0) * (j1 - j0) > MOST_CELLS:
            continue
        bounds[0], bounds[1], bounds[2], bounds[3] = i0, j0, i1, j1
        index[0, k], index[1, k] = i, j
        count += 1
    return count


@compiled
def _medians(z, index, i0, j0, seen):  # type: ignore[no-untyped-def]
    """Write the median height of the points in each cell to `seen`; a counting sort by cell."""
    n, m = seen.shape
    first = np.zeros(n * m + 1, dtype=np.int64)
    for k in range(z.shape[0]):
        if index[0, k] >= i0:
            first[(index[0, k] - i0) * m + index[1, k] - j0 + 1] += 1
    for c in range(n * m):
        first[c + 1] += first[c]
    place, ordered = first[:-1].copy(), np.empty(first[n * m])
    for k in range(z.shape[0]):
        if index[0, k] >= i0:
            c = (index[0, k] - i0) * m + index[1, k] - j0
            ordered[place[c]] = z[k]
            place[c] += 1
    for c in range(n * m):
        if first[c + 1] > first[c]:
            part = ordered[first[c] : first[c + 1]]
            if len(part) > _FEW:
                part.sort()
            else:
                for b in range(1, len(part)):  # insertion sort, which is faster for few
                    h, a = part[b], b
                    while a > 0 and part[a - 1] > h:
                        part[a] = part[a - 1]
                        a -= 1
                    part[a] = h
            seen[c // m, c % m] = 0.5 * (part[(len(part) - 1) // 2] + part[len(part) // 2])


@compiled
def _take_plausible(seen, heights, jump):  # type: ignore[no-untyped-def]
    """Copy the cells of `seen` to `heights`, except those further than `jump` from the median around them."""
    n, m = seen.shape
    around = np.empty(8)
    for i in range(n):
        for j in range(m):
            h = seen[i, j]
            if np.isnan(h):
                continue
            count = 0
            alike = True
            for a in range(max(i - 1, 0), min(i + 2, n)):
                for b in range(max(j - 1, 0), min(j + 2, m)):
                    alike = alike and not abs(seen[a, b] - h) > jump
            if alike:  # then the median is, too
                heights[i, j] = h
                continue
            for a in range(max(i - 1, 0), min(i + 2, n)):
                for b in range(max(j - 1, 0), min(j + 2, m)):
                    if (a != i or b != j) and not np.isnan(seen[a, b]):
                        k = count  # insertion sort
                        while k > 0 and around[k - 1] > seen[a, b]:
                            around[k] = around[k - 1]
                            k -= 1
                        around[k] = seen[a, b]
                        count += 1
            if count == 0 or abs(h - 0.5 * (around[(count - 1) // 2] + around[count // 2])) <= jump:
                heights[i, j] = h


_COLUMNS = ("x", "y", "h")


def _phase(u: Array) -> float:
    """Where in a unit cell its border should lie, so that points `u`, in cells, lie at the middle of theirs.

    The mean angle on a circle of one cell's length; 0 for points without a common place in their cells.
    """
    mean = np.exp(2j * np.pi * u).mean()
    return round(float(np.angle(mean)) / (2.0 * np.pi) - 0.5, 6) % 1.0 if abs(mean) > 0.5 else 0.0


def read_height_map(file: Path, cell: float) -> HeightMap:
    """A height map from a CSV file with the columns x, y, h, or an NPZ file with these arrays [m].

    They have one shape; or x shape [n], y [m] and h [n, m], NaN where nothing is known.

    Each cell of side `cell` [m] takes the median of the heights in it; the points of a grid as wide as that lie in the
    middle of their cells, wherever it begins. Raises InputError, one sentence, for a file that
    cannot be used or does not fit in `MOST_CELLS`.
    """
    what = "ground.file"
    if file.suffix.lower() == ".npz":
        x, y, h = read_arrays(file, what, _COLUMNS)
        if any(v.dtype.kind not in "fiu" for v in (x, y, h)):
            raise InputError(f"ground.file '{file}' has arrays that are not numbers")
        if h.ndim == 2 and h.shape == (*x.shape, *y.shape):
            i, j = np.nonzero(~np.isnan(h))
            x, y, h = x[i], y[j], h[i, j]
        x, y, h = (v.ravel().astype(np.float64) for v in (x, y, h))
    else:
        x, y, h = read_columns(file, what, _COLUMNS)[0].T
    if not len(x) or not len(x) == len(y) == len(h):
        counts = f"{len(x)} x, {len(y)} y and {len(h)} h"
        raise InputError(f"ground.file '{file}' has {counts}; it needs the same number of each, and at least one")
    limit = min(_FARTHEST * cell, _HIGHEST)
    if not np.less(np.abs([x, y, h]), limit).all():  # NaN, too
        raise InputError(
            f"ground.file '{file}' has values that are not finite or not below {limit:g} m; remove their rows"
        )
    start = (_phase(x / cell), _phase(y / cell))  # heights of a grid: rounding must not put a point into either cell
    spans = [np.ptp(np.floor(v / cell - first)) + 1.0 for v, first in zip((x, y), start, strict=True)]
    if spans[0] * spans[1] > MOST_CELLS:
        raise InputError(
            f"ground.file '{file}' spans {spans[0]:.0f} x {spans[1]:.0f} cells of ground.cell {cell:g} m;"
            f" it must fit in {MOST_CELLS:,} cells"
        )
    return replace(HeightMap.unknown(cell), corner=start).with_points(x, y, h)


def write_height_map(file: Path, ground: HeightMap) -> None:
    """Write the known cells as CSV, or a grid as NPZ, by the file's suffix; `read_height_map` reads both.

    Raises InputError if it cannot be written.
    """
    with whole(file, "height map") as part:
        if file.suffix == ".npz":
            x, y = (
                ground.cell * (first + 0.5 + np.arange(n))
                for first, n in zip(ground.corner, ground.heights.shape, strict=True)
            )
            np.savez(part, x=x, y=y, h=ground.heights)
        else:
            np.savetxt(part, ground.points(), fmt="%.9g", delimiter=",", header=",".join(_COLUMNS), comments="")
