"""Paths, package:// and file:// URIs and the names of shipped meshes."""

import subprocess
import sys
from pathlib import Path

import pytest

from rft_ros.errors import InputError
from rft_ros.installation import share_directory
from rft_ros.tool import locate_mesh

SHIPPED = ("abb_plate", "ellipsoid", "plate", "root_tip", "sphere")


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """A second prefix on AMENT_PREFIX_PATH, with a package `gripper` that has one mesh."""
    meshes = tmp_path / "overlay" / "share" / "gripper" / "meshes"
    meshes.mkdir(parents=True)
    (meshes / "finger.stl").touch()
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path / 'empty'}:{tmp_path / 'overlay'}")
    return tmp_path / "overlay"


def test_path_is_taken_as_it_is(tmp_path):
    assert locate_mesh(str(tmp_path / "a.stl")) == tmp_path / "a.stl"
    assert locate_mesh("folder/a.stl") == Path("folder/a.stl")
    assert locate_mesh("./plate") == Path("plate")


def test_tilde_is_the_home_folder(monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert locate_mesh("~/a.stl") == tmp_path / "a.stl"


def test_unknown_home_is_named():
    with pytest.raises(InputError, match=r"'~no_such_user_1/a.stl' cannot be read: Could not determine home"):
        locate_mesh("~no_such_user_1/a.stl")


def test_a_file_uri_is_a_path_on_this_machine():
    assert locate_mesh("file:///a%20b/c.stl") == locate_mesh("file://localhost/a b/c.stl") == Path("/a b/c.stl")
    with pytest.raises(InputError, match="is on another machine, 'nas'"):
        locate_mesh("file://nas/c.stl")


def test_package_uri_is_found_in_every_prefix(prefix):
    found = prefix / "share" / "gripper" / "meshes" / "finger.stl"
    assert locate_mesh("package://gripper/meshes/finger.stl") == found


def test_package_uri_is_found_where_pip_installs(tmp_path, monkeypatch):
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(sys, "prefix", str(tmp_path))
    (tmp_path / "share" / "gripper").mkdir(parents=True)
    assert locate_mesh("package://gripper/a.stl") == tmp_path / "share" / "gripper" / "a.stl"


@pytest.mark.usefixtures("prefix")
def test_the_first_prefix_takes_precedence(tmp_path):
    (tmp_path / "empty" / "share" / "gripper").mkdir(parents=True)
    assert share_directory("gripper") == tmp_path / "empty" / "share" / "gripper"


@pytest.mark.parametrize("uri", ["package://gone/a.stl", "package:///a.stl", "package://../a.stl"])
@pytest.mark.usefixtures("prefix")
def test_unknown_package_is_named_with_the_prefixes(uri):
    package = uri.removeprefix("package://").split("/")[0]
    with pytest.raises(InputError, match=rf"^package '{package}' has no share folder in AMENT_PREFIX_PATH .*overlay"):
        locate_mesh(uri)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_mesh_by_name_and_by_uri(name):
    assert locate_mesh(name).is_file()
    assert locate_mesh(f"package://rft_ros/meshes/{name}.stl") == locate_mesh(name)


@pytest.mark.parametrize("name", ["elipsoid", "", "~", ".."])
def test_unknown_name_lists_the_shipped_ones(name):
    with pytest.raises(InputError, match=f"mesh.file '{name}' is not a shipped mesh .*{', '.join(SHIPPED)}"):
        locate_mesh(name)


def test_shipped_name_is_not_hidden_by_a_folder_of_that_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("plate").mkdir()
    assert locate_mesh("plate").name == "plate.stl"


def test_importing_the_package_loads_neither_trimesh_nor_ros():
    code = "import sys, rft_ros.tool; sys.exit(bool({'trimesh', 'rclpy'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
