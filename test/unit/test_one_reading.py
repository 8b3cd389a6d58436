"""Each path that a parameter or a command takes is read in one place, `rft_ros/files.py`: by reading the source."""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "rft_ros"

READING = {
    *(
        "open",
        "fdopen",
        "FileIO",
        "read_text",
        "read_bytes",
        "load",
        "loadtxt",
        "genfromtxt",
        "fromfile",
        "memmap",
        "mmap",
    ),
    *("safe_load", "load_all", "safe_load_all", "load_mesh", "load_path", "load_scene", "parse", "iterparse"),
    *("ZipFile", "TarFile", "GzipFile", "connect", "Reader", "Reader1", "Reader2", "AnyReader", "make_reader"),
    *("StreamReader", "SeekingReader", "read_csv", "from_xml_path", "copyfile", "copytree"),
    *("resolve", "realpath", "readlink"),  # of a loop of symbolic links: RuntimeError before Python 3.13
}
"""Names of functions and methods that open a file, or follow its links, or whose library does."""

ELSEWHERE = {
    "bags/estimates.py np.memmap": "a file that it made itself",
    "bags/limits.py io.FileIO": "as `Path.open`, within limits; `Recording` has checked the file",
    "bags/limits.py super().open": "as `Path.open`, within limits; `Recording` has checked the file",
    "bags/reading.py LimitedPath(file).open": "a file that `Recording` has checked",
    "bags/reading.py Reader1": "a file that `Recording` has checked; rosbags reads it within limits",
    "bags/reading.py Reader2": "files that `Recording` has checked; rosbags reads them within limits",
    "bags/reading.py StreamReader": "the stream of a file that `Recording` has checked",
    "bags/reading.py reader.open": "the reader's own method, of files that were checked",
    "cli.py os.open": "/dev/null",
    "installation.py Path(__file__).resolve": "the package's own place",
    "node/swap.py worker.load": "asks the worker, which reads as `rft_ros.files` does",
    "parameters/sections.py yaml.parse": "text that `read_text` gave",
    "simulation/six_axis_arm.py (share_directory('rft_ros') / 'config' / 'six_axis_arm.xml').read_text": "shipped",
    "tool/reduction_cache.py file.read_bytes": "the package's own sources",
    "tool/mesh_file.py trimesh.load": "bytes that `read_file` gave",
}
"""Calls that may stand outside, and why: what a user names passes `rft_ros.files` before."""


def readings(source: str) -> Iterator[str]:
    """The calls in a module that read a file or follow its links."""
    tree = ast.parse(source)
    imports = [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module == "rft_ros.files"]
    checked = {alias.name for n in imports for alias in n.names}
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call) or (isinstance(node.func, ast.Name) and node.func.id in checked):
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        modes = [a.value for a in node.args if isinstance(a, ast.Constant) and a.value in ("w", "wb", "x", "xb")]
        if name in READING and not (name == "open" and modes):
            yield ast.unparse(node.func)


def test_no_module_reads_a_file_in_a_second_way():
    found = {
        f"{file.relative_to(PACKAGE)} {call}"
        for file in sorted(PACKAGE.rglob("*.py"))
        if file not in (PACKAGE / "files.py", PACKAGE / "rft" / "kernel" / "compilation.py")  # sources, numba's cache
        for call in readings(file.read_text(encoding="utf-8"))
    }
    new = found - ELSEWHERE.keys()
    assert not new, f"read it with rft_ros.files: {new}"


def test_a_reading_of_any_kind_is_found():
    for call in ("open(p)", "p.open()", "Path(p).read_text()", "np.load(p)", "np.loadtxt(p)", "trimesh.load(p)"):
        assert [*readings(f"def f(p):\n    return {call}\n")], call
    for call in ("yaml.safe_load(p)", "Reader(p)", "p.resolve()", "zipfile.ZipFile(p)", "sqlite3.connect(p)"):
        assert [*readings(f"x = [{call}]\n")], call
    assert not [*readings("with whole(p) as part, part.open('wb') as out:\n    pass\n")]
