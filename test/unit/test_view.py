"""`rft view`: a tool on its way, as a page that needs nothing beside it."""

import re

import numpy as np
import pytest
from test_cli import HEADER, ROOT, refused, rft

from rft_ros.report.animation import animate
from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from rft_ros.tool import load_tool

STATES = "\n".join([HEADER, *(f"{k / 4},0,0,{-0.004 * k},0,0,0,1,0.002,0,-0.016,0,0,0" for k in range(12))]) + "\n"


def view(tmp_path, output, *options):
    (tmp_path / "states.csv").write_text(STATES)
    return rft("view", "states.csv", "--mesh", "root_tip", "--zeta", "0.33", *options, "-o", output, cwd=tmp_path)


def test_the_page_is_self_contained_and_has_the_same_bytes_each_time(tmp_path):
    for name in ("one.html", "two.html"):
        done = view(tmp_path, name)
        assert done.returncode == 0, done.stderr
    page = (tmp_path / "one.html").read_text()
    assert page == (tmp_path / "two.html").read_text()
    assert "12 moments of root_tip" in done.stdout
    assert not re.search(r"<(script|link|img)[^>]+(src|href)=.https?:", page)
    assert "Traction [kPa]" in page
    assert "<title>root_tip</title>" in page
    assert "2.75" in page  # the last moment, at the slider


def test_what_cannot_be_drawn_is_a_sentence(tmp_path):
    refused(view(tmp_path, "film.gif"), "film.gif", ".html")
    refused(view(tmp_path, "o.html", "--start", "1"), "--start is for a bag, not for 'states.csv'")
    for arguments, *words in (
        (("states.csv",), "--mesh"),
        (("gone.csv", "--mesh", "plate"), "gone.csv"),
        ((tmp_path / "no_bag",), "no_bag"),
        ((tmp_path, "--zeta", "-5"), f"--zeta is for states, not for '{tmp_path}'"),
    ):
        refused(rft("view", *arguments, "-o", "o.html", cwd=tmp_path), *words)


def test_a_bag_is_drawn_from_its_estimates(shared_data, tmp_path):
    bag, config = shared_data / "abb_plate" / "abb_plate_3", ROOT / "config" / "abb_plate.yaml"
    done = rft("view", bag, "--params", config, "-o", "plate.html", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "60 moments of abb_plate" in done.stdout


@pytest.mark.parametrize("height", [-0.03, 0.03])
def test_the_force_is_that_of_the_plates_and_in_the_air_there_is_none(height):
    tool, law = load_tool("ellipsoid"), treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"]))
    state = np.array([[0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.01, 0.0, 0.0, 0.0]])
    scene = animate("ellipsoid", tool, law, np.zeros(1), state, surface_height=0.0)
    np.testing.assert_allclose(scene.forces, wrenches(tool.plates, law, state)[:, :3], rtol=0.01, atol=0.01)
    low = scene.placed[0][scene.faces].mean(axis=1)[:, 2]
    loaded = scene.traction[0] > 0.0
    assert loaded.any() == (height < 0.0)
    assert not loaded[low > 1e3 * height + 2.0].any()  # the upper half trails
