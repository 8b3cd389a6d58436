"""Replay several recordings: one folder each and a common summary; a failure does not stop the others."""

import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rft_ros.bags.reading import bag_name
from rft_ros.bags.summary import METRIC_HEADS, Summary, metric_line, metrics
from rft_ros.errors import InputError
from rft_ros.files import whole

__all__ = ["comparison_lines", "folder_names", "replay_each"]


def comparison_lines(summaries: dict[str, Summary]) -> list[str]:
    """A table: the metrics of each bag by its folder's name, overall and over penetration."""
    width = max((len(name) for name in summaries), default=0) + 14
    text = [metric_line("force on the tool", METRIC_HEADS, width)]
    for name, summary in summaries.items():
        text.append(metric_line(name, metrics(summary), width))
        text.append(metric_line("  penetration", metrics(summary.phases["penetration"]), width))
    return text


def folder_names(bags: Sequence[Path]) -> list[str]:
    """A unique name for each bag's folder: the bag's without suffix, with a number if that is taken."""
    names: list[str] = []
    wanted = [Path(bag_name(bag)).stem if bag.is_file() else bag_name(bag) for bag in bags]
    for name in wanted:
        number = 2
        unique = name
        while unique in names or (number > 2 and unique in wanted):
            unique, number = f"{name}_{number}", number + 1
        names.append(unique)
    return names


def replay_each(
    bags: Sequence[Path], out: Path, one: Callable[..., Summary]
) -> Iterator[tuple[str, Summary | InputError]]:
    """Replay each bag by `one(bag, folder, label=...)` into a folder below `out`; at last write ``summary.json`` there.

    Yields each folder's name with the bag's summary or error. Raises InputError if ``summary.json`` cannot be written.
    """
    content: dict[str, dict[str, Any]] = {"bags": {}, "failures": {}}
    for number, (bag, name) in enumerate(zip(bags, folder_names(bags), strict=True), start=1):
        outcome: Summary | InputError
        try:
            outcome = one(bag, out / name, label=f"{number}/{len(bags)} {name}")
        except InputError as error:
            outcome, content["failures"][name] = error, str(error)
        else:
            content["bags"][name] = outcome.content()
        yield name, outcome
    with whole(out / "summary.json") as part:
        part.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
