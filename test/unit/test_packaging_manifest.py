"""package.xml, CHANGELOG.rst and the workflows, which ROS tools and GitHub read, agree with the project."""

import re
from xml.etree import ElementTree

import pytest
import yaml
from distribution import ROOT, manifest, third_party_imports

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
EXTRAS = {"distributed", "mujoco"}


def test_the_manifest_is_valid_without_warnings():
    package, warnings = manifest()
    assert warnings == []
    assert (package.name, package.package_format, package.get_build_type()) == ("rft_ros", 3, "ament_python")
    assert package.licenses == ["Apache-2.0"]
    assert "Apache License" in (ROOT / "LICENSE").read_text(encoding="utf-8")


def test_the_manifests_elements_are_in_the_order_of_its_schema():
    """catkin_pkg takes any order; package_format3.xsd, and so ament_xmllint, does not."""
    order = ["name", "version", "description", "maintainer", "license", "url", "author", "depend", "export"]
    root = ElementTree.parse(ROOT / "package.xml").getroot()
    places = [order.index(re.sub(r"^[a-z]+_depend$", "depend", element.tag)) for element in root]
    assert places == sorted(places)
    assert {"name", "version", "description", "maintainer", "license"} <= {element.tag for element in root}


def test_each_dependency_is_imported_and_each_import_is_a_dependency():
    package, _ = manifest()
    keys = {d.name for d in package.exec_depends}
    imported = third_party_imports()
    own = imported - NO_KEY_ON_NOBLE - EXTRAS - {"llvmlite"}  # numba brings it
    assert {MODULES.get(key, key) for key in keys} == own | {"collada"}  # by which trimesh reads DAE


def test_dependencies_without_a_rosdep_key_are_listed_for_installation_by_pip():
    names = {name.replace("_", "-") for name in NO_KEY_ON_NOBLE}
    comments = " ".join(
        re.findall(r"<!--(.*?)-->", (ROOT / "package.xml").read_text(encoding="utf-8"), flags=re.DOTALL)
    )
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    (by_hand,) = re.findall(r"pip install --break-system-packages (.+)", readme)
    for name in names:
        assert name in comments
        assert name in by_hand


@pytest.mark.filterwarnings("ignore::DeprecationWarning:catkin_pkg")
def test_the_changelog_can_be_released_by_ros_tools(tmp_path):
    from catkin_pkg.changelog import get_changelog_from_path
    from catkin_pkg.package_version import get_forthcoming_label, update_changelog_sections

    package, _ = manifest()
    ours = get_changelog_from_path(str(ROOT), package.name)
    label = get_forthcoming_label(ours.rst)
    update_changelog_sections({package.name: (tmp_path / "CHANGELOG.rst", ours, label)}, package.version)
    released = get_changelog_from_path(str(tmp_path), package.name)
    assert released.package_name == package.name
    assert [version for version, _, _ in released.foreach_version()] == [package.version]
    (changes,) = released.get_content_of_version(package.version)
    assert len(changes.bullets) >= 10


def workflow_commands() -> list[str]:
    commands = []
    for file in sorted((ROOT / ".github" / "workflows").glob("*.yml")):
        for job in yaml.safe_load(file.read_text(encoding="utf-8"))["jobs"].values():
            commands += [line.strip() for step in job["steps"] for line in step.get("run", "").splitlines()]
    return commands


def test_workflows_run_targets_and_files_that_exist():
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), flags=re.MULTILINE))
    commands = workflow_commands()
    made = {word for line in commands if line.startswith("make ") for word in line.split()[1:] if "=" not in word}
    assert "test" in made
    assert made <= targets
    for path in re.findall(r"(?<![\w/.])(?:test|scripts|launch|\.ci)/[\w./-]+", " ".join(commands)):
        assert (ROOT / path).exists(), path


def test_workflows_try_every_python_that_the_readme_promises():
    matrix = yaml.safe_load((ROOT / ".github" / "workflows" / "pypi.yml").read_text(encoding="utf-8"))
    pythons = matrix["jobs"]["test"]["strategy"]["matrix"]["python"]
    first, last = re.search(r"Python 3\.(\d+)–3\.(\d+)", (ROOT / "README.md").read_text(encoding="utf-8")).groups()
    assert pythons == [f"3.{minor}" for minor in range(int(first), int(last) + 1)]
