"""The meshes of a link in a URDF file, each with its place in the link's frame."""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, reason_of
from rft_ros.files import read_text, resolved
from rft_ros.tool.locate import advice, link_in, locate_mesh

__all__ = ["LinkMesh", "files_of_mesh", "meshes_of_link"]

_KINDS = "collision", "visual"  # the first kind that has a mesh: what touches, or else what is drawn


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
