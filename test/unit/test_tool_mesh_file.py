"""Reading mesh files: every format, placed and scaled; and the sentence for each file that cannot be used."""

import json
import re
import sys
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from test_tool_check import soup

from rft_ros.errors import InputError
from rft_ros.tool import load_tool, mesh_file
from rft_ros.tool.mesh_file import MeshFrame, read_mesh

SUFFIXES = ["stl", "obj", "ply", "glb", "dae"]
TRIANGLES = trimesh.creation.icosphere(subdivisions=1, radius=20.0).triangles


def written(folder, triangles=TRIANGLES, suffix="stl", **options):
    path = folder / f"mesh.{suffix}"
    soup(triangles).export(path, **options)
    return path


def read(path, *, scale=1.0, origin=(0.0, 0.0, 0.0), quaternion=(0.0, 0.0, 0.0, 1.0)):
    return read_mesh(path, MeshFrame.checked(scale, origin, quaternion))[0]


def refused(path, **given):
    with pytest.raises(InputError) as caught:
        read(path, **given)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize(
    "options", [*({"suffix": suffix} for suffix in SUFFIXES), {"file_type": "stl_ascii"}]
)
def test_every_format_keeps_facets_order_and_winding(tmp_path, options):
    path = written(tmp_path, **options)
    np.testing.assert_allclose(read(path).triangles, TRIANGLES, atol=1e-5)
    upper = path.rename(tmp_path / path.name.upper())
    assert len(read(upper).faces) == len(TRIANGLES)


@pytest.mark.parametrize("suffix", ["stl", "obj"])
def test_names_that_are_not_utf_8(tmp_path, suffix):
    text = soup(TRIANGLES).export(file_type="stl_ascii" if suffix == "stl" else "obj")
    head, _, rest = text.partition("\n")
    (tmp_path / f"m.{suffix}").write_bytes(f"{head} café\n{rest}".encode("latin-1"))
    assert len(read(tmp_path / f"m.{suffix}").faces) == len(TRIANGLES)


SQUARE = np.array([(0, 0), (30, 0), (30, 30), (0, 30)], dtype=float)
# its first corner sees all others
L = np.array([(10, 10), (10, 30), (0, 30), (0, 0), (30, 0), (30, 10)], dtype=float)
U = np.array(
    [(0, 0), (30, 0), (30, 40), (20, 40), (20, 10), (10, 10), (10, 40), (0, 40)], dtype=float
)
DART = np.array([(0, 0), (-3, 10), (0, 30), (-10, 10)], dtype=float)


def prism(folder, outline):
    """A prism of 20 mm whose caps are one polygon each."""
    n = len(outline)
    sides = [[i, (i + 1) % n, n + (i + 1) % n, n + i] for i in range(n)]
    text = "".join(f"v {x} {y} {z}\n" for z in (0.0, 20.0) for x, y in outline)
    for face in ([0, *range(1, n)[::-1]], range(n, 2 * n), *sides):
        text += "f " + " ".join(f"{i + 1}//1" for i in face) + "\n"
    (folder / "prism.obj").write_text(text)
    return folder / "prism.obj"


def test_polygons_become_triangles_and_concave_ones_that_readers_divide_wrongly_are_refused(
    tmp_path,
):
    """Readers of OBJ, PLY and DAE divide a polygon into a fan from its first corner."""
    for outline, area in ((SQUARE, 900.0), (L, 500.0)):
        side = np.linalg.norm(outline - np.roll(outline, 1, axis=0), axis=1).sum()
        assert read(prism(tmp_path, outline)).area == pytest.approx(2 * area + 20.0 * side)
    for outline in (U, DART):
        sentence = refused(prism(tmp_path, outline))
        assert re.search(r"folded onto each other at [24] edges, .*concave polygons", sentence)


@pytest.mark.parametrize("suffix", ["glb", "dae"])
def test_scene_is_one_mesh_with_its_transforms_applied(tmp_path, suffix):
    box = trimesh.creation.box(extents=(1.0, 2.0, 3.0))
    if suffix == "glb":
        scene = trimesh.Scene()
        scene.add_geometry(
            box, transform=trimesh.transformations.translation_matrix([10.0, 0.0, 0.0])
        )
        # a mirror must not turn it inside out
        scene.add_geometry(box, transform=np.diag([-1.0, 1.0, 1.0, 1.0]))
        scene.export(tmp_path / "scene.glb")
    else:
        text = box.export(file_type="dae").decode()
        moved = "<matrix>1 0 0 10 0 1 0 0 0 0 1 0 0 0 0 1</matrix><instance_geometry"
        (tmp_path / "scene.dae").write_text(text.replace("<instance_geometry", moved, 1))
    mesh = read(tmp_path / f"scene.{suffix}")
    assert mesh.volume == pytest.approx(6.0 * len(mesh.faces) / 12)
    assert mesh.bounds[1].tolist() == [10.5, 1.0, 1.5]


