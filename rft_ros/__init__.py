"""rft_ros: the wrench that dry granular material puts on a robot's tool, in real time.

Force ON the tool BY the grains; SI units; z up; quaternions xyzw. docs/python.md shows the use of these names.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rft_ros.estimator import Estimator, PoseSample, TwistSample, WrenchSample
    from rft_ros.parameters import Config, LoadCell, Model, read_medium
    from rft_ros.rft import (
        Memory,
        alpha_y_model,
        checked_states,
        law_named,
        medium_named,
        wrenches,
        wrenches_in_time,
    )
    from rft_ros.tool import load_tool

__all__ = [
    "Config",
    "Estimator",
    "LoadCell",
    "Memory",
    "Model",
    "PoseSample",
    "TwistSample",
    "WrenchSample",
    "alpha_y_model",
    "checked_states",
    "law_named",
    "load_tool",
    "medium_named",
    "read_medium",
    "wrenches",
    "wrenches_in_time",
]

_HOMES = "rft_ros.rft", "rft_ros.tool", "rft_ros.parameters", "rft_ros.estimator"


def __dir__() -> list[str]:
    """The names of the module and of `__all__`, also those that were not imported yet: interpreters complete them."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> object:
    """Import a name of `__all__` at its first use.

    So `import rft_ros` does not import numba, which takes half a second. `rft_node` installs its signal handlers before
    that, and Ctrl-C ends it cleanly at any time.
    """
    if name in __all__:
        for home in map(import_module, _HOMES):
            if hasattr(home, name):
                return getattr(home, name)
    raise AttributeError(f"module 'rft_ros' has no attribute '{name}'")
