"""Size and plainness of the Python code by folder: ``make lines``.

Files, code lines, tokens, tokens a line, tuple assignments, loose constants and bare bindings. Comments, docstrings and
blank lines do not count. Python 3.12 and later divide an f-string into more tokens.
"""

import ast
import re
import tokenize
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

_LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}
_AXES = re.compile(r"[xyzwuvstijk0-9]")  # also of meshes and matrices


def _words(text: str) -> frozenset[str]:
    return frozenset(text.split())


_UNITS = _words(
    "M MM CM KM S MS US NS HZ N NM KG G RAD DEG PT2 PX BYTES MIB PA W J K"
    " RATIO SHARE FACTOR COUNT CELLS PERCENT DIGITS RANK LIMIT"
)
"""Last words of the names of constants that say a unit, or that there is none."""

_PREPOSITIONS = _words(
    "above across after along around at before behind below beside between beyond by from in into near of on over per"
    " to under with without"
)
_LINKS = _words("by from of with without")
"""Prepositions that refer to a name that stands elsewhere, as `of_role` does."""

_PARTICIPLES = _words(
    "begun bent built chosen done drawn felt found given gone grown held kept known left lost made meant met said seen"
    " sent shown spent taken thrown told worn written"
)
_NOUNS_IN_ED = _words("bed feed need seed shed speed")
_DETERMINERS = _words("alike few other others own same")


@dataclass
class Size:
    """Size of a part of the code."""

    files: int = 0
    lines: int = 0
    tokens: int = 0
    tuples: int = 0
    loose: int = 0
    bare: int = 0

    def add(self, source: str) -> None:
        """Count a module."""
        rows = [token.start[0] for token in _code(source)]
        self.files += 1
        self.lines += len(set(rows))
        self.tokens += len(rows)
        self.tuples += sum(
            isinstance(assignment.value, ast.Tuple) for assignment in _to_tuples(source)
        )
        self.loose += len(loose_constants(source))
        self.bare += len(bare_bindings(source))

    def row(self, name: str) -> str:
        """A row of the table."""
        density = self.tokens / self.lines
        size = f"{name:20} {self.files:5} {self.lines:7,} {self.tokens:8,} {density:12.1f} {self.tuples:8}"
        return f"{size} {self.loose:7,} {self.bare:7,}"


def dense_assignments(source: str) -> list[str]:
    """The assignments of a module that set several things: to attributes, or of several values to unlike names.

    Like names are equal but for letters of axes and digits, as `x, y, z`, `force_x, force_y` and `e1, e2`. Names that
    one value is unpacked to may be unlike.
    """
    dense = filter(_is_dense, _to_tuples(source))
    return [ast.get_source_segment(source, assignment) or "" for assignment in dense]


def loose_constants(source: str) -> list[str]:
    """The numbers that a module binds at its top level by names without a unit, such as `_LEAST` beside `MIN_FORCE_N`.

    A number is a literal, or arithmetic of literals. Fields of classes do not count: a sentence describes each.
    """
    found = []
    for statement in ast.parse(source).body:
        for target, value in _bound_values(statement):
            if _is_number(value) and target.rpartition("_")[2] not in _UNITS:
                found.append(target)
    return found


def _bound_values(statement: ast.stmt) -> Iterator[tuple[str, ast.expr]]:
    """The names that a statement binds, each with its value."""
    targets: list[ast.expr] = []
    value = None
    if isinstance(statement, ast.Assign):
        targets = statement.targets
        value = statement.value
    elif isinstance(statement, ast.AnnAssign):
        targets = [statement.target]
        value = statement.value
    for target in targets:
        if isinstance(target, ast.Name) and value is not None:
            yield target.id, value
        elif isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
            for one, its_value in zip(target.elts, value.elts, strict=True):
                if isinstance(one, ast.Name):
                    yield one.id, its_value


def _is_number(value: ast.expr) -> bool:
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) and _is_number(value.right)
    return isinstance(value, ast.Constant) and type(value.value) in (int, float)


def bare_bindings(source: str) -> list[str]:
    """The variables and arguments of a module whose names have no noun, each as often as it is bound.

    Such a name consists of participles, prepositions and determiners (`told`, `left`, `own`, `few`), or begins with a
    preposition that refers to another name (`of_role`, `with_sigma`).
    """
    names = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.append(node.id)
        elif isinstance(node, ast.arg):
            names.append(node.arg)
    return [name for name in names if _is_bare(name)]


def _is_bare(name: str) -> bool:
    words = [word for word in name.lower().split("_") if word]
    if len(words) > 1 and words[0] in _LINKS:
        return True
    return bool(words) and all(map(_is_no_noun, words))


def _is_no_noun(word: str) -> bool:
    if word.endswith("ed"):
        return word not in _NOUNS_IN_ED
    return word in _PARTICIPLES | _PREPOSITIONS | _DETERMINERS


def _code(source: str) -> Iterator[tokenize.TokenInfo]:
    """The tokens of a module without layout, comments and docstrings."""
    in_docstrings: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            in_docstrings.update(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    lines = iter(source.splitlines(keepends=True))
    for token in tokenize.generate_tokens(lambda: next(lines, "")):
        if token.type not in _LAYOUT and token.start[0] not in in_docstrings:
            yield token


def _to_tuples(source: str) -> Iterator[ast.Assign]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple):
            yield node


def _is_dense(assignment: ast.Assign) -> bool:
    (*_, target) = assignment.targets
    if any(isinstance(node, ast.Attribute) for node in ast.walk(target)):
        return True
    if not isinstance(assignment.value, ast.Tuple) or not isinstance(target, ast.Tuple):
        return False
    names = [one.id if isinstance(one, ast.Name) else "" for one in target.elts]
    return "" in names or len({_AXES.sub("0", name) for name in names}) > 1


def main() -> None:
    """Print the table."""
    sizes = defaultdict[str, Size](Size)
    for top in ("rft_ros", "studies", "test", "bench"):
        for file in (ROOT / top).rglob("*.py"):
            source = file.read_text(encoding="utf-8")
            sizes[top].add(source)
            if top == "rft_ros":
                parts = file.relative_to(ROOT).parts
                sizes[f"  {parts[1]}/" if len(parts) > 2 else "  modules"].add(source)
    print(f"{'':20} files   lines   tokens  tokens/line   tuples   loose    bare")
    for name, size in sorted(sizes.items(), key=lambda item: -item[1].tokens):
        print(size.row(name))


if __name__ == "__main__":
    main()
