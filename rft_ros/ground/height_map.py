"""A height map: square cells with one height each. It is made from points or read from a file, and written to one."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError
from rft_ros.files import read_arrays, whole
from rft_ros.rft.arguments import number, numbers
from rft_ros.rft.kernel.compilation import compiled, inlined
from rft_ros.table_file import columns_named, read_table

Array = NDArray[np.float64]
Numbers = NDArray[np.floating]
_Tool = tuple[Array, Array, Array]  # as for `HeightMap.with_points`

MAX_CELL_COUNT = 1 << 21
"""Greatest number of cells of a map, such as 8 m² of 2 mm cells (8 MB). Points that would enlarge it are left out."""

_MAX_DISTANCE_CELLS = 1e8  # from the origin
_MAX_HEIGHT_M = 1e6
_MARGIN_CELLS = 2.0  # around the tool in which points may be the tool's own
_REACH_CELLS = 700.0  # points further from the tool are left out, so that a stray one does not use up `MAX_CELL_COUNT`
_MAX_STEP_CELLS = 3.0  # grains cannot be this steep, so a cell that differs more from its neighbours is an outlier
# cells; the plane around a tool is fitted to the known cells within this radius, or more
_FIT_RADIUS_CELLS = 2
_NO_CELL = np.iinfo(np.int64).min
_COLUMNS = ("x", "y", "h")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HeightMap:
    """Heights of square cells in the world frame.

    `cell`: side of a cell [m]. `corner`: x and y of the first cell's lower corner, in cells: cell (i, j) of `heights`
    covers x from (corner[0] + i) cell to (corner[0] + i + 1) cell, and y likewise. `heights`: world z [m], shape
    [n, m], copied; NaN where the height is unknown. `issue`: a sentence on what is doubtful about the file that the map
    was read from, or "". Raises ValueError that names the field that cannot be used.
    """

    cell: float
    corner: tuple[float, float]
    heights: NDArray[np.float32]
    issue: str = ""

    def __post_init__(self) -> None:
        number("cell", self.cell, positive=True)
        if not (abs(numbers("corner", self.corner, rows=2)) <= _MAX_DISTANCE_CELLS).all():
            raise ValueError(
                f"corner is {self.corner}; it must be two numbers of at most {_MAX_DISTANCE_CELLS:g} cells"
            )
        with np.errstate(over="ignore"):
            heights = np.array(self.heights, dtype=np.float32, order="C")
        if heights.ndim != 2 or not heights.size:
            raise ValueError(
                f"heights has shape {list(heights.shape)}; it must be [n, m], with at least one cell"
            )
        if (np.abs(heights) > _MAX_HEIGHT_M).any():
            raise ValueError(
                f"heights has values beyond {_MAX_HEIGHT_M:g} m; give NaN where nothing is known"
            )
        object.__setattr__(self, "heights", heights)

    @classmethod
    def unknown(cls, cell: float, corner: tuple[float, float] = (0.0, 0.0)) -> "HeightMap":
        """A map without any known height; `cell` [m]."""
        return cls(cell=cell, corner=corner, heights=np.full((1, 1), np.nan, dtype=np.float32))

    def points(self, *, at_most: int = MAX_CELL_COUNT) -> Array:
        """Centres of the known cells, or of every nth, and their heights: x, y, h [m], shape [k, 3]."""
        cells = np.argwhere(~np.isnan(self.heights))
        cells = cells[:: max(1, math.ceil(len(cells) / at_most))]
        return np.column_stack(
            [self.cell * (cells + self.corner + 0.5), self.heights[tuple(cells.T)]]
        )

    def filled(self) -> "HeightMap":
        """A map in which each unknown cell has the height of its nearest known one; the same if nothing is known."""
        from scipy.ndimage import distance_transform_edt

        unknown = np.isnan(self.heights)
        if unknown.all() or not unknown.any():
            return self
        i, j = distance_transform_edt(unknown, return_distances=False, return_indices=True)
        return HeightMap(cell=self.cell, corner=self.corner, heights=self.heights[i, j])

    def nearest(self, x: float, y: float) -> float:
        """Height of the cell at a place [m], or beside the map of the nearest one on its edge; NaN if it is unknown."""
        cells = np.array([x, y]) / self.cell - self.corner
        i, j = np.clip(cells, 0, np.array(self.heights.shape) - 1).astype(int)
        return float(self.heights[i, j])

    def heights_at(self, x: Array, y: Array) -> Array:
        """Height of the cell at each place [m], shape as `x` and `y` [m]; NaN where it is unknown."""
        padded_heights = np.pad(self.heights, 1, constant_values=np.nan)
        first_i, first_j = self.corner
        n, m = padded_heights.shape
        i = np.floor(x / self.cell - first_i).astype(int) + 1
        j = np.floor(y / self.cell - first_j).astype(int) + 1
        return np.asarray(padded_heights[i.clip(0, n - 1), j.clip(0, m - 1)], dtype=np.float64)

    def with_points(
        self, x: Numbers, y: Numbers, z: Numbers, tool: _Tool | None = None
    ) -> "HeightMap":
        """A new map, in which each cell that has points takes their median height. Releases the GIL while it computes.

        `x`, `y`, `z` [m], shape [n] each. `tool`: position [m], rotation to world, shape [3, 3], and corners in its own
        frame [m], shape [k, 3]. Some points are left out: those that are not finite, that lie in the box of the tool's
        corners or within two cells of it, or that would enlarge the map over `MAX_CELL_COUNT`. Outliers are left out:
        cells whose height differs from the median of their neighbours by more than three sides of a cell.
        """
        # distance of the cells from multiples of `cell`, in cells
        phase = np.append(np.mod(self.corner, 1.0), 0.0)
        offset = self.cell * phase
        box = _NO_BOX if tool is None else _box_of(tool, offset, self.cell)
        p = np.vstack([x, y, z]).astype(np.float64) - offset[:, None]
        first = np.floor(self.corner).astype(np.int64)
        any_known = not np.isnan(self.heights).all()
        end = first + self.heights.shape if any_known else first
        index, i0, j0, i1, j1 = _cells_of(p, self.cell, box, first, end)
        if i1 == i0:
            return self
        heights = np.full((i1 - i0, j1 - j0), np.nan, dtype=np.float32)
        if any_known:
            i, j = first - (i0, j0)
            n, m = self.heights.shape
            heights[i : i + n, j : j + m] = self.heights
        new_heights = np.full_like(heights, np.nan)
        _medians(p[2], index, i0, j0, new_heights)
        _take_plausible(new_heights, heights, _MAX_STEP_CELLS * self.cell)
        corner = i0 + float(phase[0]), j0 + float(phase[1])
        return HeightMap(cell=self.cell, corner=corner, heights=heights)


class _Box(NamedTuple):
    """The box around a tool: `position` of the tool [m], shape [3]; its `axes` as rows, shape [3, 3].

    `lowest` and `highest` point of the box in the tool's axes [m], shape [3]. `reach`: points are left out that lie
    further from the tool along x or y [m].
    """

    position: Array
    axes: Array
    lowest: Array
    highest: Array
    reach: float


_NO_BOX = _Box(np.zeros(3), np.zeros((3, 3)), np.full(3, np.inf), np.full(3, np.inf), np.inf)
"""A box without points."""


def _box_of(tool: _Tool, offset: Array, cell: float) -> _Box:
    """The box around a tool, `_MARGIN_CELLS` larger. `offset`: of the cells from multiples of `cell` [m]."""
    position, rotation, corners = tool
    margin = _MARGIN_CELLS * cell
    return _Box(
        position=position - offset,
        axes=np.ascontiguousarray(rotation.T),
        lowest=corners.min(axis=0) - margin,
        highest=corners.max(axis=0) + margin,
        reach=_REACH_CELLS * cell,
    )


@inlined
def _is_left_out(box, x, y, z):
    """Whether a point is in the box around the tool, or far from it."""
    dx = x - box.position[0]
    dy = y - box.position[1]
    dz = z - box.position[2]
    inside = True
    for c in range(3):
        coordinate = box.axes[c, 0] * dx + box.axes[c, 1] * dy + box.axes[c, 2] * dz
        inside = inside and box.lowest[c] <= coordinate <= box.highest[c]
    return inside or max(abs(dx), abs(dy)) > box.reach


@compiled
def _cells_of(p, cell, box, first, end):
    """The cell of each point, shape [2, n], and the first and end cells i0, j0, i1, j1 of the new map.

    Row 0 is `_NO_CELL` for a point that is left out. `first`, `end`: cells of the map so far.
    """
    index = np.full((2, p.shape[1]), _NO_CELL)
    i0, j0 = first
    i1, j1 = end
    farthest = _MAX_DISTANCE_CELLS * cell
    for k in range(p.shape[1]):
        x, y, z = p[0, k], p[1, k], p[2, k]
        is_possible = abs(x) < farthest and abs(y) < farthest and abs(z) < _MAX_HEIGHT_M
        if not is_possible or _is_left_out(box, x, y, z):  # the first also for NaN
            continue
        i = int(np.floor(x / cell))
        j = int(np.floor(y / cell))
        if i1 == i0:  # the first cell that is known
            i0, j0 = i, j
            i1, j1 = i, j
        low_i, low_j = min(i0, i), min(j0, j)
        high_i, high_j = max(i1, i + 1), max(j1, j + 1)
        if (high_i - low_i) * (high_j - low_j) <= MAX_CELL_COUNT:
            i0, j0 = low_i, low_j
            i1, j1 = high_i, high_j
            index[0, k] = i
            index[1, k] = j
    return index, i0, j0, i1, j1


@inlined
def _median(values, n):
    """Median of the first `n` values. Sorts them in place by Shell's sort, which is fast for few points."""
    gap = n
    while gap > 1:
        gap = max(gap * 5 // 11, 1)
        for a in range(gap, n):
            v = values[a]
            b = a
            while b >= gap and values[b - gap] > v:
                values[b] = values[b - gap]
                b -= gap
            values[b] = v
    return 0.5 * (values[(n - 1) // 2] + values[n // 2])


@compiled
def _medians(z, index, i0, j0, new_heights):
    """Write the median height of the points in each cell to `new_heights`: counting sort by cell."""
    m = new_heights.shape[1]
    end = np.zeros(new_heights.size, dtype=np.int64)
    for k in range(z.shape[0]):
        if index[0, k] != _NO_CELL:
            end[(index[0, k] - i0) * m + index[1, k] - j0] += 1
    for c in range(1, new_heights.size):
        end[c] += end[c - 1]
    sorted_z = np.empty(end[-1])
    for k in range(z.shape[0]):
        if index[0, k] != _NO_CELL:
            c = (index[0, k] - i0) * m + index[1, k] - j0
            # a cell is filled from its end, so that this becomes the index of its first point
            end[c] -= 1
            sorted_z[end[c]] = z[k]
    for c in range(new_heights.size):
        n = (end[c + 1] if c + 1 < new_heights.size else len(sorted_z)) - end[c]
        if n > 0:
            new_heights[c // m, c % m] = _median(sorted_z[end[c] :], n)


@compiled
def _take_plausible(new_heights, heights, jump):
    """Copy the cells of `new_heights` to `heights`, except those further than `jump` from the median around them."""
    neighbours = np.empty(8)
    for i in range(new_heights.shape[0]):
        for j in range(new_heights.shape[1]):
            if np.isnan(new_heights[i, j]):
                continue
            count = 0
            for a in range(max(i - 1, 0), min(i + 2, new_heights.shape[0])):
                for b in range(max(j - 1, 0), min(j + 2, new_heights.shape[1])):
                    if not np.isnan(new_heights[a, b]) and (a != i or b != j):
                        neighbours[count] = new_heights[a, b]
                        count += 1
            if count == 0 or abs(new_heights[i, j] - _median(neighbours, count)) <= jump:
                heights[i, j] = new_heights[i, j]


def read_height_map(file: Path | str, cell: float) -> HeightMap:
    """A height map with cells of side `cell` [m] from a CSV file with the columns x, y, h [m], or an NPZ file of these.

    The arrays of an NPZ file have one shape, or form a grid: x shape [n], y [m], h [n, m], NaN where h is unknown.
    Raises InputError for a file that cannot be used or does not fit in `MAX_CELL_COUNT`.
    """
    what = f"ground.file '{file}'"
    number("ground.cell", cell, positive=True)
    x, y, h = _points_of(Path(file), what)
    if not len(x) or not len(x) == len(y) == len(h):
        counts = f"{len(x)} x, {len(y)} y and {len(h)} h"
        raise InputError(
            f"{what} has {counts}; it needs the same number of each, and at least one"
        )
    limit = min(_MAX_DISTANCE_CELLS * cell, _MAX_HEIGHT_M)
    if not np.less(np.abs([x, y, h]), limit).all():  # NaN, too
        raise InputError(
            f"{what} has values that are not finite or not below {limit:g} m; remove their rows"
        )
    # The first point lies in the middle of its cell. The points of a grid then lie far from the borders of cells.
    corner = round(x.min() / cell - 0.5, 6) % 1.0, round(y.min() / cell - 0.5, 6) % 1.0
    first_i, first_j = corner
    n = np.ptp(np.floor(x / cell - first_i)) + 1.0
    m = np.ptp(np.floor(y / cell - first_j)) + 1.0
    if n * m > MAX_CELL_COUNT:
        raise InputError(
            f"{what} spans {n:.0f} x {m:.0f} cells of ground.cell {cell:g} m; the limit is {MAX_CELL_COUNT:,}"
        )
    ground = HeightMap.unknown(cell, corner).with_points(x, y, h)
    return replace(ground, issue=_issue_of(ground, what))


def _points_of(file: Path, what: str) -> tuple[Array, Array, Array]:
    """The columns x, y, h of a file, shape [n] each, if they are of one length."""
    if file.suffix.lower() != ".npz":
        x, y, h = read_table(file, "ground.file", columns_named(_COLUMNS)).columns.values()
        return x, y, h
    x, y, h = read_arrays(file, "ground.file", _COLUMNS)
    if any(v.dtype.kind not in "fiu" for v in (x, y, h)):
        raise InputError(
            f"{what} has arrays that are not numbers; write x, y and h as numbers [m]"
        )
    x, y, h = (values.astype(np.float64) for values in (x, y, h))
    if h.ndim == 2 and h.shape == (*x.shape, *y.shape):
        i, j = np.nonzero(~np.isnan(h))
        return x[i], y[j], h[i, j]
    return x.ravel(), y.ravel(), h.ravel()


def _issue_of(ground: HeightMap, what: str) -> str:
    """A sentence on a map most of whose known cells have no other one so close that a plane is fitted to both."""
    from scipy.ndimage import uniform_filter

    is_known = ~np.isnan(ground.heights)
    count = int(is_known.sum())
    width = 2 * _FIT_RADIUS_CELLS + 1
    neighbour_count = (
        uniform_filter(is_known.astype(np.float32), width, mode="constant")[is_known] * width**2
    )
    if count < 2 or np.mean(neighbour_count < 1.5) < 0.5:
        return ""
    spacing = ground.cell * math.sqrt(is_known.size / count)
    sparse = f"has heights about {spacing:.2g} m apart, sparser than ground.cell {ground.cell:g} m"
    return (
        f"{what} {sparse}: between them surface_height is used; set ground.cell to {spacing:.2g}"
    )


def write_height_map(file: Path, ground: HeightMap) -> None:
    """Write a grid (NPZ) if the file's suffix is .npz, otherwise the known cells (CSV). Raises InputError."""
    with whole(file, "height map") as part:
        if file.suffix == ".npz":
            first_i, first_j = ground.corner
            n, m = ground.heights.shape
            x = ground.cell * (first_i + 0.5 + np.arange(n))
            y = ground.cell * (first_j + 0.5 + np.arange(m))
            np.savez(part, x=x, y=y, h=ground.heights)
        else:
            np.savetxt(
                part,
                ground.points(),
                fmt="%.9g",
                delimiter=",",
                header=",".join(_COLUMNS),
                comments="",
            )
