"""Each path that a parameter or a command takes is read in one place, `rft_ros/files.py`: by reading the source."""

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[2] / "rft_ros"

READING = {
    *("open", "fdopen", "FileIO", "read_text", "read_bytes", "load", "loadtxt", "genfromtxt", "fromfile"),
    *("memmap", "mmap"),
    *("safe_load", "load_all", "safe_load_all", "load_mesh", "load_path", "load_scene", "parse", "iterparse"),
    *("ZipFile", "TarFile", "GzipFile", "connect", "Reader", "Reader1", "Reader2", "AnyReader", "make_reader"),
    *("open_memmap", "BZ2File", "LZMAFile", "copyfileobj", "imread", "getlines", "run_path"),
    *("StreamReader", "SeekingReader", "read_csv", "from_xml_path", "copyfile", "copytree"),
    *("resolve", "realpath", "readlink"),  # of a loop of symbolic links: RuntimeError before Python 3.13
}
"""Names of functions and methods that open a file, or follow its links, or whose library does."""

ELSEWHERE = {
    "bags/estimates.py np.memmap": "a file that it made itself",
    "bags/limits.py io.FileIO": "as `Path.open`, within limits; `sources_of` has checked the file",
    "bags/limits.py super().open": "as `Path.open`, within limits; `sources_of` has checked the file",
    "bags/limits.py file.open": "a file that `sources_of` has checked, unpacked within limits",
    "bags/sources.py LimitedPath(file).open": "a file that `sources_of` has checked",
    "bags/sources.py Reader1": "a file that `sources_of` has checked; rosbags reads it within limits",
    "bags/sources.py Reader2": "files that `sources_of` has checked; rosbags reads them within limits",
    "bags/sources.py StreamReader": "the stream of a file that `sources_of` has checked",
    "bags/sources.py reader.open": "the reader's own method, of files that were checked",
    "bags/sources.py shutil.copyfile": "a database that `sources_of` has checked, and the regular files beside it",
    "bags/sources.py sqlite3.connect": "a copy that it made itself",
    "cli.py os.open": "/dev/null",
    "installation.py Path(__file__).resolve": "the package's own place",
    "node/tool_worker.py Path(f'/proc/{self.process.pid}/stat').read_text": "the system's word on a process",
    "node/swap.py self._worker.load": "asks the worker, which reads as `rft_ros.files` does",
    "node/swap.py worker.load": "asks the worker, which reads as `rft_ros.files` does",
    "parameters/from_values.py _PARTS[name].load": "functions of the package, which read as `rft_ros.files` does",
    "parameters/sections.py yaml.parse": "text that `read_text` gave",
    "tool/reduction_cache.py file.read_bytes": "the package's own sources",
    "tool/mesh_file.py trimesh.load": "bytes that `read_file` gave",
}
"""Calls that may stand outside, and why: what a user names passes `rft_ros.files` before."""


def readings(source: str) -> Iterator[str]:
    """What in a module reads a file or follows its links: functions and methods that are called or passed on."""
    tree = ast.parse(source)
    imported = [n for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) and n.module != "rft_ros.files"]
    read = {alias.asname or alias.name for n in imported for alias in n.names if alias.name in READING} | {"open"}
    called = {n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    checked = {a.name for n in ast.walk(tree) if isinstance(n, ast.ImportFrom) for a in n.names} - read
    names = read | (called & READING) - checked
    writing = {id(n.func) for n in ast.walk(tree) if isinstance(n, ast.Call) and _opens_for_writing(n)}
    functions = {id(n.func) for n in ast.walk(tree) if isinstance(n, ast.Call)} - writing
    modules = {a.asname or a.name for n in ast.walk(tree) if isinstance(n, ast.Import) for a in n.names} | {"Path"}
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and node.attr in READING:
            passed_on = isinstance(node.value, ast.Name) and node.value.id in modules and id(node) not in writing
            if passed_on or id(node) in functions:
                yield ast.unparse(node)
        if (
            isinstance(node, ast.Name)
            and isinstance(node.ctx, ast.Load)
            and node.id in names
            and id(node) not in writing
        ):
            yield node.id


def _opens_for_writing(call: ast.Call) -> bool:
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    return name == "open" and any(isinstance(a, ast.Constant) and a.value in ("w", "wb", "x", "xb") for a in call.args)


def test_no_module_reads_a_file_in_a_second_way():
    found = {
        f"{file.relative_to(PACKAGE)} {call}"
        for file in sorted(PACKAGE.rglob("*.py"))
        if file not in (PACKAGE / "files.py", PACKAGE / "rft" / "kernel" / "compilation.py")  # sources, numba's cache
        for call in readings(file.read_text(encoding="utf-8"))
    }
    new, gone = found - ELSEWHERE.keys(), ELSEWHERE.keys() - found
    assert not new, f"read it with rft_ros.files: {new}"
    assert not gone, f"these exceptions are no longer needed: {gone}"


def test_a_reading_of_any_kind_is_found():
    for call in ("open(p)", "p.open()", "Path(p).read_text()", "np.load(p)", "np.loadtxt(p)", "trimesh.load(p)"):
        assert [*readings(f"def f(p):\n    return {call}\n")], call
    for call in ("yaml.safe_load(p)", "Reader(p)", "p.resolve()", "zipfile.ZipFile(p)", "sqlite3.connect(p)"):
        assert [*readings(f"x = [{call}]\n")], call
    for passed_on in ("map(open, paths)", "map(Path.read_text, paths)", "partial(np.load, p)"):
        assert [*readings(f"import numpy as np\nx = {passed_on}")], passed_on
    assert [*readings("from numpy import load as numbers\nx = numbers(p)\n")]
    assert not [*readings("def load(p):\n    return p\nx = [load]\n")]
    assert not [*readings("with whole(p) as part, part.open('wb') as out:\n    pass\n")]
