"""Examine a recording of a cell."""

from pathlib import Path

from rft_ros.bags.options import ReplayOptions
from rft_ros.bags.reading import Recording
from rft_ros.diagnosis import Finding
from rft_ros.doctor.cell import Cell
from rft_ros.doctor.checkup import Checkup

__all__ = ["examine_bag"]


def examine_bag(cell: Cell, bag: Path, options: ReplayOptions) -> list[Finding]:
    """The findings on a recording of the cell. Raises InputError for a bag that cannot be used."""
    every = tuple(cell.topics)
    recording = Recording(bag, cell.values, options, topics=cell.topics, optional=every, refuse_types=False)
    values, topics = recording.values, recording.topics
    checkup = Checkup(values, cell.model, named=cell.named, topics=topics, tare=options.tare, live=False)
    with recording:
        for sample in recording:
            checkup.push(sample, recording.time)
    found = [Finding(False, f"{role}: {sentence}") for role, sentence in recording.mistyped.items()]
    if recording.damage:
        found.append(Finding(False, f"bag: {recording.damage}"))
    return [*found, *checkup.findings()]
