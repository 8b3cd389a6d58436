"""How far a long piece of work is, on a terminal's stderr; nothing where there is no terminal."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, TypeVar

if TYPE_CHECKING:
    from rich.progress import Progress

__all__ = ["along", "busy", "each"]

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


_EVERY = 512  # items between looks at the clock


def along(items: Iterable[_T], label: str, done: Callable[[], float], total: float) -> Iterator[_T]:
    """The items of a stream, and a bar once it has taken a second; `done`: how much of `total` lies behind."""
    if not sys.stderr.isatty():
        yield from items
        return
    from rich.console import Console
    from rich.progress import Progress

    began = time.monotonic()
    bar = Progress(console=Console(stderr=True), transient=True)
    task = bar.add_task(label, total=total)
    try:
        for number, item in enumerate(items):
            yield item
            if number % _EVERY == 0 and time.monotonic() > began + 1.0:
                bar.start()
                bar.update(task, completed=done())
    finally:
        bar.stop()
