"""Finds the file of a tool: a path, a package:// or file:// URI, a shipped mesh, or a robot that has a link."""

import os
import re
from pathlib import Path
from urllib.parse import unquote

from rft_ros.errors import InputError, file_errors
from rft_ros.files import checked_file, expanded
from rft_ros.installation import share_directory

_SCHEMES = "package://", "file://"
_BEFORE_LINK = re.compile(r"(?:(?<=\.urdf)|(?<=\.xacro))#")


def is_mesh_path(file: str) -> bool:
    """Whether a value of `mesh.file` is a path, and not a package:// or file:// URI or the name of a shipped mesh."""
    return not file.startswith(_SCHEMES) and file != Path(file).stem


def link_in(file: str | os.PathLike[str]) -> str:
    """The link that ``robot.urdf#link`` names; "" in any other value of `mesh.file`."""
    _, *link = _BEFORE_LINK.split(os.fspath(file), maxsplit=1)
    return "".join(link)


def locate_mesh(file: str | os.PathLike[str]) -> Path:
    """The path of the file in `mesh.file`: a path, a package://PACKAGE/PATH or file:///PATH URI, or a shipped mesh.

    A bare word, without folder or suffix, is always a shipped mesh. The file of ``robot.urdf#link`` is robot.urdf.
    Raises InputError for an unknown package or name.
    """
    if not isinstance(file, str | os.PathLike) or "\0" in unquote(os.fspath(file)):
        raise InputError(f"mesh.file is {file!r}; it must be a path or the name of a shipped mesh")
    place, *_ = _BEFORE_LINK.split(os.fspath(file), maxsplit=1)
    if place.startswith("package://"):
        return _in_package(place)
    if place.startswith("file://"):
        host, _, path = place.removeprefix("file://").partition("/")
        if host not in ("", "localhost"):
            raise InputError(
                f"mesh.file '{place}' is on another machine, '{host}'; write file:///PATH"
            )
        return Path(unquote(f"/{path}"))
    if is_mesh_path(place):
        return expanded(place)
    meshes = _shipped()
    if place not in meshes:
        raise InputError(
            f"mesh.file '{place}' is not a shipped mesh ({', '.join(meshes)}); a path needs its suffix"
        )
    return meshes[place]


def _in_package(uri: str) -> Path:
    package, _, quoted_path = uri.removeprefix("package://").partition("/")
    with file_errors(f"mesh.file '{uri}'", "read"):
        share = share_directory(package)
    path = Path(unquote(quoted_path))
    if ".." in path.parts or path.is_absolute():
        raise InputError(f"mesh.file '{uri}' leaves its package; give the path of the file itself")
    return share / path


def _shipped() -> dict[str, Path]:
    """The shipped meshes, by name."""
    return {p.stem: p for p in sorted((share_directory("rft_ros") / "meshes").glob("*.stl"))}


def checked_mesh(path: Path, what: str = "mesh file") -> Path:
    """The path of a `checked_file`. If it does not exist, the error names the shipped meshes."""
    return checked_file(path, what, advice=f"give a path, or one of {', '.join(_shipped())}")
