"""`rft view`: a tool on its way, as a page that needs nothing beside it."""

import re

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from test_cli import HEADER, ROOT, refused, rft

from rft_ros.cli import main
from rft_ros.parameters import Model
from rft_ros.report import DrawnMotion, animate, drawn_mesh
from rft_ros.rft import MEDIA, alpha_y_model, treers2021, wrenches
from rft_ros.tool import load_tool

STATES = (
    "\n".join(
        [HEADER, *(f"{k / 4},0,0,{-0.004 * k},0,0,0,1,0.002,0,-0.016,0,0,0" for k in range(12))]
    )
    + "\n"
)


def view(tmp_path, output, *options):
    (tmp_path / "states.csv").write_text(STATES)
    return rft(
        "view",
        "states.csv",
        "--mesh",
        "root_tip",
        "--zeta",
        "0.33",
        *options,
        "-o",
        output,
        cwd=tmp_path,
    )


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
    tool, law = (
        load_tool("ellipsoid"),
        treers2021(MEDIA["generic"], alpha_y_model("constant", MEDIA["generic"])),
    )
    state = np.array([[0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, -0.01, 0.0, 0.0, 0.0]])
    forces = wrenches(tool.plates, law, state)[:, :3]
    motion = DrawnMotion(np.zeros(1), state, forces)
    scene = animate("ellipsoid", Model(tool=tool, law=law), motion, surface_height=0.0)
    np.testing.assert_array_equal(scene.forces, forces)
    low = scene.positions[0][scene.faces].mean(axis=1)[:, 2]
    loaded = scene.traction[0] > 0.0
    assert loaded.any() == (height < 0.0)
    assert not loaded[low > 1e3 * height + 2.0].any()  # the upper half trails


