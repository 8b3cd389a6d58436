"""HTML pages without external files: a replay's report, a single figure, an animation."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from rft_ros.files import whole

__all__ = ["Figure", "Table", "figure_page", "write_figure", "write_page"]

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1180px; margin: 2em auto; padding: 0 1.2em; }
h1 { font-size: 1.6em; margin-bottom: .2em; } h2 { font-size: 1.2em; margin: 2em 0 .2em; }
p { margin: .2em 0 .6em; color: #444; max-width: 60em; }
p.warning { color: #a33b00; font-weight: 600; }
table { border-collapse: collapse; font-size: .93em; font-variant-numeric: tabular-nums; }
th, td { padding: .22em .8em; text-align: right; border-bottom: 1px solid #e4e4e4; }
th { color: #555; font-weight: 600; } th:first-child, td:first-child { text-align: left; white-space: pre; }
table.words th, table.words td { text-align: left; } table.words td { word-break: break-word; }
details { margin: .5em 0; } summary { cursor: pointer; }
"""


class Figure(NamedTuple):
    """A plotly figure with its name (for links), a title, and a sentence on what it shows."""

    name: str
    title: str
    sentence: str
    drawn: Any

    def html(self) -> str:
        """The section of a page."""
        drawn = self.drawn.to_html(
            include_plotlyjs=False,
            full_html=False,
            auto_play=False,
            div_id=f"figure-{self.name}",
            config={"responsive": True, "displaylogo": False},
        )
        return f"<section><h2>{escape(self.title)}</h2><p>{escape(self.sentence)}</p>\n{drawn}\n</section>"


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table of text. `words`: align cells as text, not as numbers. `folded`: a click opens it."""

    title: str
    sentence: str = ""
    heads: Sequence[str]
    rows: Iterable[Sequence[str]]
    words: bool = False
    folded: bool = False

    def html(self) -> str:
        """The section of a page."""

        def cells(tag: str, row: Sequence[str]) -> str:
            return "<tr>" + "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in row) + "</tr>"

        kind = ' class="words"' if self.words else ""
        body = f"<table{kind}>{cells('th', self.heads)}{''.join(cells('td', row) for row in self.rows)}</table>"
        text = f"<p>{escape(self.sentence)}</p>" if self.sentence else ""
        if self.folded:
            return f"<details><summary>{escape(self.title)}</summary>{text}{body}</details>"
        return f"<section><h2>{escape(self.title)}</h2>{text}{body}</section>"


def write_page(
    file: Path, *, title: str, sentence: str, warnings: Iterable[str], sections: Iterable[Figure | Table]
) -> None:
    """Write a report. The same content gives the same bytes."""
    from plotly.offline import get_plotlyjs

    parts = [
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style>",
        f'<link rel="icon" href="data:,"><script>{get_plotlyjs()}</script></head><body>',
        f"<h1>{escape(title)}</h1><p>{escape(sentence)}</p>",
        *(f'<p class="warning">{escape(warning[:1].upper() + warning[1:])}.</p>' for warning in warnings),
        *(section.html() for section in sections),
        "</body></html>\n",
    ]
    # paths may hold bytes that are not UTF-8
    file.write_text("\n".join(parts), encoding="utf-8", errors="backslashreplace")


def figure_page(figure: Any, *, title: str, name: str) -> str:
    """A page with one plotly figure as HTML. `title`: of its tab. `name`: the figure's id (repeatable bytes)."""
    page: str = figure.to_html(
        include_plotlyjs=True, full_html=True, div_id=name, auto_play=False, config={"displaylogo": False}
    )
    head = f'<head><title>{escape(title)}</title><link rel="icon" href="data:,">'
    return page.replace("<html>", '<html lang="en">', 1).replace("<head>", head, 1)


def write_figure(file: Path, figure: Any, *, title: str) -> None:
    """Write a `figure_page`. Raises InputError if this fails."""
    with whole(file) as part:
        part.write_text(figure_page(figure, title=title, name="figure"), encoding="utf-8")
