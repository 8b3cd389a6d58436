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
from numba.core.caching import FunctionCache
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.extending import register_jitable

__all__ = ["OPTIONS", "compiled", "inlined", "machine_code"]

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}
"""Reassociation lets LLVM vectorise sums over plates. The compiled code fixes their order, the same for one state and
for many. NaN and infinity keep their meaning."""

_P = ParamSpec("_P")
_R = TypeVar("_R")


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """A function that LLVM inlines where compiled code calls it; Python calls it uncompiled.

    `numba.njit` would also compile two entries from Python for each, which takes three times as long in all; numba's
    own inlining takes longer still.
    """
    made: Callable[_P, _R] = register_jitable(forceinline=True, **OPTIONS)(function)
    return made


def compiled(function: Callable[_P, _R], **options: Any) -> Callable[_P, _R]:
    """Compile a function for each combination of argument types, or load its machine code from the cache on disk.

    It may call `inlined` functions of its own module and of `rft_ros.rft`: changes there invalidate the cache.
    `options`: passed to `numba.njit`.
    """
    made: Any = numba.njit(nogil=True, **{"error_model": "numpy", **options})(function)
    with suppress(OSError, RuntimeError):  # without a writable folder every process compiles
        made._cache = _Cache(made.py_func)
    result: Callable[_P, _R] = made
    return result


def machine_code(function: Any, arguments: tuple[object, ...]) -> Callable[..., None]:
    """The compiled code for arguments of these types, without numba's type dispatch (1.7 us a call).

    The caller must pass exactly these types, including array layouts: nothing checks them.
    """
    signature = tuple(numba.typeof(a) for a in arguments)
    function.compile(signature)
    entry: Callable[..., None] = function.get_overload(signature)
    return entry


class _Cache(FunctionCache):
    """numba's cache without its index file, which a truncated write or a renamed class makes unreadable.

    The index also numbers files, so that two processes that compile at once can use the same number, and it tracks only
    the loop's source file, not those of the inlined functions.
    """

    def __init__(self, function: Callable[..., object]) -> None:
        super().__init__(function)
        files = {*Path(__file__).parent.glob("*.py"), Path(inspect.getfile(function))}
        sources = b"".join(hashlib.sha256(file.read_bytes()).digest() for file in sorted(files))
        constants = [cell.cell_contents for cell in function.__closure__ or ()]
        self._key = numba.__version__, sources, [c for c in constants if isinstance(c, bool | int | float | str)]

    def _file(self, signature: Any, codegen: Any) -> Path:
        generation, types = _digest(self._key), _digest((signature, codegen.magic_tuple()))
        return Path(self.cache_path) / f"{self._impl.filename_base}.{generation}.{types}.nbc"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        rtsys.initialize(target_context)  # not `refresh`, which imports the compiler's parts and SciPy's too: 0.4 s
        try:
            content = self._file(sig, target_context.codegen()).read_bytes()
            checksum, data = content[:32], content[32:]
            if hashlib.sha256(data).digest() != checksum:
                return None
            result = self._impl.rebuild(target_context, pickle.loads(data))
        except Exception:  # unpickling another numba's file can raise almost anything
            return None
        return result if tuple(result.signature.args) == tuple(sig) else None

    def save_overload(self, sig: Any, data: Any) -> None:
        if not self._impl.check_cachable(data):
            return
        file = self._file(sig, data.codegen)
        part = Path(f"{file}.{os.getpid()}")
        content = dumps(self._impl.reduce(data))
        try:
            self._impl.locator.ensure_cache_path()
            part.write_bytes(hashlib.sha256(content).digest() + content)
            part.replace(file)  # atomic: no process reads a partial file
            for other in file.parent.glob(f"{self._impl.filename_base}.*.nbc"):
                if _digest(self._key) not in other.name:
                    other.unlink(missing_ok=True)  # from older sources
        except OSError:
            part.unlink(missing_ok=True)


def _digest(key: object) -> str:
    return hashlib.sha256(repr(key).encode()).hexdigest()[:16]
