"""A progress bar with the time left, on a terminal only and only for what takes over a second."""

import sys
import time
from collections.abc import Iterator

from rft_ros.bags.reading import Recording
from rft_ros.estimator.messages import Sample

__all__ = ["with_progress"]

_EVERY = 512  # samples between looks at the clock


def with_progress(recording: Recording, label: str) -> Iterator[Sample]:
    """The recording's samples, and a bar on stderr while they are worked through."""
    if not sys.stderr.isatty():
        yield from recording
        return
    from rich.console import Console
    from rich.progress import Progress

    began = time.monotonic()
    bar = Progress(console=Console(stderr=True), transient=True)
    task = bar.add_task(label, total=recording.last - recording.first)
    try:
        for number, sample in enumerate(recording):
            yield sample
            if number % _EVERY == 0 and time.monotonic() > began + 1.0:
                bar.start()
                bar.update(task, completed=recording.time - recording.first)
    finally:
        bar.stop()
