"""package.xml and CHANGELOG.rst, which ROS tools read, agree with the project."""

import re
from xml.etree import ElementTree

import pytest
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
