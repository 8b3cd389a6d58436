"""Progress of long work: shown on stderr where that is a terminal, nowhere else."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["bar", "busy"]


@contextmanager
def bar(label: str, total: float, *, delay: float = 1.0) -> Iterator[Callable[[float, str], None]]:
    """A progress bar with the time left, drawn once the work has taken `delay` [s].

    Yields `update(completed, label)`. Do not print while the bar is shown: it garbles both.
    """
    from rich.console import Console
    from rich.progress import Progress

    shown = sys.stderr.isatty()
    progress = Progress(console=Console(stderr=True), transient=True, redirect_stdout=False, disable=not shown)
    task = progress.add_task(label, total=total)
    first_drawn = time.monotonic() + delay

    def update(completed: float, label: str) -> None:
        progress.update(task, completed=completed, description=label)
        if time.monotonic() >= first_drawn:
            progress.start()

    try:
        yield update
    finally:
        progress.stop()


@contextmanager
def busy(what: str) -> Iterator[None]:
    """A spinner beside `what`, for work of unknown length."""
    from rich.console import Console

    with Console(stderr=True).status(f"{what} ..."):
        yield
