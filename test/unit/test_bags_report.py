"""The report is one self-contained, reproducible file, and a browser draws every figure."""

import re
from html.parser import HTMLParser

import pytest
from browser import show
from recordings import TOPICS, plunge, write_ros2
from replays import rows_of, values

from rft_ros.bags.replay import replay

CHARTS = ("force_over_time", "torque_over_time", "force_over_depth", "torque_over_depth", "learned", "residual", "tool")


@pytest.fixture(scope="module")
def replays(tmp_path_factory):
    """Two replays of one bag, with report and figures: bag, summary, folders."""
    folder = tmp_path_factory.mktemp("report")
    bag = write_ros2(folder / "plunge", plunge(noise=3e-5))
    outs = [folder / "one", folder / "two"]
    params = values(integration="centroid", learning__mode="observe")
    summaries = [replay(bag, out, params, report=True) for out in outs]
    return summaries[0], outs


@pytest.fixture(scope="module")
def page(replays):
    return (replays[1][0] / "report.html").read_text(encoding="utf-8")


class References(HTMLParser):
    """What a page would load: sources, stylesheets, and the text of its styles."""

    def __init__(self, page):
        super().__init__()
        self.found, self.ids, self.styles, self._in_style = [], [], "", False
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self._in_style = tag == "style"
        self.ids.append(given.get("id"))
        self.found += [given[name] for name in ("src", "srcset", "data", "poster") if name in given]
        if tag != "a" and "href" in given:
            self.found.append(given["href"])

    def handle_endtag(self, _tag):
        self._in_style = False

    def handle_data(self, data):
        if self._in_style:
            self.styles += data


def test_the_page_loads_nothing(page):
    references = References(page)
    assert [r for r in references.found if not r.startswith("data:")] == []
    assert "url(" not in references.styles
    assert "@import" not in references.styles


def test_the_page_has_every_figure_and_table(page):
    assert [i for i in References(page).ids if i and i.startswith("figure-")] == [f"figure-{c}" for c in CHARTS]
    for title in ("Metrics", "Quality flags", "Read", "Not used or unanswered", "Parameters"):
        assert re.search(rf"<(h2|summary)>{title}</", page), title


@pytest.mark.parametrize("name", ["report.html", "estimates.csv", "summary.json"])
def test_two_replays_write_the_same_bytes(replays, name):
    one, two = (out / name for out in replays[1])
    assert one.read_bytes() == two.read_bytes()


def test_no_report_unless_asked_for(tmp_path):
    replay(write_ros2(tmp_path / "bag", plunge()), tmp_path / "out", values())
    assert not (tmp_path / "out" / "report.html").exists()


def test_every_figure_is_drawn_in_a_browser_and_the_console_has_no_error(replays, tmp_path):
    shown = show(replays[1][0] / "report.html", tmp_path)
    assert shown.errors == []
    for name in CHARTS:
        body = shown.document.partition(f'id="figure-{name}"')[2].partition("</section>")[0]
        assert 'class="main-svg"' in body, name
        assert ("<canvas" in body) if name == "tool" else ('class="lines"' in body), name
    assert (tmp_path / "screenshot.png").stat().st_size > 100_000


def test_a_page_that_fails_would_be_noticed(tmp_path):
    (tmp_path / "bad.html").write_text("<script>nothing.at.all()</script><img src='http://nowhere.invalid/x.png'>")
    assert len(show(tmp_path / "bad.html", tmp_path).errors) >= 2


def test_quality_flags_are_in_the_table_the_summary_and_the_page(replays, page):
    summary, (out, _) = replays
    rows = rows_of(out)
    counted = {name: sum(name in r["quality_flags"].split("+") for r in rows) for name in summary.quality_flags}
    assert summary.quality_flags == counted
    assert sum(summary.trust.values()) == summary.estimates
    assert any(counted.values())
    assert all(not r["quality_flags"] for r in rows if r["reason"])
    assert summary.trust["OK"] == sum(not r["quality_flags"] and not r["reason"] for r in rows)
    assert summary.trust["NO"] == sum("inertial" in r["quality_flags"] for r in rows)
    for name, count in counted.items():
        assert (f"<td>{name}</td><td>{count:,}</td>" in page) == (count > 0)


def test_without_flags_or_wrench_there_is_a_page_too(tmp_path):
    bag = write_ros2(tmp_path / "air", list(plunge())[:120], topics={r: TOPICS[r] for r in ("pose", "twist")})
    summary = replay(bag, tmp_path / "out", values(), report=True)
    assert summary.estimates == summary.trust["OK"] == 40
    page = (tmp_path / "out" / "report.html").read_text()
    assert "<td>none</td>" in page
    assert 'id="figure-tool"' not in page


def test_the_tools_title_says_that_it_leaves_out_memory(page, tmp_path):
    replay(
        write_ros2(tmp_path / "bag", plunge()), tmp_path / "out", values(medium__mobilization_length=0.003), report=True
    )
    said = "Tool and traction (law without memory)"
    assert said in (tmp_path / "out" / "report.html").read_text()
    assert said not in page
