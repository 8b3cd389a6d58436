"""Files that a user or a parameter names: read within limits, written whole or not at all, never over an input."""

import io
import os
import re
import shutil
import stat
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from rft_ros.errors import InputError, file_errors, reason_of

__all__ = ["checked_file", "expanded", "read_arrays", "read_columns", "read_file", "read_text"]
__all__ += ["read_yaml", "refuse_overwriting", "whole", "whole_folder"]

_MAX_BYTES = 256 * 2**20  # that are read of a file, or that the arrays of an NPZ file may have
_MAX_YAML = 2**20


def expanded(file: Path | str) -> Path:
    """The path with ~ as the home folder; one that begins with an unknown user's ~ stays as it is."""
    return Path(os.path.expanduser(file))  # noqa: PTH111 - Path's own raises RuntimeError for an unknown user


def checked_file(file: Path, what: str, *, limit: int = _MAX_BYTES) -> Path:
    """The path, ~ expanded, of a regular file of at most `limit` bytes, unopened; InputError calls it `what`."""
    with file_errors(f"{what} '{file}'", "read"):
        path = expanded(file)
        status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise InputError(f"{what} '{file}' is {'a folder' if stat.S_ISDIR(status.st_mode) else 'not a regular file'}")
    _check_size(status.st_size, f"{what} '{file}'", limit)
    return path


def _check_size(size: int, what: str, limit: int) -> None:
    if size > limit:
        raise InputError(f"{what} has {size / 2**20:.0f} MiB or more; the limit is {limit / 2**20:.0f} MiB")


def read_file(file: Path, what: str, *, limit: int = _MAX_BYTES) -> bytes:
    """The bytes of a `checked_file`."""
    path = checked_file(file, what, limit=limit)
    with file_errors(f"{what} '{file}'", "read"), path.open("rb") as stream:
        data = stream.read(limit + 1)
    _check_size(len(data), f"{what} '{file}'", limit)  # the system's own files, as in /proc, had no size before
    return data


def read_text(file: Path, what: str, *, limit: int = _MAX_BYTES) -> str:
    """The text of a `checked_file` in UTF-8; a byte order mark is dropped."""
    data = read_file(file, what, limit=limit)
    with file_errors(f"{what} '{file}'", "read"):
        return data.decode("utf-8-sig")


def read_arrays(file: Path, what: str, names: Sequence[str]) -> list[NDArray[Any]]:
    """Arrays of a `checked_file` in NPZ format, by name, of any shape and unit; no objects, at most 256 MiB."""
    data = read_file(file, what)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            _check_size(sum(member.file_size for member in archive.infolist()), f"{what} '{file}' unpacked", _MAX_BYTES)
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            return [arrays[name] for name in names]
    except InputError:
        raise
    except Exception:  # zip's and numpy's readers raise almost anything on damage, and numpy advises to unpickle
        wanted = f"NPZ file with the arrays of numbers {', '.join(names)}"
        raise InputError(f"{what} '{file}' is not a valid {wanted}") from None


def read_columns(file: Path, what: str, names: Sequence[str]) -> tuple[NDArray[Any], list[int]]:
    """Numbers of a `checked_file` in CSV format, shape [n, columns], any unit; and the line of each row, from 1.

    Columns as in `names`; the file's header has them in any order, and may have others. InputError quotes no content.
    """
    lines = read_text(file, what).splitlines()
    header = [name.strip() for name in lines[0].split(",")] if lines else []
    for name in (*names, *header):
        if header.count(name) != 1:
            count = "several columns" if name in header else "no column"
            raise InputError(f"{what} '{file}' has {count} {name}; its first line must name {','.join(names)}")
    numbered = [number for number, line in enumerate(lines[1:], start=2) if line.strip()]
    if not numbered:
        raise InputError(f"{what} '{file}' has a header and no rows; it needs at least one")
    table = np.empty((len(numbered), len(header)))
    for row, number in zip(table, numbered, strict=True):
        try:
            cells = list(map(float, lines[number - 1].split(",")))
        except ValueError:
            cells = []
        if len(cells) != len(header):
            raise InputError(f"{what} '{file}' line {number} is not {len(header)} numbers")
        row[:] = cells
    return table[:, [header.index(name) for name in names]], numbered


class _Loader(yaml.SafeLoader):
    """Reads 1e-4 and 1.0e4 as numbers, as ROS does; PyYAML reads strings. Refuses aliases, as ROS does."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            line = self.peek_event().start_mark.line + 1  # type: ignore[no-untyped-call]
            raise yaml.YAMLError(f"line {line} has an alias (*), which ROS does not read; write its values out")
        return super().compose_node(parent, index)


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"), list("-+.0123456789")
)


def read_yaml(file: Path, what: str) -> Any:
    """Content of a YAML file. InputError, which calls the file `what`, where it cannot be read or is not YAML."""
    text = read_text(file, what, limit=_MAX_YAML)
    try:
        return yaml.load(text, Loader=_Loader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:  # ValueError: the 99th day of a month
        raise InputError(f"{what} '{file}' is not YAML: {reason_of(error)}") from None


@contextmanager
def whole(file: Path, what: str = "output") -> Iterator[Path]:
    """A new file beside `file`, which takes its place at the end of the block; after an exception, the old one stays.

    Makes the folder. What is no regular file, such as /dev/stdout, is written directly. Raises InputError.
    """
    with file_errors(f"{what} '{file}'", "written"):
        if file.exists() and not file.is_file():
            yield file
            return
        place = file.resolve()
        place.parent.mkdir(parents=True, exist_ok=True)
        part = place.with_name(f".{place.stem}.{os.getpid()}.part{place.suffix}")
        try:
            yield part
            if place.exists():
                shutil.copymode(place, part)
            part.replace(place)
        finally:
            part.unlink(missing_ok=True)


@contextmanager
def whole_folder(folder: Path, names: Sequence[str]) -> Iterator[Path]:
    """A new folder in `folder`; its content takes the place of `names` there at the end, but after an exception."""
    with file_errors(f"output folder '{folder}'", "written"):
        part = folder / f".{os.getpid()}.part"
        part.mkdir(parents=True)
        try:
            yield part
            for old in (folder / name for name in names):
                if old.is_dir() and not old.is_symlink():
                    shutil.rmtree(old)
                old.unlink(missing_ok=True)
            for new in part.iterdir():
                new.replace(folder / new.name)
        finally:
            shutil.rmtree(part)


def refuse_overwriting(outputs: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Raise InputError where an output is an input, or one lies inside the other."""
    taken = [expanded(file).resolve() for file in inputs]
    for output in outputs:
        place = output.resolve()
        for file in taken:
            if place == file or place in file.parents or file in place.parents:
                raise InputError(f"'{output}' would overwrite the input '{file}' or lie inside it; give another one")