def test_scale_and_origin_place_the_vertices(tmp_path):
    mesh = read(written(tmp_path), scale=0.001, origin=(1.0, 2.0, -3.0))
    np.testing.assert_allclose(mesh.triangles, (TRIANGLES - [1.0, 2.0, -3.0]) * 0.001, atol=1e-8)


@pytest.mark.parametrize(
    ("placed", "words"),
    [
        *(({"scale": v}, ("mesh.scale", str(v), "at least 0")) for v in (-0.001, np.nan, np.inf)),
        ({"scale": "1"}, ("mesh.scale", "'1'", "at least 0")),
        ({"origin": "abc"}, ("mesh.origin", "real numbers")),
        *(({"origin": v}, ("mesh.origin", f"[{len(v)}]", "[3]")) for v in ((), (0.0, 0.0))),
        *(
            ({"origin": (0.0, 0.0, v)}, ("mesh.origin", str(v), "near mesh file"))
            for v in (1e30, np.nan, np.inf)
        ),
    ],
)
def test_a_wrong_scale_or_origin_is_refused(tmp_path, placed, words):
    with pytest.raises(ValueError, match=r"mesh\.") as error:
        load_tool(written(tmp_path), **placed)
    assert all(word in str(error.value) for word in words), error.value


@pytest.mark.parametrize(
    ("suffix", "declared", "unit"),
    [
        *((suffix, "", 0.001) for suffix in ("stl", "obj", "ply")),
        ("glb", "", 1.0),
        ("dae", "", 1.0),
        *(("dae", f'<unit name="u" meter="{unit}"/>', unit) for unit in (0.001, 0.0254, 1.0)),
    ],
)
def test_without_a_scale_the_unit_that_the_file_declares_is_taken_and_a_given_scale_stands(
    tmp_path, suffix, declared, unit
):
    path = written(tmp_path, suffix=suffix)
    if declared:
        path.write_text(path.read_text().replace("<up_axis>", f"{declared}<up_axis>"))
    declared, given = load_tool(path), load_tool(path, scale=0.002)
    assert declared.size == pytest.approx(load_tool(path, scale=unit).size)
    assert given.size == pytest.approx(0.002 * declared.size / unit)
    assert declared.frame.scale == pytest.approx(unit)


PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
PLY += "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 "
STL = soup(TRIANGLES).export(file_type="stl_ascii")
NOT_VALID = r"is not a valid [A-Z]+ file: it may be empty, cut short or without facets$"


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("absent/mesh.stl", None, "does not exist; give a path, or one of abb_plate, .*, sphere$"),
        ("nothing.obj", b"", "is empty"),
        *(
            (name, b"ISO", "has no supported suffix; these are .stl, .obj, .*, .urdf#LINK$")
            for name in ("mesh.step", "mesh")
        ),
        ("missing.ply", (PLY + "7").encode(), NOT_VALID),
        ("missing.ply", (PLY + "-1").encode(), NOT_VALID),
        ("flat.obj", b"v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", NOT_VALID),
        ("word.stl", STL.replace("vertex", "vertex oops", 1).encode(), NOT_VALID),
        ("no_facets.stl", soup(TRIANGLES[:0]).export(file_type="stl"), NOT_VALID),
        ("points.ply", trimesh.PointCloud(TRIANGLES[:, 0]).export(file_type="ply"), NOT_VALID),
        (
            "line.stl",
            soup([[[0, 0, 0], [1, 0, 0], [2, 0, 0]]]).export(file_type="stl"),
            "at mesh.scale 1.0 has no facet with an area",
        ),
        *(
            (f"mesh.{suffix}", content, NOT_VALID)
            for suffix in SUFFIXES
            for content in (b"grains of sand\n" * 100, b"\0" * 84, b"\x93\xff" * 500)
        ),
    ],
)
def test_a_file_that_cannot_be_used_is_named_with_the_reason(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert re.match(f"mesh file '{tmp_path / name}' {message}", refused(tmp_path / name))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_cut_short_is_refused(tmp_path, suffix):
    path = written(tmp_path, suffix=suffix)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    assert refused(path).startswith(f"mesh file '{path}' ")


@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")  # from writing the file
@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb"])
def test_vertices_that_are_not_numbers_are_counted(tmp_path, suffix, value):
    triangles = TRIANGLES.copy()
    triangles[3, 1, 2] = triangles[5, 0, 0] = value
    path = written(tmp_path, triangles, suffix)
    said = refused(path)
    assert str(path) in said
    assert f"2 of {triangles.size // 3} vertices" in said
    nowhere = written(tmp_path, np.full_like(triangles, value), suffix)
    assert "NaN or infinite" in refused(nowhere, origin=(0.0, 0.0, 1.0))


def test_vertices_whose_areas_overflow_are_refused(tmp_path):
    assert "vertices that are NaN or infinite" in refused(written(tmp_path), scale=1e84)
    read(written(tmp_path), scale=1e58)


def test_a_mesh_over_the_facet_limit_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(mesh_file, "_MAX_FACET_COUNT", 79)
    assert refused(written(tmp_path)).endswith("has 80 facets; the limit is 79")


def test_missing_reader_is_named(tmp_path, monkeypatch):
    path = written(tmp_path, suffix="dae")
    monkeypatch.setitem(sys.modules, "collada", None)
    assert "pip install pycollada" in refused(path)


def test_a_scene_of_very_many_parts_is_refused_before_it_is_put_together(tmp_path):
    scene = trimesh.Scene()
    scene.add_geometry(soup(TRIANGLES))
    data = bytearray(scene.export(file_type="glb"))
    size = int.from_bytes(data[12:16], "little")
    content = json.loads(data[20 : 20 + size])
    content["nodes"] = [{"mesh": 0}] * 200_000
    content["scenes"] = [{"nodes": [*range(200_000)]}]
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    body = len(text).to_bytes(4, "little") + b"JSON" + text + data[20 + size :]
    (tmp_path / "many.glb").write_bytes(
        b"glTF" + (2).to_bytes(4, "little") + (12 + len(body)).to_bytes(4, "little") + body
    )
    assert "has 200,000 parts; the limit is 10,000; export it as one mesh" in refused(
        tmp_path / "many.glb"
    )


@pytest.mark.parametrize("suffix", ["ply", "stl", "obj", "dae", "glb"])
def test_a_mesh_that_claims_gigabytes_or_names_other_files_is_refused_or_loaded_without_them(
    tmp_path, suffix
):
    """Counts of 4e9 that no data follows, external buffers and materials, entities that grow or are devices."""
    ply = "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nproperty float y\n"
    ply += "property float z\nelement face 4000000000\nproperty list uchar int vertex_indices\nend_header\n"
    entities = '<!ENTITY a "1111111111">' + "".join(
        f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise("abcdefghij")
    )
    dae = f"<?xml version='1.0'?><!DOCTYPE x [{entities}<!ENTITY z SYSTEM 'file:///dev/zero'>]><COLLADA>&j;&z;</COLLADA>"
    buffers = [{"byteLength": 2**32, "uri": "/dev/zero"}]
    content = {
        "asset": {"version": "2.0"},
        "buffers": buffers,
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    }
    content |= {
        "accessors": [{"componentType": 5126, "count": 2**30, "type": "VEC3"}],
        "nodes": [{"mesh": 0}],
    }
    text = json.dumps(content | {"scenes": [{"nodes": [0]}]}).encode()
    text += b" " * (-len(text) % 4)
    glb = b"glTF" + (2).to_bytes(4, "little") + (20 + len(text)).to_bytes(4, "little")
    files = {
        "ply": ply.encode() + bytes(600),
        "stl": bytes(80) + (4_000_000_000).to_bytes(4, "little") + bytes(500),
        "obj": b"mtllib /dev/zero\nusemtl a\nv 0 0 0\nv 1 0 0\nf 1 2 9\n",
        "dae": dae.encode(),
        "glb": glb + len(text).to_bytes(4, "little") + b"JSON" + text,
    }
    (tmp_path / f"mesh.{suffix}").write_bytes(files[suffix])
    assert "is not a valid" in refused(tmp_path / f"mesh.{suffix}")
