"""Compilation by numba, and the cache of machine code on disk.

LLVM inlines small functions (`inlined`) into loops (`compiled`). The cache has one file for each loop, argument types,
code and processor. Its key is made from the bytecode and the constants of the loop and of all that it calls, so that a
change of a comment, or of a function beside them, does not change it. If a file is missing, damaged or cannot be
written, or if numba cannot load or save the code, the loop is compiled; no call fails for that. Machine code runs with
the rights of who loads it: only files and folders that nobody else can write are used.

What is used of numba beyond its documented interface, which a new version may change:

- `Dispatcher._cache` and `NullCache`: a cache of one's own, for the reasons in `_Cache`. There is no public way.
- `CompileResult._reduce`, `_rebuild` and `dumps`: what numba's own cache writes. `pickle` alone cannot take numba's
  environments. If a version cannot save, each process compiles, and a warning says so once.
- `rtsys.initialize`: machine code calls numba's runtime, which numba would prepare with the whole compiler.
- `codegen.magic_tuple`: the processor and its features, for the key.
- `Dispatcher.compile` and `get_overload`: a call without numba's dispatch, `machine_code`.
- Options `forceinline` and `no_cfunc_wrapper`: LLVM inlines, and no entry for C is compiled, `STEP`.
- `builder.function.attributes` of llvmlite, in `chunk`: the width of vectors, which has no option.
- The event "numba:compile", in `rft_ros.estimator.warm_up`: it ends a load at the first function that is not cached.
"""

import hashlib
import inspect
import os
import pickle
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from enum import Enum
from functools import cache
from pathlib import Path
from stat import S_ISLNK
from types import CodeType, FunctionType, ModuleType
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from numba import types
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.extending import register_jitable

from rft_ros.whole_file import replacing, with_checksum, without_checksum

__all__ = ["OPTIONS", "STEP", "compiled", "inlined", "machine_code", "machine_code_folders"]

OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"reassoc", "contract", "arcp", "nsz"}}
"""Reassociation lets LLVM vectorise sums over plates. The compiled code fixes their order, the same for one state and
for many. NaN and infinity keep their meaning."""

STEP: dict[str, Any] = {**OPTIONS, "forceinline": True, "no_cfunc_wrapper": True}
"""Options of a function that LLVM inlines into the loop which calls it, and that C never calls."""

