"""The studies by name: what `rft study` runs. A module here has ``study(data) -> Outcome``, or a sequence of them."""

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rft_ros.errors import InputError

if TYPE_CHECKING:
    from rft_ros.studies.outcome import Outcome

__all__ = ["STUDIES", "Study", "run_study"]


class Study(NamedTuple):
    """Where a study is, and whether it is nothing without the reference data. Imported when it runs."""

    module: str
    needs_data: bool = False


STUDIES: dict[str, Study] = {
    "horizontal": Study("rft_ros.studies.horizontal"),
    "plates": Study("rft_ros.studies.plates"),
    "oscillation": Study("rft_ros.studies.oscillation"),
    "circumnutation": Study("rft_ros.studies.circumnutation"),
    "convergence": Study("rft_ros.studies.convergence"),
    "dem": Study("rft_ros.studies.dem", needs_data=True),
    "stability": Study("rft_ros.studies.stability.study"),
}
"""Every study, in the order of `rft study all`."""


def run_study(name: str, data: Path | None) -> "Sequence[Outcome]":
    """Run one of `STUDIES`; `data`: folder of the reference data, for those that use it."""
    entry = STUDIES[name]
    if entry.needs_data and data is None:
        raise InputError(f"the study '{name}' needs the reference data: give --data DIR")
    found: Outcome | Sequence[Outcome] = import_module(entry.module).study(data)
    return found if isinstance(found, Sequence) else (found,)
