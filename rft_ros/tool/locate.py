"""Finds the files of a tool: a path, a package:// or file:// URI, a shipped mesh, or the meshes of a link of a URDF."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, file_errors, reason_of
from rft_ros.files import checked_file, expanded, read_text, resolved
from rft_ros.installation import share_directory

__all__ = ["LinkMesh", "advice", "checked_mesh", "files_of_mesh", "is_mesh_path", "link_in", "locate_mesh"]
__all__ += ["meshes_of_link"]

_SCHEMES = "package://", "file://"
_LINK = ".urdf#"  # between the file and the link of a robot
_KINDS = "collision", "visual"  # the first kind that has a mesh: what touches, or else what is drawn


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


class LinkMesh(NamedTuple):
    """A mesh of a link: a point p of the file, in metres, lies at rotation (p scale) + position in the link's frame.

    `scale`: of each axis, shape [3]. `rotation`: shape [3, 3]. `position` [m]: shape [3].
    """

    file: Path
    scale: NDArray[np.float64]
    rotation: NDArray[np.float64]
    position: NDArray[np.float64]


def files_of_mesh(file: str) -> list[Path]:
    """The files that `mesh.file` makes a tool from: one, or a URDF and the meshes of its link. Raises InputError."""
    path, link = locate_mesh(file), link_in(file)
    return [path, *(mesh.file for mesh in (meshes_of_link(path, link) if link else ()))]


def meshes_of_link(urdf: Path, link: str) -> list[LinkMesh]:
    """The collision meshes of a link, or its visual meshes if it has none. Raises InputError that names the file."""
    named = f"mesh file '{urdf}'"
    try:
        links = list(ElementTree.fromstring(read_text(urdf, "mesh file", advice=advice())).iter("link"))
    except ElementTree.ParseError as error:
        raise InputError(f"{named} is not XML: {reason_of(error)}; give a URDF file (xacro writes one)") from None
    found = {str(element.get("name")): list(_meshes(element, urdf, named)) for element in links}
    meshes = found.get(link)
    if not meshes:
        what = f"has no link '{link}'" if link not in found else f"has no mesh in its link '{link}'"
        usable = ", ".join(name for name, its in found.items() if its) or "none"
        wanted = what if link else "names no link"
        raise InputError(f"{named} {wanted}; write {urdf.name}#LINK, with one of its links that have a mesh: {usable}")
    return meshes


def _meshes(link: ElementTree.Element, urdf: Path, named: str) -> Iterator[LinkMesh]:
    from scipy.spatial.transform import Rotation

    by_kind = (link.findall(f"{kind}[geometry]") for kind in _KINDS)
    for element in next((some for some in by_kind if any(e.find("geometry/mesh") is not None for e in some)), ()):
        mesh, origin = element.find("geometry/mesh"), element.find("origin")
        if mesh is None:
            continue
        place = {} if origin is None else origin.attrib
        scale, turn, position = (
            _three(text, f"{named} has a {name} in its link '{link.get('name')}'")
            for name, text in (
                ("scale", mesh.get("scale", "1 1 1")),
                ("rpy", place.get("rpy", "0 0 0")),
                ("xyz", place.get("xyz", "0 0 0")),
            )
        )
        yield LinkMesh(
            _located(mesh.get("filename", ""), urdf), scale, Rotation.from_euler("xyz", turn).as_matrix(), position
        )


def _three(text: str, what: str) -> NDArray[np.float64]:
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise InputError(f"{what} that is '{text[:40]}'; it must be three numbers")
    return numbers


def _located(name: str, urdf: Path) -> Path:
    """The file that a URDF names. A package that is not installed or sourced is looked for above the URDF."""
    if "://" not in name:
        return urdf.parent / name
    try:
        return locate_mesh(name)
    except InputError:
        package, _, path = name.removeprefix("package://").partition("/")
        if name.startswith("package://") and ".." not in Path(unquote(path)).parts:
            for folder in resolved(urdf).parents:
                for place in (folder, folder / package):
                    if package in (place.name, _package_in(place)) and (place / unquote(path)).is_file():
                        return place / unquote(path)
        raise


def _package_in(folder: Path) -> str:
    """The name that a folder's package.xml gives; "" if there is none."""
    try:
        return ElementTree.fromstring(read_text(folder / "package.xml", "package")).findtext("name", "")
    except (InputError, ElementTree.ParseError):
        return ""
