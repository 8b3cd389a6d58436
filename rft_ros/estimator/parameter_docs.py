"""``python -m rft_ros.estimator.parameter_docs``: write config/default.yaml and the README's table."""

import math
from pathlib import Path

from rft_ros.estimator.parameters import PARAMETERS, Parameter, Value

__all__ = ["BEGIN", "END", "default_yaml", "main", "markdown_table"]

BEGIN, END = "<!-- parameters: begin (generated) -->\n", "<!-- parameters: end -->\n"
"""The marks between which a table is written."""


def _yaml(value: Value) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _allowed(p: Parameter) -> str:
    if p.choices:
        return ", ".join(p.choices)
    if math.isinf(p.low):
        return ""
    return f"{p.low:g} to {p.high:g}"


def default_yaml() -> str:
    """A parameter file that holds every parameter at its default, with its description."""
    lines = [
        "# Every parameter of rft_node at its default; made by python -m rft_ros.estimator.parameter_docs",
        "/**:",
        "  ros__parameters:",
    ]
    for p in PARAMETERS:
        unit = f" [{p.unit}]" if p.unit else ""
        allowed = f" Allowed: {_allowed(p)}." if _allowed(p) else ""
        lines += [f"    # {p.description}{unit}{allowed}", f"    {p.name}: {_yaml(p.default)}"]
    return "\n".join(lines) + "\n"


def markdown_table() -> str:
    """The README's table of parameters."""
    rows = ["| parameter | default | unit | allowed | changes | meaning |", "|---|---|---|---|---|---|"]
    for p in PARAMETERS:
        default = _yaml(p.default).replace('"', "") or '""'
        rows.append(
            f"| `{p.name}` | `{default}` | {p.unit} | {_allowed(p)} | {'live' if p.applies == 'live' else 'at restart'}"
            f" | {p.description} |"
        )
    return "\n".join(rows) + "\n"


def main() -> None:
    """Rewrite both files in the checkout that holds this package."""
    root = Path(__file__).resolve().parents[2]
    (root / "config" / "default.yaml").write_text(default_yaml(), encoding="utf-8")
    readme = root / "README.md"
    text = readme.read_text(encoding="utf-8")
    start, end = text.index(BEGIN) + len(BEGIN), text.index(END)
    readme.write_text(text[:start] + markdown_table() + text[end:], encoding="utf-8")


if __name__ == "__main__":
    main()
