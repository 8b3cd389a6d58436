"""`python -m pydoc` explains every public name of the package."""

import ast
import importlib
import inspect
import pkgutil
import pydoc
import re
from pathlib import Path

import rft_ros
import rft_ros.rft

ROS = ("rft_ros.node.",)
MODULES = sorted(
    m.name
    for m in pkgutil.walk_packages(rft_ros.__path__, "rft_ros.")
    if not m.name.startswith(ROS) and not m.name.endswith("__main__")
)

ARRAYS = re.compile(r"NDArray|ndarray|ArrayLike|\bArray\b")  # NumPy 2.5 prints NDArray, older ones ndarray
UNIT = re.compile(r"\[(s|m|m²|m³|m/s|rad|rad/s|deg|N|N m|N/m²|N/m³|N/cm³)\b|\[m, m²\]|\bunits?\b|no unit")
SHAPE = re.compile(r"[Ss]hape")

EQUATIONS = {
    "media.Medium": 4,
    "velocity_weights.f1": 5,
    "velocity_weights.exact_f1": 5,
    "velocity_weights.f23": 6,
    "velocity_weights.exact_f23": 6,
    "media.Medium.alpha_x_flat": 7,
    "traction.traction_per_depth": 8,
    "traction.treers2021": 8,
    "wrench.wrenches": 9,
    "wrench.plate_forces": 9,
}


def explained(name):
    """Public functions, classes, methods and properties defined in a module, by dotted name."""
    module = importlib.import_module(name)
    found = {}
    for public in getattr(module, "__all__", ()):
        thing = getattr(module, public)
        if not (inspect.isclass(thing) or callable(thing)) or getattr(thing, "__module__", None) != name:
            continue
        found[public] = thing
        for member, value in vars(thing).items() if inspect.isclass(thing) else ():
            if isinstance(value, classmethod | staticmethod):
                value = value.__func__
            if not member.startswith("_") and (inspect.isfunction(value) or isinstance(value, property)):
                found[f"{public}.{member}"] = value
    return found


def signature(thing):
    thing = thing.fget if isinstance(thing, property) else thing
    return " ".join(str(a) for a in getattr(thing, "__annotations__", {}).values())


def test_every_module_and_public_name_has_a_docstring():
    bare = [name for name in MODULES if not importlib.import_module(name).__doc__]
    bare += [f"{m}.{n}" for m in MODULES for n, thing in explained(m).items() if not (thing.__doc__ or "").strip()]
    assert bare == []


def undocumented_constants(name):
    """Public constants without a string below, a comment beside, or a mention in the module's docstring."""
    module = importlib.import_module(name)
    source = Path(module.__file__).read_text()
    bare, waiting = [], set()
    for node in [*ast.parse(source).body, None]:
        if isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = {n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)}
            beside = "#" in "\n".join(source.splitlines()[node.lineno - 1 : node.end_lineno])
            waiting |= set() if beside else names & set(getattr(module, "__all__", ()))
            continue
        said = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        bare += [] if said else [f"{name}.{n}" for n in sorted(waiting) if n not in module.__doc__]
        waiting = set()
    return bare


def test_public_constants_are_documented():
    assert [c for m in MODULES if m != "rft_ros.rft.alpha_y" for c in undocumented_constants(m)] == []


def test_functions_of_arrays_document_shapes_and_units():
    for name in MODULES:
        for dotted, thing in explained(name).items():
            if ARRAYS.search(signature(thing)):
                assert SHAPE.search(thing.__doc__), f"{name}.{dotted} names no shape"
                assert UNIT.search(thing.__doc__), f"{name}.{dotted} names no unit"


def test_functions_that_compute_an_equation_of_the_method_cite_it():
    for dotted, number in EQUATIONS.items():
        module, _, names = dotted.partition(".")
        assert f"Eq. ({number})" in explained(f"rft_ros.rft.{module}")[names].__doc__, dotted


def test_pydoc_of_the_core_reads_like_the_method_with_its_equations_in_order():
    page = pydoc.plain(pydoc.render_doc(rft_ros.rft)).partition("PACKAGE CONTENTS")[0]
    numbers = [int(n) for n in re.findall(r"  Eq\. \((\d+)\)\n", page)]
    assert numbers == list(range(1, 13))
    assert max(len(line) for line in page.splitlines()) <= 124


def test_every_name_that_the_method_mentions_exists():
    names = re.findall(r"`([A-Za-z_][\w.]*)`", rft_ros.rft.__doc__)
    assert len(names) > 25
    for name in names:
        thing = rft_ros.rft
        for part in name.split("."):
            thing = getattr(thing, part)


def test_the_method_s_equations_are_cited_by_numbers_that_there_are():
    for file in Path(rft_ros.rft.__file__).parent.glob("*.py"):
        for number in re.findall(r"Eqs?\. \((\d+)\)", file.read_text()):
            assert 1 <= int(number) <= 12, file


def test_compiled_functions_show_their_docstrings_in_help():
    from rft_ros.rft import velocity_weights

    page = pydoc.plain(pydoc.render_doc(velocity_weights))
    assert "f1(u: float) -> float\n        Rational `exact_f1`" in page
