"""Reading mesh files: every format, placed and scaled; and the sentence for each file that cannot be used."""

import re
import sys

import numpy as np
import pytest
import trimesh

from rft_ros.errors import InputError
from rft_ros.tool import mesh_file, read_mesh

SUFFIXES = ["stl", "obj", "ply", "glb", "dae"]
ORIGIN = (0.0, 0.0, 0.0)
TRIANGLES = trimesh.creation.icosphere(subdivisions=1, radius=20.0).triangles


def soup(triangles):
    return trimesh.Trimesh(np.reshape(triangles, (-1, 3)), np.arange(3 * len(triangles)).reshape(-1, 3), process=False)


def written(folder, triangles, suffix="stl", name="mesh", **options):
    path = folder / f"{name}.{suffix}"
    soup(triangles).export(path, **options)
    return path


def refused(path, *, scale=0.001, origin=ORIGIN):
    with pytest.raises(InputError) as caught:
        read_mesh(path, scale=scale, origin=origin)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_keeps_facets_order_and_winding(tmp_path, suffix):
    mesh = read_mesh(written(tmp_path, TRIANGLES, suffix), scale=1.0, origin=ORIGIN)
    np.testing.assert_allclose(mesh.triangles, TRIANGLES, atol=1e-5)


def test_an_ascii_stl_is_read(tmp_path):
    mesh = read_mesh(written(tmp_path, TRIANGLES, file_type="stl_ascii"), scale=1.0, origin=ORIGIN)
    np.testing.assert_allclose(mesh.triangles, TRIANGLES, atol=1e-5)


def test_an_upper_case_suffix_is_accepted(tmp_path):
    path = written(tmp_path, TRIANGLES).rename(tmp_path / "MESH.STL")
    assert len(read_mesh(path, scale=1.0, origin=ORIGIN).faces) == len(TRIANGLES)


def test_ascii_stl_of_several_solids_keeps_order(tmp_path):
    path = tmp_path / "solids.stl"
    halves = np.split(TRIANGLES, 2)
    path.write_text("".join(soup(half).export(file_type="stl_ascii") for half in halves))
    np.testing.assert_allclose(read_mesh(path, scale=1.0, origin=ORIGIN).triangles, TRIANGLES, atol=1e-5)


def test_obj_of_several_materials_keeps_order(tmp_path):
    corners = "".join(f"v {x} {y} {z}\n" for x, y, z in TRIANGLES[:4].reshape(-1, 3))
    faces = "".join(f"usemtl m{i % 2}\nf {3 * i + 1} {3 * i + 2} {3 * i + 3}\n" for i in range(4))
    (tmp_path / "m.obj").write_text(f"mtllib absent.mtl\n{corners}{faces}")
    mesh = read_mesh(tmp_path / "m.obj", scale=1.0, origin=ORIGIN)
    np.testing.assert_allclose(mesh.triangles, TRIANGLES[:4], atol=1e-5)


@pytest.mark.parametrize("suffix", ["stl", "obj"])
def test_names_that_are_not_utf_8(tmp_path, suffix):
    text = soup(TRIANGLES).export(file_type="stl_ascii" if suffix == "stl" else "obj")
    head, _, rest = text.partition("\n")
    (tmp_path / f"m.{suffix}").write_bytes(f"{head} café\n{rest}".encode("latin-1"))
    assert len(read_mesh(tmp_path / f"m.{suffix}", scale=1.0, origin=ORIGIN).faces) == len(TRIANGLES)


def test_squares_become_triangles(tmp_path):
    (tmp_path / "square.obj").write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n")
    mesh = read_mesh(tmp_path / "square.obj", scale=1.0, origin=ORIGIN)
    assert len(mesh.faces) == 2
    assert mesh.area == pytest.approx(1.0)


U = np.array([(0, 0), (30, 0), (30, 40), (20, 40), (20, 10), (10, 10), (10, 40), (0, 40)], dtype=float)
L = np.array([(10, 10), (10, 30), (0, 30), (0, 0), (30, 0), (30, 10)], dtype=float)  # its first corner sees all others
DART = np.array([(0, 0), (-3, 10), (0, 30), (-10, 10)], dtype=float)
POSITIONS = '<input offset="0" semantic="VERTEX" source="#verts-array-vertices" />'


