"""A progress bar over a recording."""

from collections.abc import Iterator

from rft_ros.bags.reading import Recording
from rft_ros.estimator.messages import Sample
from rft_ros.progress import bar

__all__ = ["with_progress"]

_EVERY = 512  # samples between updates of the bar


def with_progress(recording: Recording, label: str) -> Iterator[Sample]:
    """The recording's samples, with a bar on stderr while they are processed."""
    with bar(label, recording.last - recording.first) as update:
        for number, sample in enumerate(recording):
            yield sample
            if number % _EVERY == 0:
                update(recording.time - recording.first, label)
