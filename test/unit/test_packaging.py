"""A release as a user gets it: sdist, wheel, and that wheel installed where nothing else is; what ROS tools read of it.

The README's blocks run in that environment: `test_docs_blocks.py`.
"""

import os
import re
import subprocess
import tarfile
import zipfile
from importlib.metadata import packages_distributions

import pytest
from distribution import ROOT, manifest, metadata, third_party_imports, without_ros
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

pytestmark = pytest.mark.repository

# The module that each rosdep key brings.
MODULES = {
    "python3-numpy": "numpy",
    "python3-scipy": "scipy",
    "python3-yaml": "yaml",
    "python3-rich": "rich",
    "python3-trimesh-pip": "trimesh",
    "python3-rosbags-pip": "rosbags",
    "python3-collada": "collada",
}
NO_KEY_ON_NOBLE = {"numba", "mcap", "plotly", "fast_simplification"}
BROUGHT = {
    "llvmlite": "numba",
    "lz4": "mcap",
    "zstandard": "mcap",
}  # modules, and the package that requires each
EXTRAS = {"distributed", "matplotlib", "mujoco"}


def test_the_wheel_holds_every_module_and_every_shared_file(wheel):
    folders = (
        "config/*.*",
        "config/robots/*.yaml",
        "launch/*.*",
        "rviz/*.*",
        "meshes/*.stl",
        "package.xml",
    )
    shared = {
        f"share/rft_ros/{file.relative_to(ROOT)}"
        for pattern in folders
        for file in ROOT.glob(pattern)
    }
    shared |= {
        "share/ament_index/resource_index/packages/rft_ros",
        "lib/rft_ros/rft",
        "lib/rft_ros/rft_node",
    }
    modules = {str(f.relative_to(ROOT)) for f in (ROOT / "rft_ros").rglob("*.py")} | {
        "rft_ros/py.typed"
    }
    with zipfile.ZipFile(wheel) as files:
        names = {n for n in files.namelist() if ".dist-info/" not in n}
    assert {n for n in names if ".data/" not in n} == modules
    assert {n.partition(".data/data/")[2] for n in names if ".data/" in n} == shared


def test_the_sdist_has_its_licence_and_changelog_and_no_stray_files(dist):
    (sdist,) = dist.glob("rft_ros-*.tar.gz")
    with tarfile.open(sdist) as files:
        names = {name.partition("/")[2] for name in files.getnames()}
    assert {"LICENSE", "README.md", "CHANGELOG.rst", "package.xml", "setup.py"} <= names
    stray = re.compile(r"\.|out|build|.*\.(pyc|nbi|nbc)$")
    assert [name for name in names if stray.match(name)] == []


def test_every_package_that_is_imported_is_required(wheel):
    package, _ = manifest()
    of_ros = {
        dependency.name for dependency in package.exec_depends
    }  # one requirement brings them all
    of_dask = {"distributed"}  # dask[distributed]
    required = {
        canonicalize_name(Requirement(line).name) for line in metadata(wheel)["Requires-Dist"]
    }
    by_module = packages_distributions() | {
        module: [package] for module, package in BROUGHT.items()
    }
    missing = {
        module
        for module in third_party_imports() - of_ros - of_dask
        if not {canonicalize_name(name) for name in by_module.get(module, [module])} & required
    }
    assert missing == set()


def test_the_installed_wheel_is_found_by_ros_and_by_itself(installed, wheel):
    """Where ROS looks; without ROS, too, `package://` finds the shipped meshes."""
    share, node = installed / "share" / "rft_ros", installed / "lib" / "rft_ros"
    assert (
        installed / "share" / "ament_index" / "resource_index" / "packages" / "rft_ros"
    ).is_file()
    assert all(os.access(node / name, os.X_OK) for name in ("rft_node", "rft"))
    package, _ = manifest()
    assert metadata(wheel)["Version"] == [package.version]
    python, mesh = str(installed / "bin" / "python"), str(share / "meshes" / "ellipsoid.stl")
    code = "from rft_ros.tool import locate_mesh; print(*map(locate_mesh, %r))"
    names = ("package://rft_ros/meshes/ellipsoid.stl", "ellipsoid")
    for command, extra, said in (
        ([python, str(node / "rft"), "--version"], {}, ["rft", package.version]),
        ([python, "-c", code % (names,)], {}, [mesh, mesh]),
        ([python, "-c", code % (names,)], {"AMENT_PREFIX_PATH": str(installed)}, [mesh, mesh]),
    ):
        done = subprocess.run(
            command, capture_output=True, text=True, cwd=installed, env=without_ros() | extra
        )
        assert done.stdout.split() == said, done.stderr


def test_the_manifest_is_valid_and_has_each_dependency_or_names_it_for_pip():
    package, warnings = manifest()
    assert warnings == []
    keys = {d.name for d in package.exec_depends}
    own = third_party_imports() - NO_KEY_ON_NOBLE - EXTRAS - set(BROUGHT)
    by_trimesh = {"collada"}  # to read DAE
    assert {MODULES.get(key, key) for key in keys} == own | by_trimesh
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (by_hand,) = re.findall(r"pip install --break-system-packages (.+)", readme)
    for name in NO_KEY_ON_NOBLE:
        assert name.replace("_", "-") in by_hand
