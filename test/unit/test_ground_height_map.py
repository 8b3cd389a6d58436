"""The height map: cells from points, files in and out."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from rft_ros.errors import InputError
from rft_ros.ground import MOST_CELLS, HeightMap, ToolBox, read_height_map, write_height_map

CELL = 0.002


def bed(height, n=20):
    """Points at the centres of n x n cells around the origin; `height`: function of x and y."""
    axis = CELL * (np.arange(-n // 2, n // 2) + 0.5)
    x, y = (v.ravel() for v in np.meshgrid(axis, axis, indexing="ij"))
    return x, y, height(x, y)


def box(half=0.01):
    corner = np.full(3, half)
    return ToolBox(position=np.zeros(3), rotation=np.eye(3), low=-corner, high=corner)


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
    ground = HeightMap.unknown(CELL).with_points(x, y, z, box())
    known = ground.points()
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
    assert ground.heights.size <= MOST_CELLS


def test_some_of_many_points_are_spread_over_the_map():
    ground = HeightMap.unknown(CELL).with_points(*bed(lambda x, _: x))
    some, every = ground.points(at_most=50), ground.points(at_most=400)
    assert 20 < len(some) <= 51
    assert {tuple(p) for p in some} <= {tuple(p) for p in every}
    assert np.ptp(some[:, 0]) > 0.8 * np.ptp(every[:, 0])
    assert len(every) == 400


def test_a_map_from_another_process_cannot_be_changed_either():
    assert not pickle.loads(pickle.dumps(HeightMap.unknown(CELL))).heights.flags.writeable


def test_no_points_change_nothing():
    ground = HeightMap.unknown(CELL)
    assert ground.with_points(*np.empty((3, 0))) is ground
    assert len(ground.points(at_most=50)) == 0


@pytest.mark.parametrize("suffix", [".csv", ".npz"])
def test_a_file_gives_the_map_that_was_written(tmp_path, suffix):
    ground = HeightMap.unknown(CELL).with_points(*bed(lambda x, y: 0.2 * x - 0.1 * y))
    file = tmp_path / f"ground{suffix}"
    write_height_map(file, ground)
    again = read_height_map(file, CELL)
    assert again.corner == ground.corner
    assert_array_equal(again.heights, ground.heights)


@given(
    cell=st.sampled_from([0.001, 0.002, 0.0025, 0.003, 0.01]),
    begin=st.tuples(st.integers(-500, 500), st.integers(-500, 500)),
    offset=st.floats(0.0, 1.0),
)
def test_heights_on_a_grid_as_wide_as_the_cells_stay_where_they_are(tmp_path_factory, cell, begin, offset):
    """Also at multiples of the cell's side, where rounding puts x / cell on either side of a whole number."""
    x, y = (v.ravel() for v in np.meshgrid(*(cell * (np.arange(12) + b + offset) for b in begin), indexing="ij"))
    h = 0.3 * x - 0.2 * y
    file = tmp_path_factory.mktemp("grid") / "ground.csv"
    np.savetxt(
        file, np.column_stack([x, y, h]), fmt="%.9g", delimiter=",", header="x,y,h", comments="", encoding="utf-8-sig"
    )
    ground = read_height_map(file, cell)
    assert_allclose(ground.points(), np.column_stack([x, y, h]), rtol=1e-6, atol=2e-6 * cell)
    assert_allclose(ground.heights_at(x, y), h, rtol=1e-6, atol=1e-9)
    seen = ground.with_points(x[:12], y[:12], h[:12] + 0.1 * cell, box(cell / 1e3))
    assert len(seen.points()) == 144


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("", "no column x"),
        ("x,y,h\n", "at least one"),
        ("x,y,h\n1,2\n", "line 2 is not 3 numbers"),
        ("x,y,h\n1,2,nan\n", "not finite"),
        ("x,y,h\n0,0,0\n1e3,1e3,0\n", "must fit in"),
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
