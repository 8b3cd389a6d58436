"""Lines by package: ``python bench/lines.py`` prints the table of docs/architecture.md."""

import io
import tokenize
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_NOT_INSTALLED = ("studies", "test", "bench")
_NOT_CODE = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def code_lines(text: str) -> int:
    """Lines with more than a comment or a docstring."""
    lines: set[int] = set()
    statement: list[tokenize.TokenInfo] = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NEWLINE:
            if any(t.type != tokenize.STRING for t in statement):
                lines |= {n for t in statement for n in range(t.start[0], t.end[0] + 1)}
            statement = []
        elif token.type not in _NOT_CODE:
            statement.append(token)
    return len(lines)


def packages() -> dict[str, Counter[str]]:
    """Files, lines and lines of code of each package, and of each folder that is not installed."""
    counted: dict[str, Counter[str]] = {}
    for folder in ("rft_ros", *_NOT_INSTALLED):
        for file in sorted((ROOT / folder).rglob("*.py")):
            inside = file.relative_to(ROOT).parts
            name = folder if folder != "rft_ros" else f"{inside[1]}/" if len(inside) > 2 else "single modules"
            text = file.read_text(encoding="utf-8")
            counted.setdefault(name, Counter()).update(files=1, lines=len(text.splitlines()), code=code_lines(text))
    return counted


def table() -> str:
    """The packages as a table: installed ones, their sum, then the rest."""
    counted = packages()
    rest = {name: counted.pop(name) for name in _NOT_INSTALLED if name in counted}
    installed = sum(counted.values(), Counter())
    rows = [*sorted(counted.items(), key=lambda row: -row[1]["lines"]), ("**rft_ros**", installed), *rest.items()]
    head = ["| package | files | lines | of code |", "|---|---|---|---|"]
    return "\n".join([*head, *(f"| {name} | {n['files']:,} | {n['lines']:,} | {n['code']:,} |" for name, n in rows)])


if __name__ == "__main__":
    print(table())