def shell(outline, length, *, cells):
    """A closed solid [mm]: an outline in y and z, shape [n, 2], along x, its sides cut into about `cells` facets."""
    polygon = [[i, (i + 1) % len(outline)] for i in range(len(outline))]
    x = np.linspace(0.0, length, max(2, cells // (2 * len(outline)) + 1))
    points = np.concatenate([np.column_stack([np.full(len(outline), v), outline]) for v in x])
    faces = []
    for k in range(len(x) - 1):
        for i, j in polygon:
            a, b, c, d = k * len(outline) + np.array([i, j, len(outline) + j, len(outline) + i])
            faces += [[a, b, c], [a, c, d]]
    n = len(outline) // 2  # the outline goes there on one side and back on the other
    for k in range(n - 1):
        quad = [k, k + 1, len(outline) - 2 - k, len(outline) - 1 - k]
        end = [v + (len(x) - 1) * len(outline) for v in quad]
        faces += [[quad[0], quad[2], quad[1]], [quad[0], quad[3], quad[2]]]
        faces += [[end[0], end[1], end[2]], [end[0], end[2], end[3]]]
    mesh = trimesh.Trimesh(points, faces, process=False)
    trimesh.repair.fix_normals(mesh)
    return mesh


@st.composite
def tools(draw):
    """Thin blades and scoops, coarse and fine; the tool's lowest point lies at z = 0 [mm]."""
    width, thickness = draw(st.floats(20.0, 120.0)), draw(st.floats(0.3, 4.0))
    bend = draw(st.one_of(st.just(0.0), st.floats(0.5, 3.0)))  # rad of the blade's arc; 0: flat
    points, cells = draw(st.integers(2, 40)), draw(st.sampled_from([50, 2000, 12_000]))
    angle = np.linspace(-0.5, 0.5, points) * bend
    radius = width / bend if bend else 0.0
    middle = np.column_stack([radius * np.sin(angle), radius * np.cos(angle)]) if bend else None
    if middle is None:
        middle = np.column_stack([np.zeros(points), np.linspace(0.0, width, points)])
        across = np.tile([1.0, 0.0], (points, 1))
    else:
        across = np.column_stack([np.sin(angle), np.cos(angle)])
    outline = np.concatenate(
        [middle - 0.5 * thickness * across, (middle + 0.5 * thickness * across)[::-1]]
    )
    mesh = shell(outline, draw(st.floats(20.0, 120.0)), cells=cells)
    mesh.apply_transform(
        trimesh.transformations.rotation_matrix(draw(st.floats(0.0, 3.1)), [1.0, 0.3, 0.0])
    )
    mesh.apply_translation([0.0, 0.0, -mesh.bounds[0, 2]])
    return mesh


@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    tools(),
    st.floats(-1.0, 1.0),
    st.sampled_from([None, 0.0, 0.003]),
    st.sampled_from([None, 0.05]),
)
def test_a_page_says_the_forces_of_the_table(tmp_path, mesh, sideways, length, tolerance):
    mesh.export(tmp_path / "tool.stl")
    rows = np.zeros((80, 14))
    rows[:, 0] = 0.1 * np.arange(80)
    rows[:, 1], rows[:, 3], rows[:, 7] = 0.01 * sideways * rows[:, 0], -0.01 * rows[:, 0], 1.0
    rows[:, 8], rows[:, 10] = 0.01 * sideways, -0.01
    np.savetxt(
        tmp_path / "states.csv", rows, delimiter=",", header=HEADER, comments="", fmt="%.17g"
    )
    same = ["--mesh", str(tmp_path / "tool.stl")]
    same += [] if length is None else ["--mobilization-length", str(length)]
    same += [] if tolerance is None else ["--tolerance", str(tolerance)]
    _page_says_the_table(tmp_path, same)


def _page_says_the_table(folder, same):
    """With these options ``rft view`` says of states.csv the forces that ``rft predict`` writes."""
    for command, output in (("predict", "out.csv"), ("view", "out.html")):
        assert main([command, str(folder / "states.csv"), *same, "-o", str(folder / output)]) == 0
    table = np.loadtxt(folder / "out.csv", delimiter=",", skiprows=1)
    sizes = {f"{t:.2f}": f"{np.linalg.norm(f):.2f}" for t, *f in table[:, :4]}
    said = dict(
        re.findall(r"t = ([0-9.]+) s   \|F\| = ([0-9.]+) N", (folder / "out.html").read_text())
    )
    assert len(said) >= 3
    assert said == {time: sizes[time] for time in said}
    assert max(map(float, said.values())) == max(map(float, sizes.values()))


@pytest.mark.parametrize(
    "memory", [[], ["--mobilization-length", "0.003"]], ids=["default", "memory"]
)
def test_a_page_has_memory_only_where_the_table_has(tmp_path, memory):
    """A plate pressed 20 mm deep and raised by 1 mm: with memory the force falls, without it turns round."""
    height = np.append(np.linspace(0.0, -0.02, 41), np.linspace(-0.0195, -0.019, 2))
    rows = np.zeros((len(height), 14))
    rows[:, 0], rows[:, 3], rows[:, 7] = 0.1 * np.arange(len(height)), height, 1.0
    rows[:, 10] = np.gradient(height, 0.1)
    np.savetxt(
        tmp_path / "states.csv", rows, delimiter=",", header=HEADER, comments="", fmt="%.17g"
    )
    _page_says_the_table(tmp_path, ["--mesh", "plate", *memory])


@settings(
    max_examples=12, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(tools(), st.sampled_from([100, 1000, 10_000]))
def test_the_drawn_mesh_keeps_extent_and_area_and_shows_the_tractions_of_the_tool(
    tmp_path, mesh, most
):
    mesh.export(tmp_path / "tool.stl")
    tool = load_tool(str(tmp_path / "tool.stl"))
    drawn = drawn_mesh(tool, most_faces=most)
    full, shown = (
        trimesh.Trimesh(*parts, process=False)
        for parts in ((tool.vertices, tool.faces), (drawn.vertices, drawn.faces))
    )
    np.testing.assert_allclose(shown.bounds, full.bounds, atol=0.01 * full.extents.max())
    assert shown.area == pytest.approx(full.area, rel=0.05)
    assert drawn.facet.shape == (len(drawn.faces),)
    turned = (shown.face_normals * full.face_normals[drawn.facet]).sum(axis=1)
    assert np.average(turned, weights=shown.area_faces) > 0.9


def test_a_smooth_fine_mesh_is_simplified(tmp_path):
    trimesh.creation.icosphere(subdivisions=5, radius=20.0).export(tmp_path / "ball.stl")
    ball = load_tool(str(tmp_path / "ball.stl"))
    assert len(ball.faces) == 20_480
    assert len(drawn_mesh(ball).faces) <= 5000
    assert len(drawn_mesh(ball, most_faces=20_480).faces) == 20_480
