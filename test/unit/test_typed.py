"""Every function has annotations, except those that numba compiles, for which mypy's `no-untyped-def` is off."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
CHECKED = ("rft_ros", "studies", "bench", "meshes", "docs/_site")
COMPILERS = {"compiled", "inlined", "intrinsic", "overload"}
"""Decorators of functions that numba compiles, and functions that return one compiled."""


def untyped(source: str) -> Iterator[str]:
    """The functions of a module that lack an annotation and are not compiled."""
    tree = ast.parse(source)
    calls = [
        n for n in ast.walk(tree) if isinstance(n, ast.Call) and ast.unparse(n.func) in COMPILERS
    ]
    compiled = {a.id for call in calls for a in call.args if isinstance(a, ast.Name)}
    models = [
        n.value
        for n in tree.body
        if isinstance(n, ast.AnnAssign) and ast.unparse(n.target) == "_MODELS"
    ]
    compiled |= {
        n.id for value in models if value for n in ast.walk(value) if isinstance(n, ast.Name)
    }
    yield from _untyped_in(tree, compiled)


def _untyped_in(parent: ast.AST, compiled: set[str]) -> Iterator[str]:
    for node in ast.iter_child_nodes(parent):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            decorators = {ast.unparse(d).partition("(")[0] for d in node.decorator_list}
            if node.name in compiled or decorators & COMPILERS:
                continue
            a = node.args
            arguments = [
                *a.posonlyargs,
                *a.args,
                *a.kwonlyargs,
                *filter(None, (a.vararg, a.kwarg)),
            ]
            bare = [
                x.arg for x in arguments if x.annotation is None and x.arg not in ("self", "cls")
            ]
            if bare or node.returns is None:
                yield node.name
        yield from _untyped_in(node, compiled)


@pytest.mark.parametrize("folder", CHECKED)
def test_every_function_that_numba_does_not_compile_has_annotations(folder):
    found = {
        str(file): [*untyped(file.read_text(encoding="utf-8"))]
        for file in sorted((ROOT / folder).rglob("*.py"))
    }
    assert {file: names for file, names in found.items() if names} == {}


def test_a_function_without_annotations_is_found():
    source = "@compiled\ndef a(x):\n    pass\ndef b(x):\n    pass\nB = compiled(b)\ndef c(x) -> None:\n    pass\n"
    assert [*untyped(source + "class D:\n    def e(self):\n        pass\n")] == ["c", "e"]
