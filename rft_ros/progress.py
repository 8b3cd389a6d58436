"""How far a long piece of work is, on a terminal's stderr; nothing where there is no terminal."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress

__all__ = ["busy", "each"]

_T = TypeVar("_T")


def _bar() -> "Progress":
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()
    shown = sys.stderr.isatty()
    return Progress(*columns, console=Console(stderr=True), transient=True, disable=not shown, redirect_stdout=False)


def each(items: Sequence[_T], name: Callable[[_T], str]) -> Iterator[_T]:
    """The items, and a bar that names the one under way. What is printed meanwhile would get into it."""
    with _bar() as bar:
        task = bar.add_task("", total=len(items))
        for item in items:
            bar.update(task, description=name(item))
            yield item
            bar.advance(task)


@contextmanager
def busy(what: str) -> Iterator[None]:
    """Show what is under way, where nobody knows how long it takes. What is printed meanwhile would get into it."""
    from rich.console import Console

    with Console(stderr=True).status(f"{what} ..."):
        yield
