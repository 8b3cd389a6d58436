"""How numba compiles the package, and how it keeps machine code on disk.

Small functions (`inlined`) are put together by LLVM inside loops (`compiled`). The cache on disk has one file for each
loop, its argument types, its sources and the processor. A file that is missing, damaged or cannot be written never
fails a call: the loop is compiled instead.
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
from numba.core.serialize import dumps

__all__ = ["OPTIONS", "compiled", "inlined", "machine_code"]

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}
"""Reassociation lets sums over plates use vector registers; the order is then fixed by the compiled code, the same for
one state and for many. NaN and infinity keep their meaning."""

_P = ParamSpec("_P")
_R = TypeVar("_R")


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function that becomes part of whatever calls it. numba's own inlining takes three times as long."""
    made: Callable[_P, _R] = numba.njit(forceinline=True, **OPTIONS)(function)
    return made


def compiled(function: Callable[_P, _R], **options: Any) -> Callable[_P, _R]:
    """Compile a function for each combination of argument types, or load its machine code from the cache on disk.

    It may call `inlined` functions of its own module and of `rft_ros.rft`: the cache watches these sources.
    `options`: of `numba.njit`.
    """
    made: Any = numba.njit(nogil=True, **{"error_model": "numpy", **options})(function)
    with suppress(OSError, RuntimeError):  # no folder can be written to: compile in every process
        made._cache = _Cache(made.py_func)
    result: Callable[_P, _R] = made
    return result


def machine_code(function: Any, arguments: tuple[object, ...]) -> Callable[..., None]:
    """The compiled code for arguments of these types, without numba's search by each one's type (1.7 us a call).

    Whoever calls it must hand over the same types, down to how arrays lie in memory: nothing checks.
    """
    signature = tuple(numba.typeof(a) for a in arguments)
    function.compile(signature)
    entry: Callable[..., None] = function.get_overload(signature)
    return entry


class _Cache(FunctionCache):
    """numba's cache without its index, which one cut short or one class renamed makes unreadable.

    The index numbers its files, and two processes that compile at once may give theirs the same number; and it watches
    the file of the loop alone, not those of the functions that became part of it.
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
        target_context.refresh()
        try:
            content = self._file(sig, target_context.codegen()).read_bytes()
            checksum, data = content[:32], content[32:]
            if hashlib.sha256(data).digest() != checksum:
                return None
            result = self._impl.rebuild(target_context, pickle.loads(data))
        except Exception:  # unpickling what an older numba wrote can raise almost anything
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
            part.replace(file)  # at once, so that no process reads half of it
            for other in file.parent.glob(f"{self._impl.filename_base}.*.nbc"):
                if _digest(self._key) not in other.name:
                    other.unlink(missing_ok=True)  # of former sources
        except OSError:
            part.unlink(missing_ok=True)


def _digest(key: object) -> str:
    return hashlib.sha256(repr(key).encode()).hexdigest()[:16]
