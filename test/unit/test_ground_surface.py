"""The height map, its files, and the surface that resists a tool: a plane over the ground ahead of it."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from rft_ros.errors import InputError
from rft_ros.ground import (
    LAST_SURFACE,
    MAX_CELL_COUNT,
    HeightMap,
    Support,
    read_height_map,
    write_height_map,
)
from rft_ros.tool import load_tool

CELL = 0.002
SUPPORT = Support(load_tool("plate", integration="refined").corners)


def bed(height, n=20):
    """Points at the centres of n x n cells around the origin; `height`: function of x and y."""
    axis = CELL * (np.arange(-n // 2, n // 2) + 0.5)
    x, y = (v.ravel() for v in np.meshgrid(axis, axis, indexing="ij"))
    return x, y, height(x, y)


def mapped(height, n=150):
    return HeightMap.unknown(CELL).with_points(*bed(height, n))


def box(half=0.01):
    return np.zeros(3), np.eye(3), np.array([[-half] * 3, [half] * 3])


@given(st.permutations(list(range(400))))
def test_the_order_of_points_changes_nothing(order):
    x, y, z = bed(lambda x, y: 0.3 * x + 0.01 * np.sin(300.0 * y))
    a = HeightMap.unknown(CELL).with_points(x, y, z)
    b = HeightMap.unknown(CELL).with_points(x[order], y[order], z[order])
    assert a.corner == b.corner
    assert_array_equal(a.heights, b.heights)


@given(z=st.lists(st.floats(-1.0, 1.0, width=32), min_size=1, max_size=200))
def test_a_cell_takes_the_median_of_its_points(z):
    x = np.full(len(z), 0.0005)
    ground = HeightMap.unknown(CELL).with_points(x, x, np.array(z))
    assert_allclose(ground.points(), [[0.001, 0.001, np.median(z)]], atol=1e-7)


def test_points_that_are_not_finite_and_cells_that_stand_out_are_left_out():
    x, y, z = bed(lambda x, _: 0.0 * x)
    z[7], x[30], y[50] = np.nan, np.inf, -np.inf
    z[200] = 0.05
    ground = HeightMap.unknown(CELL).with_points(x, y, z)
    assert len(ground.points()) == 400 - 4
    assert_array_equal(ground.points()[:, 2], 0.0)


def test_the_tools_own_points_are_left_out():
    x, y, z = bed(lambda x, _: 0.0 * x, n=40)
    known = HeightMap.unknown(CELL).with_points(x, y, z, box()).points()
    assert (np.abs(known[:, :2]).max(axis=1) > 0.01 + 2 * CELL).all()
    assert len(known) > 0.7 * len(x)


def test_cells_that_a_cloud_does_not_see_keep_their_heights():
    x, y, z = bed(lambda x, _: 0.0 * x)
    before = HeightMap.unknown(CELL).with_points(x, y, z)
    after = before.with_points(x[:200], y[:200], z[:200] + 0.001)
    assert_allclose(np.sort(after.points()[:, 2]), np.repeat([0.0, 0.001], 200), atol=1e-9)
    assert_array_equal(before.points()[:, 2], 0.0)


def test_the_map_is_bounded_whatever_the_points():
    rng = np.random.default_rng(1)
    ground = HeightMap.unknown(CELL)
    for k in range(20):
        x, y = rng.uniform(-50.0, 50.0, size=(2, 1000))
        ground = ground.with_points(x + 10.0 * k, y, 0.0 * x)
    assert ground.heights.size <= MAX_CELL_COUNT


def test_some_of_many_points_are_spread_over_the_map():
    ground = mapped(lambda x, _: x, 20)
    some, every = ground.points(at_most=50), ground.points(at_most=400)
    assert 20 < len(some) <= 51
    assert {tuple(p) for p in some} <= {tuple(p) for p in every}
    assert np.ptp(some[:, 0]) > 0.8 * np.ptp(every[:, 0])
    assert len(every) == 400


def test_no_points_change_nothing():
    ground = HeightMap.unknown(CELL)
    assert ground.with_points(*np.empty((3, 0))) is ground
    assert len(ground.points(at_most=50)) == 0


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"cell": np.nan}, "cell is nan"),
        ({"corner": (0.0, 1e300)}, "corner is"),
        ({"heights": np.zeros(4)}, "heights has shape"),
        *(
            ({"heights": [[0.0, high]]}, "heights has values beyond 1e")
            for high in (np.inf, -np.inf, -1e300)
        ),
    ],
)
def test_a_map_that_cannot_be_one_is_refused(change, sentence):
    given = {"cell": CELL, "corner": (0.0, 0.0), "heights": np.zeros((2, 2))}
    assert HeightMap(**given).heights.dtype == np.float32
    with pytest.raises(ValueError, match=sentence):
        HeightMap(**{**given, **change})


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_a_file_gives_the_map_that_was_written(tmp_path, suffix):
    ground = mapped(lambda x, y: 0.2 * x - 0.1 * y, 20)
    file = tmp_path / f"ground{suffix}"
    write_height_map(file, ground)
    again = read_height_map(str(file), CELL)
    assert again.corner == ground.corner
    assert_array_equal(again.heights, ground.heights)


@given(
    cell=st.sampled_from([0.001, 0.002, 0.0025, 0.003, 0.01]),
    begin=st.tuples(st.integers(-500, 500), st.integers(-500, 500)),
    offset=st.floats(0.0, 1.0),
)
def test_heights_on_a_grid_as_wide_as_the_cells_stay_where_they_are(
    tmp_path_factory, cell, begin, offset
):
    """Also at multiples of the cell's side, where rounding puts x / cell on either side of a whole number."""
    x, y = (
        v.ravel()
        for v in np.meshgrid(*(cell * (np.arange(12) + b + offset) for b in begin), indexing="ij")
    )
    h = 0.3 * x - 0.2 * y
    file = tmp_path_factory.mktemp("grid") / "ground.csv"
    points = np.column_stack([x, y, h])
    np.savetxt(
        file, points, fmt="%.9g", delimiter=",", header="x,y,h", comments="", encoding="utf-8-sig"
    )
    ground = read_height_map(file, cell)
    assert_allclose(ground.points(), points, rtol=1e-6, atol=2e-6 * cell)
    assert_allclose(ground.heights_at(x, y), h, rtol=1e-6, atol=1e-9)
    seen = ground.with_points(x[:12], y[:12], h[:12] + 0.1 * cell, box(cell / 1e3))
    assert len(seen.points()) == 144


