"""Arrows between packages point one way, and only the node imports ROS (docs/architecture.md)."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[2] / "rft_ros"
ALLOWED = {
    "errors": "",
    "child_process": "",
    "progress": "",
    "rft": "",
    "files": "errors",
    "installation": "errors",
    "table_file": "files errors",
    "yaml_file": "files errors",
    "messages": "estimator ground",
    "logged_columns": "messages rft errors table_file",
    "states_file": "logged_columns messages estimator parameters files rft errors table_file",
    "tool": "files installation rft errors",
    "ground": "files rft errors table_file",
    "parameters": "ground tool rft errors files table_file yaml_file",
    "estimator": "parameters ground tool rft child_process errors",
    "simulation": "files ground tool rft errors installation",
    "report": "parameters files ground tool rft errors",
    "bags": "diagnosis messages estimator parameters ground tool rft report errors progress files states_file"
    " logged_columns table_file yaml_file",
    "calibration": "diagnosis files bags estimator parameters ground tool rft errors yaml_file",
    "sweeps": "parameters tool rft states_file installation progress errors files yaml_file",
    "node": "messages bags estimator parameters ground tool rft report files installation child_process"
    " progress errors",
    "diagnosis": "estimator parameters tool rft",
    "doctor": "diagnosis node bags messages estimator parameters ground tool rft files installation progress errors",
    "demo": "node bags estimator parameters simulation sweeps tool rft files errors",
    "commands": "doctor diagnosis demo bags estimator parameters tool rft report errors states_file calibration sweeps"
    " logged_columns progress installation files",
    "cli": "commands installation files progress errors",
}
ROS = re.compile(
    r"(rclpy|rcl_interfaces|std_srvs|builtin_interfaces|rosgraph_msgs|launch|\w+_msgs)(\.|$)"
)


@pytest.fixture(scope="module")
def imports():
    """Of each module of the package: the part of the package that it is in, and the names that it imports."""
    found = {}
    for file in sorted(PACKAGE.rglob("*.py")):
        names = set()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                names |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        found[file] = file.relative_to(PACKAGE).parts[0].removesuffix(".py"), names
    return {file: found[file] for file in found if file != PACKAGE / "__init__.py"}


def test_a_package_imports_only_what_lies_below_it(imports):
    for file, (own, names) in imports.items():
        used = {name.split(".")[1] for name in names if name.startswith("rft_ros.")}
        assert used - {own} <= set(ALLOWED[own].split()), file


def modules_imported(file, modules):
    """The modules of the package, by name with dots, that a file imports anywhere, also for types only."""
    found = set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        for name in names:  # of a name in a module, the module
            found.add(name if name in modules else name.rpartition(".")[0])
    return found & modules


def test_no_module_imports_itself_by_way_of_others():
    files = {
        ".".join(f.relative_to(PACKAGE.parent).with_suffix("").parts): f
        for f in PACKAGE.rglob("*.py")
    }
    files = {name.removesuffix(".__init__"): file for name, file in files.items()}
    del files["rft_ros"]  # it imports a module when one of its names is used
    left = {name: modules_imported(file, files.keys()) - {name} for name, file in files.items()}
    while free := {name for name, imported in left.items() if not imported & left.keys()}:
        left = {name: imported for name, imported in left.items() if name not in free}
    assert not left, "these modules, or some of them, import one another in a circle"


def drawn_arrows():
    """Of the picture of the packages: each arrow as the package that imports and the one that is imported."""
    picture = PACKAGE.parent / "docs" / "images" / "architecture_packages.svg"
    ends = re.findall(
        r'data-from="([^"]+)" data-to="([^"]+)"', picture.read_text(encoding="utf-8")
    )
    return {
        (importer, imported)
        for many, fewer in ends
        for importer in many.split()
        for imported in fewer.split()
    }


def test_every_import_between_packages_follows_from_the_arrows_of_their_picture(imports):
    folders = {folder.name for folder in PACKAGE.iterdir() if (folder / "__init__.py").is_file()}
    real = {
        (own, name.split(".")[1])
        for own, names in imports.values()
        for name in names
        if own in folders and name.startswith("rft_ros.") and name.split(".")[1] in folders - {own}
    }
    arrows = drawn_arrows()
    assert arrows <= real
    ways = set(arrows)
    while longer := {(a, d) for a, b in ways for c, d in arrows if b == c} - ways:
        ways |= longer
    assert real <= ways, "draw what is missing in docs/images/architecture_packages.svg"


def test_only_the_node_imports_ros(imports):
    for file, (own, names) in imports.items():
        assert own == "node" or not any(map(ROS.match, names)), file


def test_only_one_module_compiles_so_that_all_machine_code_has_its_cache(imports):
    compiler = re.compile(r"numba\.(n?jit|cfunc|vectorize|guvectorize|stencil)$")
    files = [file.name for file, (_, names) in imports.items() if any(map(compiler.match, names))]
    by_attribute = [
        f.name for f in imports if re.search(r"numba\.n?jit\(", f.read_text(encoding="utf-8"))
    ]
    assert {*files, *by_attribute} == {"compilation.py"}


def test_package_and_command_work_without_ros_and_load_no_mesh_library(tmp_path):
    for name in ("rclpy", "geometry_msgs", "rcl_interfaces"):
        (tmp_path / f"{name}.py").write_text(f"raise ImportError('no {name}', name='{name}')\n")
    code = (
        "import sys; sys.path.insert(0, sys.argv.pop(1))\n"
        "from rft_ros.cli import main\n"
        "assert main([]) == 2 and 'numba' not in sys.modules\n"
        "import rft_ros.rft, rft_ros.tool, rft_ros.estimator, rft_ros.bags.replay\n"
        "assert 'trimesh' not in sys.modules\n"
        "assert main(['check-mesh', 'plate']) == 0\n"
        "assert main(['demo', '-o', 'out']) == 2\n"
        "from rft_ros.node.main import main\n"
        "sys.exit(main())\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == 2
    for program in ("rft demo: ", "rft_node: "):
        (line,) = (line for line in done.stderr.splitlines() if line.startswith(program))
        assert "ROS 2" in line
        assert "source a ROS 2 setup file" in line
    assert "pip install" in done.stderr
    assert "Traceback" not in done.stderr


def test_public_names_are_listed_at_the_doors_of_the_packages():
    modules = [file for file in PACKAGE.rglob("*.py") if file.name != "__init__.py"]
    assert [file for file in modules if "__all__" in file.read_text(encoding="utf-8")] == []
