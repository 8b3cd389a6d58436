"""Statistics agree with numpy on the table; the report is one self-contained, reproducible file with every figure."""

import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from browser import show
from recordings import TOPICS, plunge, rows_of, values, write_ros2

from rft_ros.bags.estimates import PHASES, ROW
from rft_ros.bags.replay import replay
from rft_ros.bags.replay_report import decimated, replay_charts
from rft_ros.estimator import QualityFlag
from rft_ros.parameters import Config

CHARTS = ("wrench_over_time", "wrench_over_depth", "quality_flags", "learned", "tool")


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """Summary, rows and page of a plunge with noisy velocities, and the folders of its two replays."""
    folder = tmp_path_factory.mktemp("report")
    bag = write_ros2(folder / "plunge", plunge(noise=3e-5))
    outs = [folder / "one", folder / "two"]
    params = values(
        integration="centroid", learning__mode="observe", medium__mobilization_length=0.003
    )
    summary, _ = (replay(bag, out, params, report=True) for out in outs)
    page = (outs[0] / "report.html").read_text(encoding="utf-8")
    return SimpleNamespace(summary=summary, rows=rows_of(outs[0]), page=page, outs=outs)


def agrees(group, rows):
    rows = [row for row in rows if not row["reason"]]
    assert group.estimates == len(rows)
    if not rows:
        assert group.rms_over_peak is group.wrench["force"]["measured"]["peak"] is None
        return
    kinds = ("compensated", "residual")
    measured, residual = (
        np.array([[float(r[f"{kind}_f{a}"]) for a in "xyz"] for r in rows]) for kind in kinds
    )
    size, left = np.linalg.norm(measured, axis=1), np.linalg.norm(residual, axis=1)
    rms, big = np.sqrt(np.mean(left**2)), size > 0.2 * np.hypot(30.0, 0.05)
    median = np.median(left[big] / size[big]) if big.any() else None
    force = group.wrench["force"]
    assert (force["measured"]["peak"], force["residual"]["rms"]) == pytest.approx(
        (size.max(), rms), rel=1e-6
    )
    assert group.wrench["fz"]["residual"]["mean"] == pytest.approx(residual[:, 2].mean(), rel=1e-6)
    assert group.rms_over_peak == pytest.approx(rms / size.max(), rel=1e-6)
    assert group.median_relative_error == (
        median if median is None else pytest.approx(median, rel=1e-6)
    )


def test_the_statistics_of_a_phase_and_of_a_depth_bin_are_those_of_its_rows(replayed):
    summary, rows = replayed.summary, replayed.rows
    order = ["approach", "penetration", "dwell", "ploughing", "withdrawal"]
    assert list(dict.fromkeys(r["phase"] for r in rows)) == order
    agrees(summary, rows)
    for phase, group in summary.phases.items():
        chosen = [r for r in rows if r["phase"] == phase]
        assert group.poses == len(chosen) > 40
        agrees(group, chosen)
        for name, binned in group.depth_bins.items():
            low, high = (1e-3 * float(edge) for edge in name.removesuffix("mm").split("-"))
            agrees(binned, [r for r in chosen if low <= float(r["depth"]) < high])
    penetration = summary.phases["penetration"]
    assert list(penetration.depth_bins) == [f"{low}-{low + 5}mm" for low in range(0, 35, 5)]
    assert sum(g.estimates for g in penetration.depth_bins.values()) == penetration.estimates


def test_quality_flags_are_in_the_table_the_summary_and_the_page(replayed):
    summary, rows = replayed.summary, replayed.rows
    counted = {
        name: sum(name in r["quality_flags"].split("+") for r in rows)
        for name in summary.quality_flags
    }
    assert summary.quality_flags == counted
    assert sum(summary.trust.values()) == summary.estimates
    assert any(counted.values())
    assert all(not r["quality_flags"] for r in rows if r["reason"])
    assert summary.trust["OK"] == sum(not r["quality_flags"] and not r["reason"] for r in rows)
    assert summary.trust["NO"] == sum("inertial" in r["quality_flags"] for r in rows)
    in_grains = [r for r in rows if not r["reason"] and float(r["depth"]) > 0.0]
    assert summary.in_grains == len(in_grains) > 100
    for name, share in summary.flag_shares.items():
        flagged = sum(name in r["quality_flags"].split("+") for r in in_grains)
        assert share == pytest.approx(flagged / len(in_grains))
        assert (f"<td>{name}</td><td>{100.0 * share:.1f} %</td>" in replayed.page) == (flagged > 0)


def test_page_and_terminal_begin_with_the_verdict_and_leave_out_the_air(replayed):
    summary = replayed.summary
    error = f"median error {100.0 * summary.median_relative_error:.1f} % of the force"
    assert error in summary.lines()[0]
    assert summary.warnings[0] in summary.lines()[0]
    assert replayed.page.index(error) < replayed.page.index("<h2>")
    assert not any(line.strip().startswith("approach") for line in summary.lines())
    assert "<td>approach</td>" not in replayed.page