@given(spacing=st.floats(0.5, 1.5) | st.floats(4.0, 40.0), seed=st.integers(0, 9))
def test_a_map_sparser_than_its_cells_says_so_with_a_cell_that_fits(
    tmp_path_factory, spacing, seed
):
    places = np.stack(np.meshgrid(*[np.arange(20.0)] * 2), axis=-1).reshape(-1, 2)
    places += np.random.default_rng(seed).uniform(-0.1, 0.1, places.shape)
    file = tmp_path_factory.mktemp("bed") / "bed.csv"
    rows = np.column_stack([spacing * CELL * places, np.zeros(len(places))])
    np.savetxt(file, rows, delimiter=",", header="x,y,h", comments="")
    issue = read_height_map(file, CELL).issue
    assert bool(issue) is (spacing >= 4.0)
    if issue:
        better = float(issue.rpartition(" ")[2])
        assert read_height_map(file, better).issue == ""


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "is empty"),
        ("\n", "no column x"),
        ("x,y,h\n", "at least one"),
        ("x,y,h\n1,2\n", "line 2 is not 3 numbers"),
        ("x,y,h\n1,2,nan\n", "not finite"),
        ("x,y,h\n0,0,0\n1e3,1e3,0\n", "the limit is 2,097,152"),
        ("x,y,h\n0.0018,0.001,0\n0.0038,3000.001,0\n", "2 x 1500001 cells"),
        ("x,y,h\n0,0,1e7\n", "not below 200000 m"),
    ],
)
def test_a_bad_file_is_refused_with_a_sentence(tmp_path, text, sentence):
    file = tmp_path / "ground.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=sentence) as error:
        read_height_map(file, CELL)
    assert str(file) in str(error.value)


def state(velocity, z=-0.01, x=0.0):
    return np.array([x, 0.0, z, 0.0, 0.0, 0.0, 1.0, *velocity, 0.0, 0.0, 0.0])


DOWN, FORWARD = (0.0, 0.0, -0.01), (0.01, 0.0, 0.0)


@pytest.mark.parametrize("velocity", [DOWN, FORWARD, (0.0, 0.0, 0.0)])
def test_unknown_ground_is_the_level_plane_exactly(velocity):
    surface = SUPPORT.local_surface(HeightMap.unknown(CELL), state(velocity), default_height=0.12)
    assert surface[:3] == (0.12, (0.0, 0.0), 0.0)


@given(sx=st.floats(-0.26, 0.26), sy=st.floats(-0.26, 0.26), h=st.floats(-0.01, 0.01))
def test_a_tilted_bed_under_a_sinking_tool_is_found_as_it_is(sx, sy, h):
    tilted = mapped(lambda x, y: h + sx * x + sy * y)
    surface = SUPPORT.local_surface(tilted, state(DOWN, z=h - 0.02), default_height=0.0)
    assert_allclose((surface.height, *surface.slope), (h, sx, sy), atol=1e-5)
    assert surface.roughness < 1e-5


