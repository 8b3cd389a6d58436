"""The charts of a replay as numbers: bands, quality flags, shaded phases, and decimation of long recordings."""

import math

import numpy as np
import pytest

from rft_ros.bags.estimates import ROW
from rft_ros.bags.phases import PHASES, Phase
from rft_ros.bags.replay_report import decimated, replay_charts
from rft_ros.estimator.quality import QualityFlag


def rows(flag=0, flagged=(), learned=math.nan):
    """Ten poses, one a second: two in the air, six on the way down, two without estimate."""
    found = np.zeros(10, ROW)
    time = np.arange(10)
    found["stamp"] = 1_000_000_000 * (5 + time)
    found["depth"] = 0.001 * (time - 2.0)
    found["phase"][:2], found["phase"][2:8] = (PHASES.index(p) for p in (Phase.APPROACH, Phase.PENETRATION))
    found["phase"][8:] = -1
    found["predicted"][2:8, 2] = np.arange(1.0, 7.0)
    found["predicted"][8:] = math.nan
    found["compensated"] = found["predicted"] + 0.1
    found["sigma"] = 0.15 * np.abs(found["predicted"]) + 0.1
    found["quality_flags"][list(flagged)] = int(flag)
    found["learned"] = learned
    return found


def chart(name, *arguments, **options):
    return {c.name: c.drawn for c in replay_charts(rows(*arguments, **options), "z points up")}[name]


def traces(figure, axis, **wanted):
    return [t for t in figure.data if t.yaxis == axis and all(getattr(t, k) == v for k, v in wanted.items())]


def test_the_band_is_closed_around_the_deviation_to_each_side_of_every_component():
    figure = chart("force_over_time")
    for axis, middle in (("y", 0.0), ("y2", 0.0), ("y3", 4.0)):
        (band,) = traces(figure, axis, fill="toself")
        assert band.x[: 2 * 8].tolist() == [*range(8), *range(7, -1, -1)]
        assert band.y[[5, 10]].tolist() == pytest.approx([0.85 * middle - 0.1, 1.15 * middle + 0.1])
        assert np.isnan(band.x[16:]).all()


def test_phases_are_shaded_up_to_the_next_one():
    shapes = chart("force_over_time").layout.shapes
    assert [(s.x0, s.x1, s.yref) for s in shapes[:2]] == [(0.0, 2.0, "y domain"), (2.0, 8.0, "y domain")]
    assert len(shapes) == 2 * 3


def test_each_quality_flag_is_a_bar_while_it_lasts_below_the_forces_only():
    figure = chart("force_over_time", QualityFlag.WAKE, [3, 4, 6])
    (bar,) = traces(figure, "y4")
    assert figure.layout.yaxis4.ticktext == ("wake",)
    np.testing.assert_array_equal(bar.x, [3.0, 5.0, math.nan, 6.0, 7.0, math.nan])
    assert set(bar.y) == {0.0}
    assert not traces(chart("torque_over_time", QualityFlag.WAKE, [3]), "y4")


def test_what_is_learned_is_drawn_over_time_and_over_depth_on_the_way_in():
    assert "learned" not in [c.name for c in replay_charts(rows(), "z points up")]
    figure = chart("learned", learned=[1.3, 0.6, math.radians(5.0), 0.002, 0.1, 0.2, math.radians(1.0), 0.001, 4.0])
    for row, expected in enumerate(([1.3, 0.6], [5.0], [2.0], [4.0])):
        for axis in ("y" if row == 0 else f"y{2 * row + 1}", f"y{2 * row + 2}"):
            assert [line.y[3] for line in traces(figure, axis, fill=None)] == pytest.approx(expected)
    (turn,), (over_depth,) = traces(figure, "y3", fill="toself"), traces(figure, "y4", fill=None)
    assert turn.y[[4, 15]].tolist() == pytest.approx([4.0, 6.0])
    np.testing.assert_array_equal(over_depth.x, [math.nan] * 3 + [1.0, 2.0, 3.0, 4.0, 5.0] + [math.nan] * 2)


def test_decimation_keeps_the_deepest_and_the_greatest_of_every_segment():
    random = np.random.default_rng(5)
    every = np.zeros(30_000, ROW)
    every["stamp"], every["depth"] = np.arange(30_000), random.normal(size=30_000)
    every["compensated"][:, 2] = random.normal(size=30_000)
    found = decimated(every)
    assert 3000 < len(found) < 6001
    assert (np.diff(found["stamp"]) > 0).all()
    assert found["depth"].max() == every["depth"].max()
    assert np.abs(found["compensated"]).max() == np.abs(every["compensated"]).max()
