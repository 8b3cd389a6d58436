"""Progress of long work: shown on stderr where that is a terminal, nowhere else."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def bar(label: str, total: float) -> Iterator[Callable[[float, str], None]]:
    """A progress bar with the time left; yields `update(completed, label)`. Do not print while it is shown."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not console.is_interactive:  # rich 13 ends even a disabled bar with an empty line
        yield lambda *_: None
        return
    with Progress(console=console, transient=True, redirect_stdout=False) as progress:
        task = progress.add_task(label, total=total)
        yield lambda completed, label: progress.update(
            task, completed=completed, description=label
        )


@contextmanager
def busy(what: str) -> Iterator[None]:
    """A spinner beside `what`, for work of unknown length."""
    from rich.console import Console

    with Console(stderr=True).status(f"{what} ..."):
        yield
