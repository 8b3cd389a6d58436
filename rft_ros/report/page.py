"""HTML pages of figures and tables, without external files."""

import base64
import gzip
import json
from collections.abc import Iterable, Sequence
from functools import cache
from html import escape
from pathlib import Path
from typing import Any, NamedTuple

from rft_ros.files import whole

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1180px; margin: 2em auto; padding: 0 1.2em; }
h1 { font-size: 1.6em; margin-bottom: .2em; } h2 { font-size: 1.2em; margin: 2em 0 .2em; }
p { margin: .2em 0 .6em; color: #444; max-width: 60em; }
p.warning { color: #a33b00; font-weight: 600; }
table { border-collapse: collapse; font-size: .93em; font-variant-numeric: tabular-nums; }
th, td { padding: .22em .8em; text-align: left; border-bottom: 1px solid #e4e4e4; white-space: pre-wrap; }
th { color: #555; font-weight: 600; }
"""


_CONFIG = {
    "responsive": True,
    "displaylogo": False,
    "showSendToCloud": False,
}  # no upload of a cell's data
_LOADER = """
const packed = Uint8Array.from(atob(document.getElementById("plotly").textContent), (c) => c.charCodeAt(0));
const plotly = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
(0, eval)(await new Response(plotly).text());
for (const drawn of document.querySelectorAll("script.figure"))
  await Plotly.newPlot(drawn.previousElementSibling, JSON.parse(drawn.textContent));
document.getElementById("loading").remove();
"""
"""Unpacks plotly, which is a third as large when packed, and draws the figures."""


class Figure(NamedTuple):
    """A section with a plotly figure. `name`: for links. `title`, `sentence`: what the figure shows, above it."""

    name: str
    title: str
    sentence: str
    drawn: Any

    def html(self) -> str:
        """The HTML of the section below its title and sentence."""
        text = json.dumps({**json.loads(self.drawn.to_json()), "config": _CONFIG}).replace(
            "<", "\\u003c"
        )
        return f'<div id="figure-{self.name}"></div><script class="figure" type="application/json">{text}</script>'


class Table(NamedTuple):
    """A section with a table of text. `title`, `sentence`: above it. `heads`: of its columns."""

    title: str
    sentence: str
    heads: Sequence[str]
    rows: Iterable[Sequence[str]]

    def html(self) -> str:
        """The HTML of the section below its title and sentence."""
        lines = ["".join(f"<th>{escape(head)}</th>" for head in self.heads)]
        lines += ["".join(f"<td>{escape(cell)}</td>" for cell in row) for row in self.rows]
        return f"<table><tr>{'</tr><tr>'.join(lines)}</tr></table>"


def write_page(
    file: Path,
    sections: Iterable[Figure | Table],
    *,
    title: str,
    sentence: str = "",
    warnings: Iterable[str] = (),
) -> None:
    """Write a page. The same content gives the same bytes. Raises InputError if this fails."""
    parts = [
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style>",
        '<link rel="icon" href="data:,"></head><body>',
        f"<h1>{escape(title)}</h1><p>{escape(sentence)}</p>",
        *(
            f'<p class="warning">{escape(warning[:1].upper() + warning[1:])}.</p>'
            for warning in warnings
        ),
    ]
    for section in sections:
        parts += [
            f"<h2>{escape(section.title)}</h2><p>{escape(section.sentence)}</p>",
            section.html(),
        ]
    parts += ['<p id="loading">The figures need a browser of 2023 or later, with JavaScript.</p>']
    parts += [f'<script id="plotly" type="text/plain">{_packed_plotly()}</script>']
    parts += [f'<script type="module">{_LOADER}</script></body></html>\n']
    with whole(file) as part:  # paths may hold bytes that are not UTF-8
        part.write_text("\n".join(parts), encoding="utf-8", errors="backslashreplace")


@cache
def _packed_plotly() -> str:
    from plotly.offline import get_plotlyjs

    return base64.b64encode(gzip.compress(get_plotlyjs().encode(), mtime=0)).decode()
