"""Write the meshes that rft_ros ships: binary STL in millimetres beside this file, the same bytes every time.

Run from anywhere: ``python meshes/generate.py``.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
"""Vertices or triangles, the last axis being x, y, z [mm]."""


def main() -> None:
    """Write every mesh."""
    for name, triangles in meshes().items():
        Path(__file__).with_name(f"{name}.stl").write_bytes(stl(name, triangles))


def meshes() -> dict[str, Points]:
    """Triangles of each mesh in its tool frame [mm], shape [n, 3, 3], counter-clockwise seen from outside."""
    return {
        # horizontal plate of Treers et al. 2021
        "plate": cuboid(12, 12, 1) * [25.5, 25.5, 1.6],
        # ABB recordings: tool z points out of the tool, and z = 0 is the face that touches the sand first
        "abb_plate": cuboid(10, 8, 1) * [21.32, 16.285, 1.5] - [0.0, 0.0, 1.5],
        # ellipsoid of Treers et al. 2021, with as many facets as theirs
        "ellipsoid": unit_sphere(14, 14, 14) * [9.5, 9.5, 18.0],
        "sphere": unit_sphere(10, 10, 10) * 25.0,
        # root tip of Treers et al. 2021: z = -34.5 (1 - (r/10)²), tip down, origin at its base's centre
        "root_tip": paraboloid(radius=10.0, length=34.5, around=28, along=18, across=5),
        # a scoop of 3 mm walls, open to -x and upwards: origin at the middle of its upper rim
        "scoop": cells(scoop(22, 16, 9)) * 3.0 - [33.0, 24.0, 27.0],
    }


def cuboid(nx: int, ny: int, nz: int) -> Points:
    """The surface of the cube from -1 to 1, each face cut into squares and these into triangles.

    Diagonals mirror each other about a face's middle (exactly, for even numbers of squares), so that a motion
    with a mirror plane gets a force with that mirror plane.
    """
    cells = (nx, ny, nz)
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        n, m = cells[u], cells[v]
        i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(m), indexing="ij"))
        quads = np.ones((n * m, 4, 3))
        quads[:, :, u] = (2 * np.stack([i, i + 1, i + 1, i], axis=1) - n) / n
        quads[:, :, v] = (2 * np.stack([j, j, j + 1, j + 1], axis=1) - m) / m
        middle_u, middle_v = 2 * i + 1 - n, 2 * j + 1 - m
        product = middle_u * middle_v
        turned = np.where(product == 0, middle_u + middle_v, product) < 0
        quads = np.where(turned[:, None, None], np.roll(quads, 1, axis=1), quads)
        outer = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
        inner = outer[:, ::-1].copy()
        inner[:, :, axis] = -1.0
        faces += [outer, inner]
    return np.concatenate(faces)


def scoop(length: int, width: int, height: int) -> NDArray[np.bool_]:
    """Solid cells of a box of these numbers of cells without its front and top; its walls are one cell thick."""
    solid = np.ones((length, width, height), dtype=bool)
    solid[:-1, 1:-1, 1:] = False
    return solid


def cells(solid: NDArray[np.bool_]) -> Points:
    """The surface of solid unit cells, two triangles for each face between a solid cell and an empty one."""
    faces = []
    padded = np.pad(solid, 1)
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        for side in (1, -1):
            open_cells = np.argwhere(padded & ~np.roll(padded, -side, axis=axis)) - 1.0
            quads = np.repeat(open_cells[:, None], 4, axis=1)
            quads[:, :, axis] += 0.5 * (1 + side)
            quads[:, [1, 2] if side > 0 else [3, 2], u] += 1.0
            quads[:, [2, 3] if side > 0 else [2, 1], v] += 1.0
            faces += [quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]
    return np.concatenate(faces)


def unit_sphere(nx: int, ny: int, nz: int) -> Points:
    """A cube blown up to a sphere, with equal angles between grid lines."""
    points = np.tan(np.pi / 4.0 * cuboid(nx, ny, nz))
    return np.asarray(points / np.linalg.norm(points, axis=2, keepdims=True))


def paraboloid(*, radius: float, length: float, around: int, along: int, across: int) -> Points:
    """A solid paraboloid of revolution, tip down: `along` rings of facets on its side, `across` on its base."""
    r = np.linspace(0.0, radius, 10_001)
    z = length * ((r / radius) ** 2 - 1.0)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(r), np.diff(z)))])
    side = np.interp(np.linspace(0.0, arc[-1], along + 1), arc, r)
    rings = np.concatenate([side, np.linspace(radius, 0.0, across + 1)[1:]])
    heights = np.concatenate([length * ((side / radius) ** 2 - 1.0), np.zeros(across)])
    angle = 2.0 * np.pi / around * (np.arange(around + 1) % around)
    p = np.stack(
        [
            np.outer(rings, np.cos(angle)),
            np.outer(rings, np.sin(angle)),
            np.outer(heights, np.ones(around + 1)),
        ],
        axis=2,
    )
    lower, upper = p[:-1], p[1:]
    towards_end = np.stack([lower[:, :-1], lower[:, 1:], upper[:, 1:]], axis=2)[1:]
    towards_tip = np.stack([lower[:, :-1], upper[:, 1:], upper[:, :-1]], axis=2)[:-1]
    return np.concatenate([towards_end.reshape(-1, 3, 3), towards_tip.reshape(-1, 3, 3)])


def stl(name: str, triangles: Points) -> bytes:
    """Binary STL. Digits below 1e-6 mm, where math libraries differ, are rounded away."""
    points = np.round(triangles, 6) + 0.0  # no negative zeros
    normals = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    facets = np.zeros(
        len(points), dtype=[("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("attribute", "<u2")]
    )
    facets["normal"] = np.round(normals, 6) + 0.0
    facets["points"] = points
    header = f"rft_ros {name}, mm".encode().ljust(80) + len(points).to_bytes(4, "little")
    return header + facets.tobytes()


if __name__ == "__main__":
    main()