numba.config.DISABLE_JIT = 0  # whatever NUMBA_DISABLE_JIT says: with their intrinsics the loops cannot run as Python

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

    A change of its code, of a function or a constant that it uses, and so on, makes it compile again. The key does
    not follow a `numba.extending.overload`: its Python function must name what it calls (see `chunk.wide_vectors`).
    `options`: passed to `numba.njit`.
    """
    made = numba.njit(nogil=True, **{"error_model": "numpy", **options})(function)
    made._cache = _Cache(made.py_func, options)  # numba's `cache=True` sets its own `FunctionCache` here
    return made


def machine_code(function: Any, arguments: tuple[object, ...]) -> Callable[..., None]:
    """The compiled code for arguments of these types, without numba's type dispatch (1.7 us a call).

    The caller must pass exactly these types, including array layouts: nothing checks them.
    """
    signature = tuple(numba.typeof(a) for a in arguments)
    function.compile(signature)
    return function.get_overload(signature)


def machine_code_folders(folder: Path) -> list[Path]:
    """Where machine code of a package in `folder` may lie, the first choice first.

    NUMBA_CACHE_DIR, if it is set. Else `__pycache__` beside the package, and for who may not write there the user's
    cache. It does not lie inside the package: pip would leave it there when the package is removed, and Python would
    take the folder that is left for the package.
    """
    name = f"{folder.name}_{_digest(str(folder))}"
    if chosen := numba.config.CACHE_DIR:
        return [Path(chosen) / name]
    folders = [folder / "__pycache__"]
    with suppress(RuntimeError):  # a user without a home
        cache = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
        folders.append(Path(cache) / "rft_ros" / name)
    return folders


class _Cache(NullCache):
    """The cache of one compiled function, in place of numba's own.

    numba's watches the file of the loop only, and not those of the functions in it. It also keeps an index, which a
    truncated write or a renamed class makes unreadable, and which two processes that compile at once can spoil: it
    numbers the files.
    """

    def __init__(self, function: FunctionType, options: dict[str, Any]) -> None:
        self.function, self.options = function, options
        module = function.__module__
        package = Path(inspect.getfile(function)).resolve().parents[module.count(".")]
        self._folders = machine_code_folders(package)
        self._name = f"{module}.{function.__qualname__}.{sys.implementation.cache_tag}"

    @property
    def cache_path(self) -> str:
        return str(self._folders[0])

    def _files(self, signature: tuple[Any, ...], codegen: Any) -> list[Path]:
        """Names that end in CODE.TYPES.nbc. Files of this function with another CODE are of older code."""
        # the processor and its features: machine code for others may not run on this one
        argument_types = _digest(repr((signature, codegen.magic_tuple())))
        code = _digest(numba.__version__, *_code(self, signature))
        return [folder / f"{self._name}.{code}.{argument_types}.nbc" for folder in self._folders]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        # Machine code calls numba's runtime. numba's own way, `target_context.refresh`, prepares the whole compiler
        # for that: 1 s and 30 MB in each process.
        rtsys.initialize(target_context)
        for file in self._files(sig, target_context.codegen()):
            try:
                content = without_checksum(file.read_bytes()) if _is_safe(file.parent) and _is_safe(file) else None
                if content is not None:
                    return CompileResult._rebuild(target_context, *pickle.loads(content))
            except OSError:  # most often there is no file
                continue
            except Exception as error:  # unpickling can raise almost anything
                _warn_once("load", f"'{file}': {type(error).__name__}: {error}")
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            content = dumps(data._reduce())
        except Exception as error:  # another numba's can raise almost anything
            _warn_once("save", f"{type(error).__name__}: {error}")
            return
        for file in self._files(sig, data.codegen):
            with suppress(OSError):
                file.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
                if not _is_safe(file.parent):
                    continue
                with replacing(file) as part:
                    part.write_bytes(with_checksum(content))
                    part.chmod(0o644)  # whatever the umask: a file that a group may write is not loaded
                code = file.name.split(".")[-3]
                for other in file.parent.glob(f"{self._name}.*.nbc"):
                    if other.name.split(".")[-3] != code:
                        other.unlink(missing_ok=True)
                return


def _is_safe(path: Path) -> bool:
    """Whether nobody but this user, or root, can have written it: what is loaded runs with the rights of this user.

    A link counts as what its owner made it: unsafe.
    """
    if not hasattr(os, "geteuid"):  # Windows: a user's folders are closed to others
        return True
    status = path.lstat()
    return not S_ISLNK(status.st_mode) and status.st_uid in (0, os.geteuid()) and not status.st_mode & 0o022


@cache
def _warn_once(verb: str, cause: str) -> None:
    fault = f"numba {numba.__version__} cannot {verb} machine code, so that this process compiles it. {cause}"
    warnings.warn(fault, RuntimeWarning, stacklevel=2)


def _digest(*parts: str) -> str:
    return hashlib.sha256(b"".join(hashlib.sha256(part.encode()).digest() for part in parts)).hexdigest()[:16]


def _code(cache: _Cache, signature: tuple[Any, ...]) -> Iterator[str]:
    """All that the machine code of a function is made from, as text: its code and, in turn, all that its names mean."""
    packages = {__name__.partition(".")[0], cache.function.__module__.partition(".")[0]}
    seen: set[int] = set()
    left: list[Any] = [STEP, cache, *signature]
    while left:
        value = left.pop()
        if isinstance(value, np.ndarray):
            yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
        elif isinstance(value, dict):
            left += value.items()
        elif isinstance(value, set | frozenset):
            left += sorted(value, key=repr)
        elif isinstance(value, tuple | list):
            left += [type(value), *value]
        elif isinstance(value, bool | int | float | complex | str | bytes | np.generic | np.dtype | None):
            yield repr(value)
        elif id(value) not in seen:
            seen.add(id(value))
            left += _parts(value, packages)


def _parts(value: Any, packages: set[str]) -> Iterator[Any]:
    """What something is made of that compiled code names, or that is the type of an argument.

    Nothing where that belongs to none of these packages: numba's version is part of the key.
    """
    if isinstance(value, _Cache):
        yield from (value.options, value.function)
    elif isinstance(getattr(value, "_cache", None), _Cache):  # a compiled function that another one contains
        yield value._cache
    elif isinstance(value, types.BaseTuple):
        yield from (getattr(value, "instance_class", None), *value.types)
    elif isinstance(value, type):
        yield getattr(value, "_fields", None)  # of a named tuple, whose numba type does not tell their order
        yield dict(getattr(value, "__members__", {}))  # of an enum
    elif isinstance(value, Enum):
        yield value.value
    elif callable(value):
        function = inspect.unwrap(value)  # numba's intrinsics wrap a function
        if isinstance(function, FunctionType) and str(function.__module__).partition(".")[0] in packages:
            yield from _parts_of_function(function, packages)


def _parts_of_function(function: FunctionType, packages: set[str]) -> Iterator[Any]:
    """Its bytecode, without line numbers, and what its names, its closure and its defaults stand for."""
    yield from (function.__defaults__, function.__kwdefaults__)
    codes = [function.__code__]
    while codes:
        code = codes.pop()
        yield from (code.co_code, code.co_names, code.co_varnames, code.co_freevars, code.co_flags, code.co_argcount)
        for constant in code.co_consts:
            if isinstance(constant, CodeType):
                codes.append(constant)
            else:
                yield constant
        yield from _meant(code.co_names, function.__globals__, packages)
    for cell in function.__closure__ or ():
        with suppress(ValueError):  # not filled yet
            yield cell.cell_contents


def _meant(names: tuple[str, ...], namespace: Mapping[str, Any], packages: set[str]) -> Iterator[Any]:
    """The values of names; of modules of these packages too, as of `LOAD` in `row.LOAD`."""
    spaces = [namespace]
    for space in spaces:
        for value in (space.get(name) for name in names):
            if not isinstance(value, ModuleType):
                yield value
            elif value.__name__.partition(".")[0] in packages and vars(value) not in spaces:
                spaces.append(vars(value))
