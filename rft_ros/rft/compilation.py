"""Compilation by numba, and the cache of machine code on disk.

LLVM inlines small functions (`inlined`) into loops (`compiled`). The cache has one file per loop, argument types,
sources and processor. If a file is missing, damaged or cannot be written, the loop is compiled; no call fails.
"""

import hashlib
import inspect
import os
import pickle
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

import numba
from llvmlite.binding import add_symbol
from numba.core.caching import FunctionCache
from numba.core.runtime._nrt_python import c_helpers
from numba.core.serialize import dumps
from numba.extending import register_jitable

__all__ = ["OPTIONS", "STEP", "compiled", "inlined", "machine_code"]

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}
"""Reassociation lets LLVM vectorise sums over plates. The compiled code fixes their order, the same for one state and
for many. NaN and infinity keep their meaning."""

STEP: dict[str, Any] = {**OPTIONS, "forceinline": True, "no_cfunc_wrapper": True}
"""Options of a loop that another one contains, but that a process beside can compile meanwhile."""

_P = ParamSpec("_P")
_R = TypeVar("_R")


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """A function that LLVM inlines where compiled code calls it; Python calls it uncompiled.

    `numba.njit` would also compile entries from Python and from C for each, which takes three times as long in all;
    numba's own inlining takes longer still.
    """
    return register_jitable(**STEP)(function)


def compiled(function: Callable[_P, _R], **options: Any) -> Callable[_P, _R]:
    """Compile a function for each combination of argument types, or load its machine code from the cache on disk.

    It may call `inlined` functions of its own package and of `rft_ros.rft`: changes there invalidate the cache.
    `options`: passed to `numba.njit`.
    """
    made = numba.njit(nogil=True, **{"error_model": "numpy", **options})(function)
    with suppress(OSError, RuntimeError):  # without a writable folder every process compiles
        made._cache = _Cache(made.py_func)
    return made


def machine_code(function: Any, arguments: tuple[object, ...]) -> Callable[..., None]:
    """The compiled code for arguments of these types, without numba's type dispatch (1.7 us a call).

    The caller must pass exactly these types, including array layouts: nothing checks them.
    """
    signature = tuple(numba.typeof(a) for a in arguments)
    function.compile(signature)
    return function.get_overload(signature)


class _Cache(FunctionCache):
    """numba's cache without its index file, which a truncated write or a renamed class makes unreadable.

    The index also numbers files, so that two processes that compile at once can use the same number, it tracks only the
    loop's source file, and numba reads it with the compiler in memory: 0.4 s and 26 MB.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        files = sorted({*Path(__file__).parent.glob("*.py"), *Path(inspect.getfile(function)).parent.glob("*.py")})
        self._sources = _digest(numba.__version__.encode(), *(file.read_bytes() for file in files))

    def _file(self, signature: Any, codegen: Any) -> Path:
        types = _digest(repr((signature, codegen.magic_tuple())).encode())
        return Path(self.cache_path) / f"{self._impl.filename_base}.{self._sources}.{types}.nbc"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        for name, address in c_helpers.items():  # numba's own way compiles its runtime first: 20 MB
            add_symbol(name if name.startswith("_") else f"NRT_{name}", address)
        with suppress(Exception):  # unpickling another numba's file can raise almost anything
            content = self._file(sig, target_context.codegen()).read_bytes()
            if hashlib.sha256(content[32:]).digest() == content[:32]:
                return self._impl.rebuild(target_context, pickle.loads(content[32:]))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        file = self._file(sig, data.codegen)
        part = file.with_name(f"{file.name}.{os.getpid()}")
        content = dumps(self._impl.reduce(data))
        try:
            self._impl.locator.ensure_cache_path()
            part.write_bytes(hashlib.sha256(content).digest() + content)
            part.replace(file)  # atomic: no process reads a partial file
            for other in file.parent.glob(f"{self._impl.filename_base.rpartition('-')[0]}-*.nbc"):  # at any line
                if f".{self._sources}." not in other.name:
                    other.unlink(missing_ok=True)  # from older sources
        except OSError:
            part.unlink(missing_ok=True)


def _digest(*parts: bytes) -> str:
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[:16]
