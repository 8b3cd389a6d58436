"""Replay several recordings: one folder each and a common summary; a failure does not stop the others."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from rft_ros.bags.summary import METRIC_HEADS, Summary, metric_line, metrics
from rft_ros.errors import InputError, file_errors

__all__ = ["Batch", "folder_names", "replay_all"]


class Batch:
    """Summaries and failures of several bags by folder name, in the given order."""

    def __init__(self) -> None:
        self.summaries: dict[str, Summary] = {}
        self.failures: dict[str, str] = {}

    def lines(self) -> list[str]:
        """A table: the metrics of each bag, overall and over penetration."""
        text = [f"{len(self.summaries)} of {len(self.summaries) + len(self.failures)} bags replayed"]
        width = max((len(name) for name in self.summaries), default=0) + 14
        text.append(metric_line("force on the tool", METRIC_HEADS, width))
        for name, summary in self.summaries.items():
            text.append(metric_line(name, metrics(summary), width))
            text.append(metric_line("  penetration", metrics(summary.phases["penetration"]), width))
        return text


def folder_names(bags: Sequence[Path]) -> list[str]:
    """A unique name for each bag's folder: the bag's without suffix, with a number if that is taken."""
    names: list[str] = []
    wanted = [bag.resolve().stem if bag.is_file() else bag.resolve().name for bag in bags]
    for name in wanted:
        number = 2
        unique = name
        while unique in names or (number > 2 and unique in wanted):
            unique, number = f"{name}_{number}", number + 1
        names.append(unique)
    return names


def replay_all(
    bags: Sequence[Path],
    out: Path,
    one: Callable[..., Summary],
    *,
    done: Callable[[Summary | InputError], None],
) -> Batch:
    """Replay each bag by `one(bag, folder, label=...)` into a folder below `out`, and write a common ``summary.json``.

    `done` is called with each bag's summary or InputError. Raises InputError if ``summary.json`` cannot be written.
    """
    batch = Batch()
    for number, (bag, name) in enumerate(zip(bags, folder_names(bags), strict=True), start=1):
        try:
            summary = one(bag, out / name, label=f"{number}/{len(bags)} {name}")
        except InputError as error:
            batch.failures[name] = str(error)
            done(error)
        else:
            batch.summaries[name] = summary
            done(summary)
    with file_errors(f"output folder '{out}'", "written"):
        out.mkdir(parents=True, exist_ok=True)
        content = {"bags": {name: s.content() for name, s in batch.summaries.items()}, "failures": batch.failures}
        (out / "summary.json").write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return batch
