"""package.xml, setup.py, the constraint files and the command for a robot name the same packages and agree."""

import re
import runpy

import pytest
import setuptools
from distribution import ROOT, manifest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

pytestmark = pytest.mark.repository

# The package on PyPI that Ubuntu's package of this key is.
OF_KEY = {
    "python3-collada": "pycollada",
    "python3-hypothesis": "hypothesis",
    "python3-matplotlib": "matplotlib",
    "python3-numpy": "numpy",
    "python3-pytest": "pytest",
    "python3-rich": "rich",
    "python3-scipy": "scipy",
    "python3-yaml": "pyyaml",
}
NO_KEY = {"pytest-xdist"}  # the Jazzy workflow installs Ubuntu's
BROUGHT = {"distributed", "pyparsing"}  # by dask and matplotlib
NO_WHEEL = {"matplotlib": Version("3.6.3")}  # of Ubuntu 24.04's version for its Python


def pinned(name: str) -> dict[str, Version]:
    """Packages and their versions in a constraint file."""
    lines = (ROOT / "constraints" / name).read_text(encoding="utf-8").splitlines()
    pairs = [line.split("==") for line in lines if line and not line.startswith("#")]
    return {canonicalize_name(package): Version(version) for package, version in pairs}


@pytest.fixture
def setup(monkeypatch):
    """The arguments of setup.py's call."""
    calls = []
    monkeypatch.setattr(setuptools, "setup", lambda **arguments: calls.append(arguments))
    monkeypatch.chdir(ROOT)
    runpy.run_path("setup.py")
    (arguments,) = calls
    return arguments


def requirements(lines: list[str]) -> dict[str, Requirement]:
    return {canonicalize_name(r.name): r for r in map(Requirement, lines)}


@pytest.fixture
def required(setup):
    """What the package and its tests require, by name."""
    return requirements([*setup["install_requires"], *setup["extras_require"]["test"]])


@pytest.fixture
def least(required):
    """The least version of each package that has one."""
    return {
        name: Version(bound.version)
        for name, requirement in required.items()
        for bound in requirement.specifier
        if bound.operator == ">="
    }


def test_the_least_versions_that_are_tested_are_those_of_setup_py(least):
    tested = pinned("minimum.txt")
    assert {name: tested[name] for name in tested.keys() - BROUGHT} == least


def test_what_package_xml_takes_from_apt_has_its_version_on_ubuntu():
    package, _ = manifest()
    keys = {d.name for d in [*package.exec_depends, *package.test_depends]}
    from_apt = {key for key in keys if key.startswith("python3-") and not key.endswith("-pip")}
    assert from_apt == OF_KEY.keys()
    assert pinned("ubuntu-24.04.txt").keys() - BROUGHT == {*OF_KEY.values(), *NO_KEY}


def test_setup_py_asks_for_no_newer_version_than_ubuntu_has(required, least):
    for name, version in pinned("ubuntu-24.04.txt").items():
        if name not in BROUGHT:
            assert required[name].specifier.contains(version), name
            assert least[name] <= NO_WHEEL.get(name, version), name


@pytest.mark.parametrize("file", ["README.md", ".github/workflows/jazzy.yml"])
def test_a_robot_gets_from_pip_what_it_does_not_get_from_apt(file, setup):
    text = (ROOT / file).read_text(encoding="utf-8")
    (line,) = re.findall(r"pip install --break-system-packages (.+)", text)
    by_pip = requirements(line.replace("'", "").split())
    needed = requirements(setup["install_requires"]).keys()
    assert by_pip.keys() - {"numpy"} == needed - set(OF_KEY.values())
    assert by_pip["numpy"].specifier.contains(pinned("ubuntu-24.04.txt")["numpy"])
