"""``pip install .`` as a user does it: a wheel, in a virtual environment of its own, run from elsewhere."""

import os
import subprocess
import sys
import sysconfig
import venv
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A new environment with this project's wheel; dependencies come from the environment that runs the tests."""
    folder = tmp_path_factory.mktemp("packaging")
    pip = [sys.executable, "-m", "pip", "--quiet"]
    subprocess.run([*pip, "wheel", "--no-deps", "--wheel-dir", folder, ROOT], check=True, cwd=folder)
    environment = folder / "env"
    venv.create(environment, with_pip=False)
    python = environment / "bin" / "python"
    (wheel,) = folder.glob("rft_ros-*.whl")
    subprocess.run([*pip, "--python", python, "install", "--no-deps", wheel], check=True, cwd=folder)
    (site,) = environment.glob("lib/python3*/site-packages")
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return environment


def run(environment: Path, *command: str, **extra: str) -> subprocess.CompletedProcess[str]:
    variables = {k: v for k, v in os.environ.items() if k not in ("AMENT_PREFIX_PATH", "PYTHONPATH")} | extra
    return subprocess.run(command, capture_output=True, text=True, cwd=environment, env=variables, timeout=120)


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
    for mesh in ("package://rft_ros/meshes/ellipsoid.stl", "ellipsoid"):
        done = run(installed, str(installed / "bin" / "rft"), "check-mesh", mesh, **extra)
        assert done.returncode == 0, done.stderr
        assert str(installed / "share" / "rft_ros") in done.stdout


def test_the_versions_agree():
    manifest = ElementTree.parse(ROOT / "package.xml")
    assert manifest.findtext("name") == "rft_ros"
    assert f'version="{manifest.findtext("version")}"' in (ROOT / "setup.py").read_text(encoding="utf-8")
