"""Paths, package:// and file:// URIs and the names of shipped meshes."""

import re
import sys
from pathlib import Path

import pytest
from refusals import refusal

from rft_ros.installation import share_directory
from rft_ros.tool import locate_mesh

SHIPPED = ("abb_plate", "ellipsoid", "plate", "root_tip", "scoop", "sphere")


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """A second prefix on AMENT_PREFIX_PATH, with a package `gripper` that has one mesh."""
    meshes = tmp_path / "overlay" / "share" / "gripper" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "finger.stl").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'empty'}:{tmp_path / 'overlay'}")
    return tmp_path / "overlay"


@pytest.mark.parametrize(
    ("file", "path"),
    [
        ("/folder/a.stl", "/folder/a.stl"),
        ("folder/a.stl", "folder/a.stl"),
        (Path("folder/a.stl"), "folder/a.stl"),
        ("./plate", "plate"),
        ("~/a.stl", "/home/of/me/a.stl"),
        ("~no_such_user_1/a.stl", "~no_such_user_1/a.stl"),
        ("file:///a%20b/c.stl", "/a b/c.stl"),
        ("file://localhost/a b/c.stl", "/a b/c.stl"),
    ],
)
def test_a_path_or_a_file_uri_is_a_path_on_this_machine(file, path, monkeypatch):
    monkeypatch.setenv("HOME", "/home/of/me")
    assert locate_mesh(file) == Path(path)


def test_package_uri_is_found_in_every_prefix_and_the_first_one_takes_precedence(prefix, tmp_path):
    found = prefix / "share" / "gripper" / "meshes" / "finger.stl"
    assert locate_mesh("package://gripper/meshes/finger.stl") == found
    (tmp_path / "empty" / "share" / "gripper").mkdir(parents=True)
    assert share_directory("gripper") == tmp_path / "empty" / "share" / "gripper"


def test_package_uri_is_found_where_pip_installs(tmp_path, monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    (tmp_path / "share" / "gripper").mkdir(parents=True)
    assert locate_mesh("package://gripper/a.stl") == tmp_path / "share" / "gripper" / "a.stl"


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_mesh_by_name_and_by_uri_is_not_hidden_by_a_folder_of_that_name(
    name, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    Path(name).mkdir()
    assert locate_mesh(name).is_file()
    assert locate_mesh(f"package://rft_ros/meshes/{name}.stl") == locate_mesh(name)


@pytest.mark.parametrize(
    ("file", "message"),
    [
        *(
            (name, f"mesh.file '{name}' is not a shipped mesh .*{', '.join(SHIPPED)}")
            for name in ("elipsoid", "", "~")
        ),
        (3, "^mesh.file is 3; it must be a path or the name"),
        ("file:///a%00.stl", "; it must be a path or the name"),
        ("file://nas/c.stl", "is on another machine, 'nas'"),
        (
            "package://gone/a.stl",
            "^package 'gone' has no share folder in AMENT_PREFIX_PATH .*overlay",
        ),
        ("package:///a.stl", "^package '' has no share folder in AMENT_PREFIX_PATH .*overlay"),
        ("package://gripper/../other/a.stl", "leaves its package"),
        ("package://gripper/%2e%2e/other/a.stl", "leaves its package"),
        ("package://gripper//etc/passwd", "leaves its package"),
        ("package://../a.stl", "^package '..' has no share folder in AMENT_PREFIX_PATH .*overlay"),
    ],
)
@pytest.mark.usefixtures("prefix")
def test_what_is_not_found_is_named(file, message):
    assert re.search(message, refusal(locate_mesh, file))
