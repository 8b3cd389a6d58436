"""A release as a user gets it: sdist, the wheel built from it, and that wheel installed where nothing else is."""

import os
import subprocess
import sys
import tarfile
import venv
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest
from distribution import (
    ROOT,
    clean_copy,
    manifest,
    own_domain,
    place,
    required,
    share_machine_code,
    third_party_imports,
    without_ros,
)

pytest.importorskip("build", reason="building a release needs build: pip install 'rft_ros[test]'")


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that ``make dist`` fills: an sdist, and a wheel built from nothing but the sdist."""
    folder = tmp_path_factory.mktemp("dist")
    source = clean_copy(tmp_path_factory.mktemp("source") / "rft_ros")
    command = [sys.executable, "-m", "build", "--outdir", str(folder), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, env=without_ros())
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return folder


@pytest.fixture(scope="module")
def wheel(dist: Path) -> Path:
    (wheel,) = dist.glob("rft_ros-*.whl")
    return wheel


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An empty environment, without even setuptools, with the wheel and the packages that it asks for, and no others.

    pip installs the wheel; the others, of the versions that the wheel allows, come from this process's environment.
    """
    environment = tmp_path_factory.mktemp("installed") / "env"
    venv.create(environment, with_pip=False)
    python = str(environment / "bin" / "python")
    pip = [sys.executable, "-m", "pip", "--quiet", "--python", python, "install", "--no-deps", "--no-index", str(wheel)]
    subprocess.run(pip, check=True, cwd=environment, env=without_ros())
    (package,) = environment.glob("lib/python*/site-packages/rft_ros")
    for distribution in required(metadata(wheel)["Requires-Dist"], extra="ros"):
        place(distribution, package.parent)
    share_machine_code(package)
    return environment


def surroundings(**extra: str) -> dict[str, str]:
    return without_ros() | own_domain() | extra


def run(environment: Path, *command: str, **extra: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, capture_output=True, text=True, cwd=environment, env=surroundings(**extra))


def metadata(wheel: Path) -> dict[str, list[str]]:
    with zipfile.ZipFile(wheel) as files:
        (name,) = (n for n in files.namelist() if n.endswith(".dist-info/METADATA"))
        message = message_from_bytes(files.read(name))
    return {key: message.get_all(key, []) for key in message}


def test_the_wheel_holds_every_module_and_every_shared_file(wheel):
    shared = {
        *(
            f"share/rft_ros/{f.relative_to(ROOT)}"
            for kind in ("config", "launch", "rviz")
            for f in (ROOT / kind).glob("*.*")
        ),
        *(f"share/rft_ros/meshes/{f.name}" for f in (ROOT / "meshes").glob("*.stl")),
        *("share/rft_ros/package.xml", "share/ament_index/resource_index/packages/rft_ros"),
        *("lib/rft_ros/rft", "lib/rft_ros/rft_node"),
    }
    modules = {str(f.relative_to(ROOT)) for f in (ROOT / "rft_ros").rglob("*.py")} | {"rft_ros/py.typed"}
    with zipfile.ZipFile(wheel) as files:
        names = {n for n in files.namelist() if ".dist-info/" not in n}
    assert {n for n in names if ".data/" not in n} == modules
    assert {n.partition(".data/data/")[2] for n in names if ".data/" in n} == shared


def test_the_sdist_has_its_licence_and_changelog_and_no_stray_files(dist):
    (sdist,) = dist.glob("rft_ros-*.tar.gz")
    with tarfile.open(sdist) as files:
        names = {name.partition("/")[2] for name in files.getnames()}
    assert {"LICENSE", "README.md", "CHANGELOG.rst", "package.xml", "setup.py", "setup.cfg"} <= names
    assert not {n for n in names if n.endswith((".pyc", ".nbi", ".nbc")) or n.startswith((".", "out", "build"))}


def test_every_package_that_is_imported_is_required(wheel):
    package, _ = manifest()
    of_ros = {dependency.name for dependency in package.exec_depends}  # one requirement brings them all
    of_dask = {"distributed"}  # dask[distributed]
    from importlib.metadata import packages_distributions

    from packaging.requirements import Requirement
    from packaging.utils import canonicalize_name

    required = {canonicalize_name(Requirement(line).name) for line in metadata(wheel)["Requires-Dist"]}
    by_module = packages_distributions() | {"llvmlite": ["numba"]}  # which brings it
    missing = {
        module
        for module in third_party_imports() - of_ros - of_dask
        if not {canonicalize_name(name) for name in by_module.get(module, [module])} & required
    }
    assert missing == set()


def test_data_files_land_where_ros_looks_for_them(installed):
    share = installed / "share" / "rft_ros"
    assert (installed / "share" / "ament_index" / "resource_index" / "packages" / "rft_ros").is_file()
    for file in ("package.xml", "config/default.yaml", "launch/rft.launch.py", "rviz/rft.rviz", "meshes/plate.stl"):
        assert (share / file).is_file(), file


def test_ros2_run_finds_executables(installed):
    for name in ("rft_node", "rft"):
        assert os.access(installed / "lib" / "rft_ros" / name, os.X_OK)
    done = run(installed, str(installed / "bin" / "python"), str(installed / "lib" / "rft_ros" / "rft"), "--help")
    assert done.returncode == 0, done.stderr
    assert "replay" in done.stdout


@pytest.mark.parametrize("with_ros", [False, True])
def test_package_uris_are_found_with_and_without_ros(installed, with_ros):
    extra = {"AMENT_PREFIX_PATH": str(installed)} if with_ros else {}
    names = ("package://rft_ros/meshes/ellipsoid.stl", "ellipsoid")
    code = f"from rft_ros.tool import locate_mesh; print(*map(locate_mesh, {names}))"
    done = run(installed, str(installed / "bin" / "python"), "-c", code, **extra)
    assert done.stdout.split() == [str(installed / "share" / "rft_ros" / "meshes" / "ellipsoid.stl")] * 2, done.stderr


def test_the_version_is_that_of_the_package_manifest(installed, wheel):
    package, _ = manifest()
    assert metadata(wheel)["Version"] == [package.version]
    assert run(installed, str(installed / "bin" / "rft"), "--version").stdout == f"rft {package.version}\n"


def test_the_node_and_the_demo_run_where_nothing_but_the_wheel_was_installed(installed, tmp_path):
    done = run(installed, str(installed / "bin" / "rft"), "demo", "--seconds", "6", "-o", str(tmp_path / "demo"))
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "demo" / "replay" / "report.html").stat().st_size > 10_000
    assert list((tmp_path / "demo" / "bag").glob("*.mcap"))
