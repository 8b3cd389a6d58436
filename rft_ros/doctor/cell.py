"""A robot cell as its parameter file describes it."""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from rft_ros.diagnosis import Finding
from rft_ros.errors import InputError
from rft_ros.estimator.warm_up import prepare
from rft_ros.messages import Role
from rft_ros.parameters import Model, Values

__all__ = ["Cell", "compiled"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """A robot cell as the parameter file `file` describes it.

    `values`: of all parameters. `named`: the names of the parameters that the file sets. `model`: made from the values,
    with the tool not reduced. `topics`: the topic of each role that is needed.
    """

    file: Path
    values: Values
    named: Collection[str]
    model: Model
    topics: dict[Role, str]


def compiled() -> Finding:
    """The finding on the cache: whether it has the machine code."""

    def stop() -> None:
        raise InputError("run rft warm-up, or the node's first start compiles for some ten seconds")

    try:
        prepare(stop)
    except InputError as error:
        return Finding(False, f"compiled: no; {error}")
    return Finding(True, "compiled: yes")