def test_the_page_has_figures_before_tables_and_changed_parameters_before_defaults(replayed):
    page = replayed.page
    assert page.index('<div id="figure-wrench_over_time"') < page.index("<h2>Metrics</h2>")
    table = page[page.index("<h2>Parameters</h2>") :]
    names = re.findall(r"<tr><td>([a-z_.]+)</td>", table)
    usual = Config().values
    changed = [
        not np.array_equal(replayed.summary.parameters[name], usual[name]) for name in names
    ]
    assert changed == sorted(changed, reverse=True)
    assert any(changed)
    assert len(names) == len(usual)


def test_the_page_has_every_figure_and_table_and_loads_nothing(replayed):
    page = replayed.page
    assert not re.search(r"<(script|link|img|iframe)[^>]+(src|href)=.(?!data:)", page)
    assert "@import" not in page.partition("</style>")[0]
    assert re.findall(r'<div id="figure-(\w+)"', page) == list(CHARTS)
    assert "both with memory. The colours show" in page
    assert len(page) < 6e6
    for title in ("Metrics", "Quality flags", "Not used or unanswered", "Parameters"):
        assert f"<h2>{title}</h2>" in page


def test_the_animation_has_the_time_of_the_charts(replayed):
    first = next(row for row in replayed.rows if not row["reason"] and float(row["depth"]) > 0.0)
    assert f"t = {float(first['t']) - float(replayed.rows[0]['t']):.2f} s" in replayed.page
    assert "t = 0.00 s" not in replayed.page


@pytest.mark.parametrize("mode", ["off", "apply"])
def test_the_scene_says_the_forces_of_the_table_also_with_memory_and_learning(tmp_path, mode):
    bag = write_ros2(tmp_path / "plunge", plunge(noise=3e-5))
    sensor = {"sensor__quaternion": (0.6, 0.0, 0.8, 0.0), "medium__zeta": 0.2}
    params = values(learning__mode=mode, medium__mobilization_length=0.003, **sensor)
    replay(bag, tmp_path / "out", params, report=True)
    rows, page = rows_of(tmp_path / "out"), (tmp_path / "out" / "report.html").read_text()
    predicted = {}
    for row in rows:
        if not row["reason"]:
            size = math.hypot(*(float(row[f"predicted_f{axis}"]) for axis in "xyz"))
            predicted.setdefault(f"{float(row['t']) - float(rows[0]['t']):.2f}", set()).add(
                f"{size:.2f}"
            )
    said = re.findall(r"t = ([0-9.]+) s   \|F\| = ([0-9.]+) N", page)
    assert len(said) > 60  # of the frames, and the title
    assert all(size in predicted[time] for time, size in said)
    assert ("learned corrections" in page.partition('id="figure-tool"')[0]) == (mode == "apply")


def test_two_replays_write_the_same_bytes(replayed):
    for name in (
        "report.html",
        "estimates.csv",
        "summary.json",
        "estimates/estimates.mcap",
        "estimates/metadata.yaml",
    ):
        one, two = (out / name for out in replayed.outs)
        assert one.read_bytes() == two.read_bytes(), name


def test_every_figure_is_drawn_in_a_browser_and_the_console_has_no_error(replayed, tmp_path):
    shown = show(replayed.outs[0] / "report.html", tmp_path)
    assert shown.errors == []
    for name in CHARTS:
        body = shown.document.partition(f'id="figure-{name}"')[2].partition("</section>")[0]
        assert 'class="main-svg"' in body, name
        assert ("<canvas" in body) if name == "tool" else ('class="lines"' in body), name
    assert (tmp_path / "screenshot.png").stat().st_size > 100_000


def test_without_flags_or_wrench_there_is_a_page_too(tmp_path):
    bag = write_ros2(
        tmp_path / "air", list(plunge())[:120], topics={r: TOPICS[r] for r in ("pose", "twist")}
    )
    summary = replay(bag, tmp_path / "out", values(), report=True)
    assert summary.estimates == summary.trust["OK"] == 40
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<td>none</td>" in page
    assert '"showSendToCloud": false' in page
    assert 'id="figure-tool"' not in page


def poses(flag=0, flagged=(), learned=(math.nan,) * 9):
    """Ten poses, one a second: two in the air, six on the way down, two without estimate."""
    found = np.zeros(10, ROW)
    time = np.arange(10)
    found["stamp"] = 1_000_000_000 * (5 + time)
    found["depth"] = 0.001 * (time - 2.0)
    found["phase"][:2], found["phase"][2:8] = (
        PHASES.index(p) for p in ("approach", "penetration")
    )
    found["phase"][8:] = -1
    found["predicted"][2:8, 2] = np.arange(1.0, 7.0)
    found["predicted"][8:] = math.nan
    found["residual"] = 0.1
    found["compensated"] = found["predicted"] + found["residual"]
    found["sigma"] = 0.15 * np.abs(found["predicted"]) + 0.1
    found["quality_flags"][list(flagged)] = int(flag)
    found["learned"] = learned
    return found


def chart(name, *arguments, **options):
    return {c.name: c.drawn for c in replay_charts(poses(*arguments, **options))}[name]


