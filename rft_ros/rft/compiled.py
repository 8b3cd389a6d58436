"""How the core is compiled: small functions, put together by LLVM inside the loops of `kernel`."""

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from numba.core.caching import FunctionCache

__all__ = ["OPTIONS", "SOURCE", "forgiving", "inlined", "machine_code"]

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}
"""Reassociation lets sums over plates use vector registers; the order is then fixed by the compiled code, the same for
one state and for many. NaN and infinity keep their meaning."""

SOURCE = 1 + zlib.crc32(b"".join(file.read_bytes() for file in sorted(Path(__file__).parent.glob("*.py"))))
"""A number over all source files of this package, never 0: numba's cache knows when the file of a compiled loop
changes, not when a law or a model in another file does."""

_P = ParamSpec("_P")
_R = TypeVar("_R")
_T = TypeVar("_T")


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function that becomes part of whatever calls it. numba's own inlining takes three times as long."""
    compiled: Callable[_P, _R] = numba.njit(forceinline=True, **OPTIONS)(function)
    return compiled


class _ForgivingCache(FunctionCache):
    """numba's cache on disk, in which what cannot be read counts as not there."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling damaged bytes can raise almost anything
            # The index holds the types of all that was ever compiled, and cannot be read once one of them is gone,
            # such as an α_y model that was renamed. numba reads it again to save, so it must be emptied.
            self.flush()
            return None


def forgiving(kernel: _T) -> _T:
    """The same kernel with numba's cache, whose index may name a class that is gone: then it is compiled anew."""
    compiled: Any = kernel
    compiled._cache = _ForgivingCache(compiled.py_func)
    return kernel


def machine_code(kernel: Any, arguments: tuple[object, ...]) -> Callable[..., None]:
    """The compiled code for arguments of these types, without numba's search by each one's type (1.7 us a call).

    Whoever calls it must hand over the same types, down to how arrays lie in memory: nothing checks.
    """
    signature = tuple(numba.typeof(a) for a in arguments)
    kernel.compile(signature)
    entry: Callable[..., None] = kernel.get_overload(signature)
    return entry
