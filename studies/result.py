"""The result of a study: a figure, and a table that the docs show."""

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image

from rft_ros.errors import InputError

__all__ = [
    "BLACK",
    "BLUE",
    "GREEN",
    "GREY",
    "ORANGE",
    "PURPLE",
    "SKY",
    "VERMILION",
    "StudyResult",
    "TextTable",
]
__all__ += [
    "label_axes",
    "new_figure",
    "picture",
    "published_against_ours",
    "result_of_rows",
    "table_in",
]
__all__ += ["write_tables"]

# Okabe and Ito's palette, distinguishable with every kind of colour vision. Line styles and markers repeat the colour.
BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE, GREY = "#0072B2", "#D55E00", "#CC79A7", "#8C8C8C"

_DPI = 100


@dataclass(frozen=True, slots=True, kw_only=True)
class TextTable:
    """A table of rounded text."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def markdown(self) -> str:
        """The table in Markdown; every line ends in a newline."""
        first, *rows = ("| " + " | ".join(line) + " |\n" for line in (self.header, *self.rows))
        return "".join([first, "|" + "---|" * len(self.header) + "\n", *rows])


def published_against_ours(*rows: tuple[str, str, str]) -> TextTable:
    """A table of quantity, published value and ours; "–" marks an unknown one."""
    return TextTable(header=("quantity", "published", "ours"), rows=rows)


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyResult:
    """A text table, and the figure that shows its numbers, if one does."""

    name: str
    title: str
    figure: Figure | None
    table: TextTable

    def write(self, folder: Path) -> list[Path]:
        """Write NAME.png and NAME.md; returns the files. The same result gives the same bytes."""
        contents = {f"{self.name}.png": picture(self.figure)} if self.figure else {}
        contents[f"{self.name}.md"] = f"# {self.title}\n\n{self.table.markdown()}".encode()
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in contents.items():
            (folder / name).write_bytes(data)
        return [folder / name for name in contents]


def result_of_rows(
    name: str,
    title: str,
    figure: Figure | None,
    rows: Sequence[Sequence[Any]],
    *columns: tuple[str, str] | tuple[str, str, float],
) -> StudyResult:
    """A result whose table has these rows. `columns`: heading, format of the text, and a factor of the value before."""

    def text(value: Any, form: str, *factor: float) -> str:
        return form.format(value * factor[0] if factor else value)

    header = tuple(column[0] for column in columns)
    cells = tuple(
        tuple(text(row[k], *column[1:]) for k, column in enumerate(columns)) for row in rows
    )
    return StudyResult(
        name=name, title=title, figure=figure, table=TextTable(header=header, rows=cells)
    )


def new_figure(width: float, height: float) -> Figure:
    """An empty figure of this width and height [inches] with a constrained layout."""
    return Figure(figsize=(width, height), layout="constrained")


def label_axes(
    axes: Axes, *, x: str, y: str, title: str = "", legend: dict[str, Any] | None = None
) -> None:
    """Label both axes, add a light grid, and a legend if its options are given."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    if legend is not None:
        axes.legend(fontsize=8, **legend)


def picture(figure: Figure) -> bytes:
    """The figure as PNG in 256 colours, to keep the docs small, without the version of what drew it."""
    out, small = io.BytesIO(), io.BytesIO()
    figure.savefig(out, format="png", dpi=_DPI, metadata={"Software": None})
    with Image.open(out) as image:
        image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(
            small, format="png", optimize=True
        )
    return small.getvalue()


def _markers(name: str) -> tuple[str, str]:
    return f"<!-- study {name}: begin -->\n", f"<!-- study {name}: end -->"


def table_in(text: str, name: str) -> str | None:
    """The text between a study's markers in a page of the docs; None without markers."""
    begin, end = _markers(name)
    found = re.search(f"{re.escape(begin)}(.*?){re.escape(end)}", text, re.DOTALL)
    return found.group(1) if found else None


def write_tables(file: Path, results: Sequence[StudyResult]) -> list[str]:
    """Write each result's table between its markers in a page of the docs; returns the names found there."""
    text = file.read_text(encoding="utf-8")
    written = []
    for result in results:
        begin, end = _markers(result.name)
        if (old := table_in(text, result.name)) is not None:
            text = text.replace(f"{begin}{old}{end}", f"{begin}{result.table.markdown()}{end}")
            written.append(result.name)
    if not written:
        names = ", ".join(result.name for result in results)
        raise InputError(f"'{file}' has no marker '<!-- study NAME: begin -->' for any of {names}")
    file.write_text(text, encoding="utf-8")
    return written