def traces(figure, axis, **wanted):
    return [
        t
        for t in figure.data
        if t.yaxis == axis and all(getattr(t, k) == v for k, v in wanted.items())
    ]


def test_the_band_is_closed_around_the_deviation_to_each_side_of_every_component():
    figure = chart("wrench_over_time")
    for axis, middle in (("y", 0.0), ("y3", 0.0), ("y5", 4.0)):
        (band,) = traces(figure, axis, fill="toself")
        assert band.x[: 2 * 8].tolist() == [*range(8), *range(7, -1, -1)]
        assert band.y[[5, 10]].tolist() == pytest.approx(
            [0.85 * middle - 0.1, 1.15 * middle + 0.1]
        )
        assert np.isnan(band.x[16:]).all()


def test_the_measured_line_has_a_name_and_colour_for_each_phase():
    for name, phases in (
        ("wrench_over_time", ["approach", "penetration"]),
        ("wrench_over_depth", ["penetration"]),
    ):
        found = {t.name: t for t in traces(chart(name), "y5", fill=None) if t.name != "predicted"}
        assert [*found] == [f"measured, {phase}" for phase in phases]
        assert len({t.line.color for t in found.values()}) == len(phases)
        line = found["measured, penetration"]
        assert line.y[2:8].tolist() == pytest.approx([1.1, 2.1, 3.1, 4.1, 5.1, 6.1])
        assert np.isnan(line.y[[0, 1, 8, 9]]).all()


def test_each_quality_flag_is_a_bar_while_it_lasts():
    assert "quality_flags" not in [c.name for c in replay_charts(poses())]
    figure = chart("quality_flags", QualityFlag.WITHDRAWAL, [3, 4, 6])
    (bar,) = figure.data
    assert figure.layout.yaxis.ticktext == ("withdrawal",)
    assert bar.x[bar.y == 0.0].tolist() == [3.0, 4.0, 5.0, 6.0, 7.0]  # up to the next pose
    assert np.isnan(bar.y[[0, 1, 2, 8, 9]]).all()


def test_what_is_learned_is_drawn_over_time_and_over_depth():
    assert "learned" not in [c.name for c in replay_charts(poses())]
    figure = chart(
        "learned",
        learned=(1.3, 0.6, math.radians(5.0), 0.002, 0.1, 0.2, math.radians(1.0), 0.001, 4.0),
    )
    for row, expected in enumerate(([1.3, 0.6], [5.0], [2.0], [4.0])):
        for axis in ("y" if row == 0 else f"y{2 * row + 1}", f"y{2 * row + 2}"):
            assert [line.y[3] for line in traces(figure, axis, fill=None)] == pytest.approx(
                expected
            )
    (turn,), (over_depth,) = traces(figure, "y3", fill="toself"), traces(figure, "y4", fill=None)
    assert turn.y[[4, 15]].tolist() == pytest.approx([4.0, 6.0])
    np.testing.assert_allclose(over_depth.x, [math.nan] * 2 + [*range(8)], atol=1e-6)


def test_no_title_of_an_axis_is_longer_than_its_panel():
    for figure in replay_charts(poses(QualityFlag.WITHDRAWAL, [3, 4], learned=(0.5,) * 9)):
        layout = figure.drawn.layout
        room = layout.height - layout.margin.t - layout.margin.b
        for axis in figure.drawn.select_yaxes():
            low, high = axis.domain
            longest = max(map(len, (axis.title.text or "").split("<br>")))
            # px; a letter is 7 wide at this size
            assert 7.0 * longest <= (high - low) * room, axis.title.text


def test_decimation_keeps_the_deepest_and_the_greatest_of_every_segment():
    random = np.random.default_rng(5)
    every = np.zeros(30_000, ROW)
    every["stamp"], every["depth"] = np.arange(30_000), random.normal(size=30_000)
    every["compensated"][:, 2] = random.normal(size=30_000)
    every["residual"] = every["compensated"]
    found = decimated(every)
    assert 1000 < len(found) < 2001
    assert (np.diff(found["stamp"]) > 0).all()
    assert found["depth"].max() == every["depth"].max()
    assert np.abs(found["compensated"]).max() == np.abs(every["compensated"]).max()


def test_a_recording_that_begins_in_the_grains_and_one_in_millimetres_have_a_warning(tmp_path):
    bag = write_ros2(tmp_path / "plunge", list(plunge())[:600])
    begins = replay(
        bag,
        tmp_path / "deep",
        values(surface_height=0.1, sensor__bias=(0.05, 0.0, 0.0, 0.0, 0.0, 0.0)),
    )
    assert any("mm deep in the grains" in w and "mesh.quaternion" in w for w in begins.warnings), (
        begins.warnings
    )
    millimetres = [
        (
            role,
            time,
            stamp,
            (*(1e3 * v for v in values[:3]), *values[3:]) if role == "pose" else values,
        )
        for role, time, stamp, values in plunge()
    ]
    summary = replay(write_ros2(tmp_path / "mm", millimetres), tmp_path / "out", values())
    assert any("millimetres" in w for w in summary.warnings), summary.warnings
    assert summary.trust["NO"] > 300
