"""Finds the file of a mesh: a path, a package:// or file:// URI, or the name of a shipped mesh."""

import os
from pathlib import Path
from urllib.parse import unquote

from rft_ros.errors import InputError, file_errors
from rft_ros.files import checked_file, expanded
from rft_ros.installation import share_directory

__all__ = ["advice", "checked_mesh", "is_mesh_path", "link_in", "locate_mesh"]

_SCHEMES = "package://", "file://"
_LINK = ".urdf#"  # between the file and the link of a robot


def is_mesh_path(file: str) -> bool:
    """Whether a value of `mesh.file` is a path, and not a package:// or file:// URI or the name of a shipped mesh."""
    return not file.startswith(_SCHEMES) and file != Path(file).stem


def link_in(file: str | os.PathLike[str]) -> str:
    """The link that ``robot.urdf#link`` names; "" in any other value of `mesh.file`."""
    return os.fspath(file).partition(_LINK)[2]


def locate_mesh(file: str | os.PathLike[str]) -> Path:
    """The path of the file in `mesh.file`: a path, a package://PACKAGE/PATH or file:///PATH URI, or a shipped mesh.

    A bare word, without folder or suffix, is always a shipped mesh. The file of ``robot.urdf#link`` is robot.urdf.
    Raises InputError for an unknown package or name.
    """
    if not isinstance(file, str | os.PathLike) or "\0" in unquote(os.fspath(file)):
        raise InputError(f"mesh.file is {file!r}; it must be a path or the name of a shipped mesh")
    file = os.fspath(file)
    if link_in(file):
        file = file[: file.index(_LINK)] + ".urdf"
    if file.startswith(_SCHEMES):
        scheme, _, place = file.partition("://")
        host, _, path = place.partition("/")
        if scheme == "package":
            with file_errors(f"mesh.file '{file}'", "read"):
                share = share_directory(host)
            if ".." in Path(unquote(path)).parts or Path(unquote(path)).is_absolute():
                raise InputError(f"mesh.file '{file}' leaves its package; give the path of the file itself")
            return share / unquote(path)
        if host not in ("", "localhost"):
            raise InputError(f"mesh.file '{file}' is on another machine, '{host}'; write file:///PATH")
        return Path(unquote(f"/{path}"))
    if not is_mesh_path(file):
        shipped = _shipped()
        if file in shipped:
            return shipped[file]
        raise InputError(f"mesh.file '{file}' is not a shipped mesh ({', '.join(shipped)}); a path needs its suffix")
    return expanded(file)


def _shipped() -> dict[str, Path]:
    """The shipped meshes, by name."""
    return {p.stem: p for p in sorted((share_directory("rft_ros") / "meshes").glob("*.stl"))}


def advice() -> str:
    """The end of the error for a mesh file that does not exist: what to give instead."""
    return f"give a path, or one of {', '.join(_shipped())}"


def checked_mesh(file: str) -> Path:
    """The path of the file in `mesh.file`, checked but not opened. Raises InputError."""
    return checked_file(locate_mesh(file), "mesh.file", advice=advice())
