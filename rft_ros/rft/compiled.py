"""How the core is compiled: small functions, put together by LLVM inside the loops of `kernel`."""

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numba

__all__ = ["OPTIONS", "inlined"]

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}
"""Reassociation lets sums over plates use vector registers; the order is then fixed by the compiled code, the same for
one state and for many. NaN and infinity keep their meaning."""

_P = ParamSpec("_P")
_R = TypeVar("_R")


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function that becomes part of whatever calls it. numba's own inlining takes three times as long."""
    compiled: Callable[_P, _R] = numba.njit(forceinline=True, **OPTIONS)(function)
    return compiled