def test_the_ground_ahead_resists_and_not_the_hole_behind():
    step = mapped(lambda x, _: np.where(x > 0.02, 0.0, -0.03))
    ways = (FORWARD, (-0.01, 0.0, 0.0))
    surfaces = (
        SUPPORT.local_surface(step, state(v, z=-0.02, x=0.03), default_height=0.0) for v in ways
    )
    ahead, back = (surface.height + surface.slope[0] * 0.03 for surface in surfaces)
    assert ahead > back + 0.005


def test_noise_at_rest_has_no_direction():
    """A tool that has moved by less than 0.1 mm keeps its surface; then it looks ahead again, and on another level."""
    slope, last = mapped(lambda x, _: 0.2 * x), np.zeros(1, LAST_SURFACE)
    first = SUPPORT.local_surface(slope, state(FORWARD), default_height=0.0, last=last)
    for k, back in enumerate(([-1e-6, 0.0, 0.0], [0.0, 1e-6, -1e-6])):
        noisy = SUPPORT.local_surface(
            slope, state(back, x=5e-5 * k, z=-0.01 - 2e-5 * k), default_height=0.0, last=last
        )
        assert noisy[:3] == first[:3]
        assert noisy.depth == pytest.approx(first.depth + (2e-5 + 0.2 * 5e-5) * k, abs=1e-9)
    for x, level in ((0.0, 0.1), (2e-4, 0.1)):
        moved = state((-0.01, 0.0, 0.0), x=x)
        again = SUPPORT.local_surface(slope, moved, default_height=level, last=last)
        assert again == SUPPORT.local_surface(slope, moved, default_height=level)
        assert again.height < first.height - 0.002


def test_a_tool_on_a_pile_is_below_its_surface():
    pile = mapped(lambda x, y: np.maximum(0.03 - np.hypot(x, y) * 0.4, 0.0))
    assert SUPPORT.local_surface(pile, state(DOWN, z=0.01), default_height=0.0).depth > 0.0
    assert SUPPORT.local_surface(pile, state(DOWN, z=0.06), default_height=0.0).depth < 0.0
    tiny = Support(load_tool("plate", scale=1e-8).corners)
    assert tiny.local_surface(pile, state(DOWN, z=0.0), default_height=0.0).depth > 0.02


@given(turn=st.floats(0.0, 6.3))
def test_turning_the_scene_turns_the_plane(turn):
    surfaces = []
    for angle in (0.0, turn):
        a, b = np.cos(angle), np.sin(angle)
        ground = mapped(lambda x, y, a=a, b=b: 0.01 * np.tanh(60.0 * (a * x + b * y)), 100)
        pose = 0.0, 0.0, -0.02, 0.0, 0.0, np.sin(angle / 2.0), np.cos(angle / 2.0)
        moved = np.array([*pose, 0.01 * a, 0.01 * b, 0.0, 0.0, 0.0, 0.0])
        surfaces.append(SUPPORT.local_surface(ground, moved, default_height=0.0))
    assert surfaces[0].height == pytest.approx(surfaces[1].height, abs=2e-4)
    assert np.hypot(*surfaces[0].slope) == pytest.approx(np.hypot(*surfaces[1].slope), abs=0.02)


def test_the_height_is_continuous_along_a_path():
    waves = mapped(lambda x, y: 0.008 * np.sin(100.0 * x) * np.cos(80.0 * y))
    step = 1e-5
    places = np.arange(0.0, 0.02, step)
    planes = [
        SUPPORT.local_surface(waves, state(FORWARD, z=-0.02, x=x), default_height=0.0)
        for x in places
    ]
    at_tool = [plane.height + plane.slope[0] * x for plane, x in zip(planes, places, strict=True)]
    assert np.abs(np.diff(at_tool)).max() < 2.0 * step


@given(
    st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), min_size=0, max_size=60),
    st.tuples(*(st.floats(-1e300, 1e300) for _ in range(6))),
)
def test_any_ground_and_any_state_give_numbers(values, numbers):
    n = len(values) // 3
    ground = HeightMap.unknown(CELL).with_points(*np.reshape(values[: 3 * n], (3, n)))
    moving = np.array([*numbers[:3], 0, 0, 0, 1.0, *numbers[3:], 0, 0, 0])
    surface = SUPPORT.local_surface(ground, moving, default_height=0.0)
    assert np.isfinite([surface.height, *surface.slope, surface.roughness]).all()
