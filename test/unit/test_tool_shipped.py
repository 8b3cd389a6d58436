"""The meshes that rft_ros ships: made by their script, with the papers' dimensions."""

import runpy
from math import asin, pi, sqrt
from pathlib import Path

import numpy as np
import pytest

from rft_ros.tool import describe_tool, load_tool

MESHES = Path(__file__).parents[2] / "meshes"
if not (MESHES / "generate.py").is_file():
    pytest.skip("runs in a source checkout only", allow_module_level=True)
GENERATE = runpy.run_path(str(MESHES / "generate.py"))


def box(x, y, z):
    return x * y * z, 2.0 * (x * y + y * z + z * x)


def spheroid(a, c):
    e = sqrt(1.0 - (a / c) ** 2)
    return 4 / 3 * pi * a**2 * c, 2.0 * pi * a**2 * (1.0 + c / (a * e) * asin(e))


def paraboloid(r, h):
    return pi / 2 * r**2 * h, pi * r / (6.0 * h**2) * (
        (r**2 + 4.0 * h**2) ** 1.5 - r**3
    ) + pi * r**2


# low and high corner [mm], facets, volume [mm³] and area [mm²]
EXPECTED = {
    "plate": ([-25.5, -25.5, -1.6], [25.5, 25.5, 1.6], 672, box(51.0, 51.0, 3.2)),
    "abb_plate": ([-21.32, -16.285, -3.0], [21.32, 16.285, 0.0], 392, box(42.64, 32.57, 3.0)),
    "ellipsoid": ([-9.5, -9.5, -18.0], [9.5, 9.5, 18.0], 2352, spheroid(9.5, 18.0)),
    "sphere": ([-25.0] * 3, [25.0] * 3, 1200, (4 / 3 * pi * 25**3, 4 * pi * 25**2)),
    "root_tip": ([-10.0, -10.0, -34.5], [10.0, 10.0, 0.0], 1232, paraboloid(10.0, 34.5)),
    # of 3 mm cells: a box less its hollow; its outside less the openings, and the hollow's inside
    "scoop": (
        [-33.0, -24.0, -27.0],
        [33.0, 24.0, 0.0],
        3448,
        (27.0 * (22 * 16 * 9 - 21 * 14 * 8), 9.0 * 1724),
    ),
}


def test_every_mesh_is_tested():
    assert EXPECTED.keys() == {p.stem for p in MESHES.glob("*.stl")} == GENERATE["meshes"]().keys()


@pytest.mark.parametrize("name", EXPECTED)
def test_each_shipped_mesh_is_what_its_script_makes_with_the_documented_size_and_even_facets(name):
    assert (
        GENERATE["stl"](name, GENERATE["meshes"]()[name]) == (MESHES / f"{name}.stl").read_bytes()
    )
    low, high, facets, (volume, area) = EXPECTED[name]
    tool = load_tool(str(MESHES / f"{name}.stl"))
    assert (tool.issues.keys(), len(tool.plates)) == (
        {"concave"} if name == "scoop" else set(),
        facets,
    )
    np.testing.assert_allclose(tool.vertices.min(axis=0), np.array(low) / 1e3, atol=1e-8)
    np.testing.assert_allclose(tool.vertices.max(axis=0), np.array(high) / 1e3, atol=1e-8)
    assert tool.plates.area == pytest.approx(area * 1e-6, rel=0.02)
    (line,) = (line for line in describe_tool(tool) if line.startswith("volume: "))
    stated = float(line.removeprefix("volume: ").removesuffix(" mm³"))
    assert stated == pytest.approx(volume, rel=0.02)
    x, y, _, _, _, _, area = tool.plates.rows[:7]
    corners = tool.vertices[tool.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    assert area.max() < 7.0 * area.min()
    assert (longest**2 < 12.0 * area).all()
    if name not in ("root_tip", "scoop"):
        assert (x @ area, y @ area) == pytest.approx((0.0, 0.0), abs=1e-14)
