"""Progress of long work on stderr: a spinner or a bar on a terminal; elsewhere lines where a wait is long."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

MAX_SILENCE_S = 3.0
"""After so long [s] without a line a user wonders whether the program hangs."""

LINE_PERIOD = 10.0  # s, between the lines after the first


def say(line: str) -> None:
    """Print a line on stderr at once."""
    print(line, file=sys.stderr, flush=True)


def say_compiling() -> None:
    """Say that the next step compiles, as the first run of a version does."""
    say("compiling, ten seconds or more, at the first run only ...")


@contextmanager
def line_if_long(what: str) -> Iterator[None]:
    """Say `what` once this block has run for `MAX_SILENCE_S`, and each `LINE_PERIOD` for how long it has run."""
    begin = time.monotonic()
    has_ended = threading.Event()

    def speak() -> None:
        if has_ended.wait(MAX_SILENCE_S):
            return
        say(f"{what} ...")
        while not has_ended.wait(LINE_PERIOD):
            say(f"{what}, for {time.monotonic() - begin:.0f} s so far ...")

    threading.Thread(target=speak, daemon=True).start()
    try:
        yield
    finally:
        has_ended.set()


@contextmanager
def bar(label: str, total: float) -> Iterator[Callable[[float, str], None]]:
    """A progress bar with the time left; yields `update(completed, label)`. Do not print while it is shown."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    if not console.is_interactive:  # rich 13 ends even a disabled bar with an empty line
        with line_if_long(f"working on {label}"):
            yield lambda _completed, _label: None
        return
    with Progress(console=console, transient=True, redirect_stdout=False) as progress:
        task = progress.add_task(label, total=total)
        yield lambda completed, label: progress.update(
            task, completed=completed, description=label
        )


@contextmanager
def counted(what: str) -> Iterator[Callable[[float, str], None]]:
    """Say `what`, and yield `update(seconds, state)`: a terminal shows both, elsewhere each new state is a line."""
    from rich.console import Console

    console = Console(stderr=True)
    if console.is_interactive:
        with console.status(f"{what} ...") as status:
            yield lambda seconds, state: status.update(f"{what} ({seconds:.0f} s; {state}) ...")
        return
    say(f"{what} ...")
    last = ""

    def update(seconds: float, state: str) -> None:
        nonlocal last
        if state != last:
            say(f"after {seconds:.0f} s: {state}")
        last = state

    yield update


@contextmanager
def busy(what: str) -> Iterator[None]:
    """A spinner beside `what`, for work of unknown length."""
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_interactive:
        with line_if_long(what):
            yield
        return
    with console.status(f"{what} ..."):
        yield
