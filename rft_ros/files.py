"""Files that a user or a parameter names: read within limits, written whole or not at all, never over an input.

Every path that a parameter or a command takes is read here: `checked_file` refuses what is no regular file of a size
within limits before it is opened, and says in one sentence what to give instead (test/unit/test_paths.py).
"""

import io
import os
import shutil
import stat
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, file_errors, reason_of

MAX_BYTES = 256 * 2**20  # of a file, and of the unpacked arrays of an NPZ file
_GIVE = "give the path of one that does"


def expanded(file: Path | str) -> Path:
    """The path with ~ replaced by the home folder. The ~ of an unknown user stays as it is."""
    return Path(os.path.expanduser(file))  # noqa: PTH111 - Path's own raises RuntimeError for an unknown user


def resolved(file: Path | str) -> Path:
    """The absolute path, ~ expanded and symbolic links followed; a loop of links stays as it is."""
    # Path.resolve raises RuntimeError for a loop before Python 3.13
    return Path(os.path.realpath(expanded(file)))


def checked_file(
    file: Path, what: str, *, limit: int | None = MAX_BYTES, advice: str = _GIVE
) -> Path:
    """The path, ~ expanded, of a regular file of 1 to `limit` bytes (None: any number). Does not open the file.

    Raises InputError. It calls the file `what`, such as the option or parameter that names it, and says what to do.
    `advice`: what to do if the file does not exist.
    """
    label = f"{what} '{file}'"
    path = expanded(file)
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise InputError(f"{label} does not exist; {advice}") from None
    except (OSError, ValueError) as error:  # ValueError: a null character
        raise InputError(
            f"{label} cannot be read: {reason_of(error)}; give the path of a file that can be"
        ) from None
    if not stat.S_ISREG(status.st_mode):  # to open a pipe or a device may block
        kind = "a folder" if stat.S_ISDIR(status.st_mode) else "a pipe, socket or device"
        raise InputError(f"{label} is {kind}; give a regular file")
    # the system's own files have no size either, and reading /proc/kmsg may block for ever
    if not status.st_size:
        raise InputError(
            f"{label} is empty, or one of the system's own files, as in /proc; give a file with content"
        )
    if limit is not None:
        _check_size(status.st_size, label, limit)
    return path


def _check_size(size: int, label: str, limit: int) -> None:
    if size > limit:
        raise InputError(
            f"{label} has {size / 2**20:.0f} MiB or more; "
            f"the limit is {limit / 2**20:.0f} MiB; give a smaller one"
        )


def read_file(file: Path, what: str, *, limit: int = MAX_BYTES) -> bytes:
    """The bytes of a `checked_file`."""
    path = checked_file(file, what, limit=limit)
    with file_errors(f"{what} '{file}'", "read"), path.open("rb") as stream:
        return stream.read(limit)


def read_text(file: Path, what: str, *, limit: int = MAX_BYTES) -> str:
    """The text of a `checked_file` in UTF-8; a byte order mark is dropped."""
    data = read_file(file, what, limit=limit)
    with file_errors(f"{what} '{file}'", "read"):
        return data.decode("utf-8-sig")


def read_arrays(file: Path, what: str, names: Sequence[str]) -> list[NDArray[Any]]:
    """The named arrays of a `checked_file` in NPZ format, of any shape and unit, at most 256 MiB in all.

    Raises InputError, also for arrays of Python objects.
    """
    label = f"{what} '{file}'"
    data = io.BytesIO(read_file(file, what))
    try:
        with zipfile.ZipFile(data) as archive:
            unpacked_size = sum(member.file_size for member in archive.infolist())
        _check_size(unpacked_size, f"{label} unpacked", MAX_BYTES)
        with np.load(data, allow_pickle=False) as arrays:
            contents = [arrays[name] for name in names]
    except InputError:
        raise
    # zip's and numpy's readers raise almost anything on damage, and numpy advises to unpickle
    except Exception:
        raise InputError(
            f"{label} is not a valid NPZ file with the arrays of numbers {', '.join(names)}; "
            "write it again with numpy.savez"
        ) from None
    for values in contents:
        _check_size(8 * values.size, f"{label} as numbers of eight bytes", MAX_BYTES)
    return contents


@contextmanager
def replacing(file: Path) -> Iterator[Path]:
    """Yield a path beside `file`, to be written; at the end of the block this new file takes the place of `file`.

    No process ever reads half a file. After an exception `file` stays as it was. Makes the folder. The part is created
    anew and follows no link, also in a folder that others may write. Raises OSError.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    part = file.with_name(f".{file.stem}.{os.getpid()}.part{file.suffix}")
    part.unlink(missing_ok=True)  # of a process that was killed
    part.touch(exist_ok=False)
    try:
        yield part
        part.replace(file)
    finally:
        part.unlink(missing_ok=True)


@contextmanager
def whole(file: Path, what: str = "output") -> Iterator[Path]:
    """Yield a new file beside `file`, which replaces it at the end of the block. After an exception the old one stays.

    Makes the folder. A path that is no regular file, such as /dev/stdout, is written directly. Raises InputError.
    """
    with file_errors(f"{what} '{file}'", "written"):
        if file.exists() and not file.is_file():
            yield file
            return
        place = resolved(file)
        if place.is_symlink():
            raise InputError(f"{what} '{file}' is a loop of symbolic links; give another path")
        with replacing(place) as part:
            yield part
            if place.exists():
                shutil.copymode(place, part)


@contextmanager
def whole_folder(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """Yield a new folder in `folder`. At the end its content moves to `folder`, where `names` are removed first.

    After an exception what was in `folder` stays as it was.
    """
    with file_errors(f"output folder '{folder}'", "written"):
        folder.mkdir(parents=True, exist_ok=True)
        part = Path(mkdtemp(prefix=".", suffix=".part", dir=folder))
        try:
            yield part
            for name in names:
                _remove(folder / name)
            for new in part.iterdir():
                new.replace(folder / new.name)
        finally:
            shutil.rmtree(part)


def _remove(place: Path) -> None:
    """Remove a file or folder, if it is there; of a link, not what it points to."""
    if place.is_dir() and not place.is_symlink():
        shutil.rmtree(place)
    place.unlink(missing_ok=True)


def refuse_overwriting(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise InputError where an output is an input, or one lies inside the other."""
    input_paths = [resolved(file) for file in inputs]
    for output in outputs:
        place = resolved(output)
        for file in input_paths:
            if place == file or place in file.parents or file in place.parents:
                raise InputError(
                    f"'{output}' would overwrite the input '{file}' or lie inside it; give another one"
                )