def prism(folder, outline, suffix):
    """A prism of 20 mm whose caps are one polygon each."""
    n = len(outline)
    points = [(x, y, z) for z in (0.0, 20.0) for x, y in outline]
    faces = [[0, *range(1, n)[::-1]], [*range(n, 2 * n)], *([i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n))]
    lines = [" ".join(map(str, p)) for p in points]
    path = folder / f"prism.{suffix}"
    if suffix == "obj":
        text = "".join(f"v {line}\n" for line in lines)
        text += "".join("f " + " ".join(f"{i + 1}//1" for i in f) + "\n" for f in faces)
    elif suffix == "ply":
        text = f"ply\nformat ascii 1.0\nelement vertex {2 * n}\nproperty float x\nproperty float y\nproperty float z\n"
        text += f"element face {n + 2}\nproperty list uchar int vertex_indices\nend_header\n" + "\n".join(lines) + "\n"
        text += "".join(f"{len(f)} {' '.join(map(str, f))}\n" for f in faces)
    else:
        text = trimesh.creation.box().export(file_type="dae").decode()
        text = re.sub(r'count="24"( id="verts[^>]*>)[^<]*', rf'count="{6 * n}"\g<1>{" ".join(lines)}', text)
        text = text.replace('<accessor count="8" source="#verts', f'<accessor count="{2 * n}" source="#verts')
        corners = "".join(f"<p>{' '.join(map(str, f))}</p>" for f in faces)
        polygons = f'<polygons count="{n + 2}">{POSITIONS}{corners}</polygons>'
        text = re.sub(r"(?s)<triangles.*</triangles>", polygons, text)
    path.write_text(text)
    return path


@pytest.mark.parametrize("suffix", ["obj", "ply", "dae"])
def test_concave_polygons_that_readers_divide_wrongly_are_refused(tmp_path, suffix):
    for outline in (U, DART):
        sentence = refused(prism(tmp_path, outline, suffix))
        assert re.search(r"folded onto each other at [24] edges, .*concave polygons", sentence)
    mesh = read_mesh(prism(tmp_path, L, suffix), scale=1.0, origin=ORIGIN)
    assert mesh.area == pytest.approx(2 * 500.0 + 20.0 * 120.0)


@pytest.mark.parametrize("suffix", ["glb", "dae"])
def test_scene_is_one_mesh_with_its_transforms_applied(tmp_path, suffix):
    box = trimesh.creation.box(extents=(1.0, 2.0, 3.0))
    if suffix == "glb":
        scene = trimesh.Scene()
        scene.add_geometry(box, transform=trimesh.transformations.translation_matrix([10.0, 0.0, 0.0]))
        scene.add_geometry(box, transform=np.diag([-1.0, 1.0, 1.0, 1.0]))  # a mirror must not turn it inside out
        scene.export(tmp_path / "scene.glb")
    else:
        text = box.export(file_type="dae").decode()
        moved = "<matrix>1 0 0 10 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry"
        assert "<instance_geometry" in text
        (tmp_path / "scene.dae").write_text(text.replace("<instance_geometry", moved, 1))
    mesh = read_mesh(tmp_path / f"scene.{suffix}", scale=1.0, origin=ORIGIN)
    assert mesh.volume == pytest.approx(6.0 * len(mesh.faces) / 12)
    assert mesh.bounds[1].tolist() == [10.5, 1.0, 1.5]


def test_scale_and_origin_place_the_vertices(tmp_path):
    mesh = read_mesh(written(tmp_path, TRIANGLES), scale=0.001, origin=(1.0, 2.0, -3.0))
    np.testing.assert_allclose(mesh.triangles, (TRIANGLES - [1.0, 2.0, -3.0]) * 0.001, atol=1e-8)


@pytest.mark.parametrize("scale", [0.0, -0.001, float("nan"), float("inf")])
def test_a_scale_that_is_not_positive_is_refused(tmp_path, scale):
    assert refused(written(tmp_path, TRIANGLES), scale=scale) == f"mesh.scale is {scale}; it must be a positive number"


@pytest.mark.parametrize("origin", [(0.0, 0.0), (0.0, 0.0, float("nan")), (float("inf"), 0.0, 0.0), ()])
def test_an_origin_that_is_not_three_finite_numbers_is_refused(tmp_path, origin):
    message = f"mesh.origin is {list(origin)}; it must be three finite numbers"
    assert refused(written(tmp_path, TRIANGLES), origin=origin) == message


@pytest.mark.parametrize("name", ["absent.stl", "absent/mesh.stl"])
def test_a_missing_file_is_named(tmp_path, name):
    assert refused(tmp_path / name) == f"mesh file '{tmp_path / name}' cannot be read: No such file or directory"


def test_a_path_below_a_file_is_refused(tmp_path):
    (tmp_path / "file").touch()
    assert "cannot be read: Not a directory" in refused(tmp_path / "file" / "mesh.stl")


