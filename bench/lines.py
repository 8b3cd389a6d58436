"""Size of the Python code by folder: files, code lines, tokens, tokens a line, tuple assignments: ``make lines``.

Comments, docstrings and blank lines do not count. Python 3.12 and later divide an f-string into more tokens.
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


@dataclass
class Size:
    """Size of a part of the code."""

    files: int = 0
    lines: int = 0
    tokens: int = 0
    tuples: int = 0

    def add(self, source: str) -> None:
        """Count a module."""
        rows = [token.start[0] for token in _code(source)]
        self.files += 1
        self.lines += len(set(rows))
        self.tokens += len(rows)
        self.tuples += sum(
            isinstance(assignment.value, ast.Tuple) for assignment in _to_tuples(source)
        )

    def row(self, name: str) -> str:
        """A row of the table."""
        density = self.tokens / self.lines
        return f"{name:20} {self.files:5} {self.lines:7,} {self.tokens:8,} {density:12.1f} {self.tuples:8}"


def dense_assignments(source: str) -> list[str]:
    """The assignments of a module that set several things: to attributes, or of several values to unlike names.

    Like names are equal but for letters of axes and digits, as `x, y, z`, `force_x, force_y` and `e1, e2`. Names that
    one value is unpacked to may be unlike.
    """
    dense = filter(_is_dense, _to_tuples(source))
    return [ast.get_source_segment(source, assignment) or "" for assignment in dense]


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
    print(f"{'':20} files   lines   tokens  tokens/line   tuples")
    for name, size in sorted(sizes.items(), key=lambda item: -item[1].tokens):
        print(size.row(name))


if __name__ == "__main__":
    main()
