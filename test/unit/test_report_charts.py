"""The charts of a replay as numbers: bands, quality flags, shaded phases, and decimation of long recordings."""

import math

import numpy as np
import pytest

from rft_ros.bags.estimates import Trace
from rft_ros.bags.phases import Phase
from rft_ros.bags.replay_report import decimated
from rft_ros.estimator import Estimate, Measurement
from rft_ros.report.page import chart_figure
from rft_ros.report.replay_charts import FlaggedRows, ReplaySeries, replay_charts


def series(quality_flags=(), learned=math.nan):
    """Ten poses, one a second: two in the air, six on the way down, two without estimate."""
    time = np.arange(10.0)
    predicted = np.zeros((10, 6))
    predicted[2:8, 2] = np.arange(1.0, 7.0)
    predicted[8:] = math.nan
    return ReplaySeries(
        time=time,
        depth=0.001 * (time - 2.0),
        phase=np.array([0, 0, 1, 1, 1, 1, 1, 1, -1, -1]),
        phases=("approach", "penetration"),
        measured=predicted + 0.1,
        predicted=predicted,
        deviation=0.15 * np.abs(predicted) + 0.1,
        quality_flags=tuple(quality_flags),
        vertical=("z", "up"),
        learned=np.broadcast_to(learned, (10, 9)),
    )


def test_the_band_is_the_deviation_to_each_side_of_every_component():
    force = replay_charts(series())[0]
    for row, middle in zip(force.panels, (0.0, 0.0, 4.0), strict=True):
        (band,) = (line for line in row[0].lines if line.kind == "band")
        assert band.y[:, 5].tolist() == pytest.approx([0.85 * middle - 0.1, 1.15 * middle + 0.1])
        assert np.isnan(band.y[:, 8:]).all()


def test_a_band_is_closed_around_each_segment_and_open_between():
    figure = chart_figure(replay_charts(series())[0])
    band = next(trace for trace in figure.data if trace.fill == "toself")
    x = np.asarray(band.x)
    assert x[: 2 * 8].tolist() == [*range(8), *range(7, -1, -1)]
    assert np.isnan(x[16])


def test_phases_are_shaded_up_to_the_next_one():
    spans = replay_charts(series())[0].spans
    assert [(s.name, s.begin, s.end) for s in spans] == [("approach", 0.0, 2.0), ("penetration", 2.0, 8.0)]
    shapes = chart_figure(replay_charts(series())[0]).layout.shapes
    assert [(s.x0, s.x1, s.yref) for s in shapes[:2]] == [(0.0, 2.0, "y domain"), (2.0, 8.0, "y domain")]
    assert len(shapes) == 2 * 3


def test_each_quality_flag_is_a_bar_while_it_lasts_below_the_forces_only():
    rows = np.zeros(10, dtype=bool)
    rows[[3, 4, 6]] = True
    charts = replay_charts(series([FlaggedRows(name="wake", trust="CAUTION", rows=rows)]))
    panel = charts[0].panels[3][0]
    (bar,) = panel.lines
    assert panel.names == ("wake",)
    np.testing.assert_array_equal(bar.x, [3.0, 5.0, math.nan, 6.0, 7.0, math.nan])
    assert set(bar.y) == {0.0}
    assert len(charts[1].panels) == len(replay_charts(series())[0].panels) == 3


def test_what_is_learned_is_drawn_over_time_and_over_depth_on_the_way_in():
    assert [c.name for c in replay_charts(series())] == [c.name for c in replay_charts(series()) if c.name != "learned"]
    learned = np.tile([1.3, 0.6, math.radians(5.0), 0.002, 0.1, 0.2, math.radians(1.0), 0.001, 4.0], (10, 1))
    chart = next(c for c in replay_charts(series(learned=learned)) if c.name == "learned")
    for row, expected in zip(chart.panels, ([1.3, 0.6], [5.0], [2.0], [4.0]), strict=True):
        for panel in row:
            assert [line.y[0] for line in panel.lines if line.kind == "line"] == pytest.approx(expected)
    turn, over_depth = (panel.lines[0] for panel in chart.panels[1])
    np.testing.assert_allclose(turn.y[:, 4], [4.0, 6.0])
    np.testing.assert_array_equal(over_depth.x, [math.nan] * 3 + [1.0, 2.0, 3.0, 4.0, 5.0] + [math.nan] * 2)


def test_decimation_keeps_the_deepest_and_the_greatest_of_every_segment(tmp_path):
    random = np.random.default_rng(5)
    with Trace(tmp_path) as trace:
        for k in range(30_000):
            depth, force = float(random.normal()), float(random.normal())
            answer = Estimate(k, (0.0,) * 6, (0.1,) * 6, 0.1, 0.0, 0, 0)
            measured = Measurement(k, (0.0, 0.0, force, 0.0, 0.0, 0.0), None, None)
            trace.add(depth, answer, measured, Phase.PENETRATION, np.zeros(13).tobytes())
        every = np.concatenate(list(trace.blocks()))
        rows = decimated(trace)
    assert 3000 < len(rows) < 6001
    assert (np.diff(rows["stamp"]) > 0).all()
    assert rows["depth"].max() == every["depth"].max()
    assert np.abs(rows["compensated"]).max() == np.abs(every["compensated"]).max()
