"""Compilation by numba, and the cache of machine code on disk.

LLVM inlines small functions (`inlined`) into loops (`compiled`). The cache has one file for each loop, argument types,
sources and processor. A change of any source from which the loop may be made compiles it again. If a file is missing,
damaged or cannot be written, or if numba cannot load or save the code, the loop is compiled; no call fails for that.
Machine code runs with the rights of who loads it: only files and folders that nobody else can write are used.

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
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from stat import S_ISLNK
from types import FunctionType
from typing import Any, ParamSpec, TypeVar

import numba
import numpy as np
from numba.core.caching import NullCache
from numba.core.compiler import CompileResult
from numba.core.runtime import rtsys
from numba.core.serialize import dumps
from numba.extending import register_jitable

_PACKAGE = Path(__file__).resolve().parents[2]
_SHARED_FOLDERS = (
    "rft",
    "ground",
)  # folders whose functions become part of loops elsewhere in the package

OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"reassoc", "contract", "arcp", "nsz"},
}
"""Reassociation lets LLVM vectorise sums over plates. The compiled code fixes their order, the same for one state and
for many. NaN and infinity keep their meaning."""

STEP: dict[str, Any] = {**OPTIONS, "forceinline": True, "no_cfunc_wrapper": True}
"""Options of a function that LLVM inlines into the loop which calls it, and that C never calls."""

# whatever NUMBA_DISABLE_JIT says: with their intrinsics the loops cannot run as Python
numba.config.DISABLE_JIT = 0

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

    It may call functions of its own folder in the package, of `rft` and of `ground`. `options`: passed to `numba.njit`.
    """
    dispatcher = numba.njit(nogil=True, **{"error_model": "numpy", **options})(function)
    dispatcher._cache = _Cache(
        dispatcher.py_func
    )  # numba's `cache=True` sets its own `FunctionCache` here
    return dispatcher


def machine_code(function: Any, arguments: tuple[object, ...]) -> Callable[..., None]:
    """The compiled code for arguments of these types, without numba's type dispatch (1.7 us a call).

    The caller must pass exactly these types, including array layouts: nothing checks them.
    """
    # numba's own description of a record takes a millisecond to make
    key = function, *(_type_of(a) for a in arguments)
    if key not in _machine_codes:
        signature = tuple(numba.typeof(a) for a in arguments)
        function.compile(signature)
        _machine_codes[key] = function.get_overload(signature)
    return _machine_codes[key]


_machine_codes: dict[tuple[object, ...], Any] = {}
"""What `machine_code` has found, by function and types."""


def _type_of(argument: object) -> object:
    """What decides the compiled code for an argument: of an array the layout, otherwise the type."""
    if isinstance(argument, np.ndarray):
        return argument.dtype, argument.ndim, argument.flags.num
    if isinstance(argument, tuple):
        return type(argument), *map(_type_of, argument)
    return type(argument)


class _Cache(NullCache):
    """The cache of one compiled function, in place of numba's own.

    numba's watches the file of the loop only, and not those of the functions in it. It also keeps an index, which a
    truncated write or a renamed class makes unreadable, and which two processes that compile at once can spoil: it
    numbers the files.
    """

    def __init__(self, function: FunctionType) -> None:
        self._source = Path(inspect.getfile(function)).resolve()
        # environments that share a checkout must not remove, nor load, each other's files
        environment = (
            f"{sys.implementation.cache_tag}.numba-{numba.__version__}.numpy-{np.__version__}"
        )
        self._name = f"{function.__module__}.{function.__qualname__}.{environment}"

    @property
    def cache_path(self) -> str:
        return str(_folders()[0])

    def _files(self, signature: tuple[Any, ...], codegen: Any) -> list[Path]:
        """Names that end in SOURCES.TYPES.nbc. Files of this function with other SOURCES are out of date."""
        # the processor and its features: machine code for others may not run on this one
        types = digest(repr((signature, codegen.magic_tuple())).encode())
        return [
            folder / f"{self._name}.{sources(self._source)}.{types}.nbc" for folder in _folders()
        ]

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        # Machine code calls numba's runtime. numba's own way, `target_context.refresh`, prepares the whole compiler
        # for that: 1 s and 30 MB in each process.
        rtsys.initialize(target_context)
        for file in self._files(sig, target_context.codegen()):
            try:
                checksum, _, content = file.read_bytes().partition(b"\n")
                if (
                    _is_safe(file.parent)
                    and _is_safe(file)
                    and checksum == digest(content).encode()
                ):
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
                part = file.with_suffix(f".{os.getpid()}.part")
                try:
                    part.write_bytes(digest(content).encode() + b"\n" + content)
                    # whatever the umask: a file that a group may write is not loaded
                    part.chmod(0o644)
                    part.replace(file)
                finally:
                    part.unlink(missing_ok=True)  # as where the disk is full
                for old_file in file.parent.glob(f"{self._name}.*.nbc"):
                    if f".{sources(self._source)}." not in old_file.name:
                        old_file.unlink(missing_ok=True)
                return


@cache
def sources(file: Path) -> str:
    """Checksum of numba's version and of the sources that a file's code, also compiled, can be made of."""
    folders = [_PACKAGE / name for name in _SHARED_FOLDERS]
    if file.is_relative_to(_PACKAGE):
        folders.append(_PACKAGE / file.relative_to(_PACKAGE).parts[0])
    files = {file, *(source for folder in folders for source in folder.rglob("*.py"))}
    return digest(numba.__version__.encode(), *(source.read_bytes() for source in sorted(files)))


def _folders() -> list[Path]:
    """Where the machine code of this package may lie, the first choice first.

    NUMBA_CACHE_DIR, if it is set. Else `__pycache__` beside the package, and for who may not write there the user's
    cache. It does not lie inside the package: pip would leave it there when the package is removed, and Python would
    take the folder that is left for the package.
    """
    name = f"{_PACKAGE.name}_{digest(str(_PACKAGE).encode())}"
    if folder := numba.config.CACHE_DIR:
        return [Path(folder) / name]
    folders = [_PACKAGE.parent / "__pycache__"]
    with suppress(RuntimeError):  # a user without a home
        folders.append(
            Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "rft_ros" / name
        )
    return folders


def _is_safe(path: Path) -> bool:
    """Whether nobody but this user, or root, can have written it: what is loaded runs with the rights of this user.

    A link counts as what its owner made it: unsafe.
    """
    if not hasattr(os, "geteuid"):  # Windows: a user's folders are closed to others
        return True
    status = path.lstat()
    return (
        not S_ISLNK(status.st_mode)
        and status.st_uid in (0, os.geteuid())
        and not status.st_mode & 0o022
    )


@cache
def _warn_once(verb: str, cause: str) -> None:
    fault = f"numba {numba.__version__} cannot {verb} machine code, so that this process compiles it. {cause}"
    warnings.warn(fault, RuntimeWarning, stacklevel=2)


def digest(*parts: bytes) -> str:
    """Checksum of parts, in 16 characters; it tells where one ends and the next begins."""
    return hashlib.sha256(b"".join(hashlib.sha256(part).digest() for part in parts)).hexdigest()[
        :16
    ]