@pytest.mark.parametrize("name", ["mesh.step", "mesh"])
def test_unsupported_suffix_lists_the_supported_ones(tmp_path, name):
    (tmp_path / name).write_text("ISO-10303-21;")
    assert refused(tmp_path / name).endswith("has no supported suffix; these are .stl, .obj, .ply, .glb, .dae, .npz")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_empty_file_is_refused(tmp_path, suffix):
    path = tmp_path / f"mesh.{suffix}"
    path.touch()
    assert refused(path) == f"mesh file '{path}' is empty"


@pytest.mark.parametrize("content", [b"grains of sand\n" * 100, b"\0" * 84, b"\x93\xff" * 500])
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_that_is_not_a_mesh_is_refused(tmp_path, suffix, content):
    path = tmp_path / f"mesh.{suffix}"
    path.write_bytes(content)
    message = refused(path)
    assert message.startswith(f"mesh file '{path}' ")
    assert f"not a valid {suffix.upper()} file" in message


@pytest.mark.parametrize("options", [{}, {"file_type": "stl_ascii"}])
def test_stl_without_facets(tmp_path, options):
    path = written(tmp_path, TRIANGLES[:0], **options)
    assert refused(path) == f"mesh file '{path}' has no facets: it is empty, cut short or not a valid STL file"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_cut_short_is_refused(tmp_path, suffix):
    path = written(tmp_path, TRIANGLES, suffix)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert refused(path).startswith(f"mesh file '{path}' ")


def test_word_among_the_numbers_of_an_ascii_stl(tmp_path):
    path = written(tmp_path, TRIANGLES, file_type="stl_ascii")
    lines = path.read_text().splitlines()
    lines[12] = "vertex 1.0 oops 2.0"
    path.write_text("\n".join(lines))
    assert "is not a valid STL file" in refused(path)


def test_points_without_facets_are_refused(tmp_path):
    trimesh.PointCloud(TRIANGLES[:, 0]).export(tmp_path / "points.ply")
    assert "has no facets" in refused(tmp_path / "points.ply")


@pytest.mark.parametrize("number", ["7", "-1"])
def test_a_facet_with_a_missing_vertex_is_refused(tmp_path, number):
    header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "m.ply").write_text(f"{header}{face}0 0 0\n1 0 0\n0 1 0\n3 0 1 {number}\n")
    assert "has facets with vertices that are not in it" in refused(tmp_path / "m.ply")


def test_vertices_of_two_coordinates_are_refused(tmp_path):
    (tmp_path / "flat.obj").write_text("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n")
    assert "has vertices with 2 coordinates instead of 3" in refused(tmp_path / "flat.obj")


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")  # from writing the file
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb"])
def test_vertices_that_are_not_numbers_are_counted(tmp_path, suffix, value):
    triangles = TRIANGLES.copy()
    triangles[3, 1, 2] = triangles[5, 0, 0] = value
    path = written(tmp_path, triangles, suffix)
    assert refused(path) == f"mesh file '{path}' has 2 of {triangles.size // 3} vertices that are NaN or infinite"


def test_vertices_whose_areas_overflow_are_refused(tmp_path):
    assert "vertices that are NaN or infinite" in refused(written(tmp_path, TRIANGLES), scale=1e84)
    read_mesh(written(tmp_path, TRIANGLES), scale=1e58, origin=ORIGIN)


def test_nan_in_the_second_solid_is_not_lost(tmp_path):
    text = soup(TRIANGLES).export(file_type="stl_ascii")
    spoilt = text.replace("vertex 0.0 ", "vertex nan ", 1)
    assert spoilt != text
    (tmp_path / "m.stl").write_text(text + spoilt)
    assert "has 1 of 480 vertices that are NaN" in refused(tmp_path / "m.stl")


def test_a_mesh_without_any_area_is_refused(tmp_path):
    line = [[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]], [[5.0, 5.0, 5.0]] * 3]
    assert "has no facet with an area" in refused(written(tmp_path, np.array(line)))


def test_a_mesh_over_the_facet_limit_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_file, "MAX_FACETS", 79)
    path = written(tmp_path, TRIANGLES)
    assert refused(path) == f"mesh file '{path}' has 80 facets; the limit is 79"


def test_missing_reader_is_named(tmp_path, monkeypatch):
    path = written(tmp_path, TRIANGLES, "dae")
    monkeypatch.setitem(sys.modules, "collada", None)
    assert "pip install pycollada" in refused(path)
