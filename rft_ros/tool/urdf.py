"""The shapes of a link of a URDF, each with its place in the link: mesh files, boxes, cylinders, spheres, capsules."""

import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from rft_ros.errors import InputError, reason_of, shown
from rft_ros.files import read_text, resolved
from rft_ros.tool import solids
from rft_ros.tool.locate import advice, link_in, locate_mesh

Array = NDArray[np.float64]

ROBOT_SUFFIXES = ".urdf", ".xacro"
"""Suffixes of descriptions of robots."""

_KINDS = (
    "collision",
    "visual",
)  # the first kind that a link has: what touches, or else what is drawn
_SOLIDS: dict[str, tuple[tuple[str, ...], Callable[..., Array]]] = {
    "box": (("size",), lambda size: solids.box(0.5 * size)),
    "sphere": (("radius",), lambda radius: solids.ellipsoid((radius, radius, radius))),
    "cylinder": (
        ("radius", "length"),
        lambda radius, length: solids.cylinder(radius, 0.5 * length),
    ),
    "capsule": (("radius", "length"), lambda radius, length: solids.capsule(radius, 0.5 * length)),
}
"""By the element of a solid: its attributes, and the function of their values [m] that makes its triangles."""

_XACRO_SECONDS = 60.0


class LinkShape(NamedTuple):
    """A shape of a link: a point p of it, in metres, lies at rotation (p scale) + position in the link's frame.

    `source`: a mesh file, or triangles [m], shape [n, 3, 3]. `scale`: of each axis, shape [3]. `rotation`: shape
    [3, 3]. `position` [m]: shape [3].
    """

    source: Path | Array
    scale: Array
    rotation: Array
    position: Array


def files_of_mesh(file: str) -> list[Path]:
    """The files that `mesh.file` makes a tool from: one, or a URDF and the meshes of its link. Raises InputError."""
    path = locate_mesh(file)
    link = link_in(file)
    sources = [shape.source for shape in shapes_of_link(path, link)] if link else []
    return [path, *(source for source in sources if isinstance(source, Path))]


def shapes_of_link(urdf: Path, link: str) -> list[LinkShape]:
    """The collision shapes of a link, or its visual shapes if it has none. Raises InputError that names the file.

    A file that ends in .xacro is expanded by the program xacro. Other links are not looked at: their meshes may be in
    packages that are not installed.
    """
    named = f"mesh file '{urdf}'"
    try:
        links = list(ElementTree.fromstring(_text(urdf, named)).iter("link"))
    except ElementTree.ParseError as error:
        raise InputError(
            f"{named} is not XML: {reason_of(error)}; give a URDF file (xacro writes one)"
        ) from None
    by_name = {str(element.get("name")): _elements(element) for element in links}
    elements = by_name.get(link)
    if not elements:
        usable = ", ".join(name for name, its in by_name.items() if its) or "none"
        wanted = _missing(link, is_there=link in by_name)
        raise InputError(
            f"{named} {wanted}; write {urdf.name}#LINK, with one of its links that have a shape: {usable}"
        )
    return [_shape(element, urdf, f"{named} has in its link '{link}'") for element in elements]


def _text(urdf: Path, named: str) -> str:
    """The URDF as text, expanded if it is a xacro file."""
    text = read_text(urdf, "mesh file", advice=advice())
    if urdf.suffix.lower() != ".xacro":
        return text
    program = shutil.which("xacro")
    if program is None:
        expanded = urdf.with_suffix("").name
        raise InputError(
            f"{named} needs xacro, which is not installed; expand it with xacro: xacro FILE -o {expanded}"
        )
    try:
        done = subprocess.run(
            [program, str(urdf)],
            capture_output=True,
            text=True,
            timeout=_XACRO_SECONDS,
            check=True,
        )
    except subprocess.CalledProcessError as error:
        raise InputError(
            f"{named} cannot be expanded by xacro: {shown(error.stderr.strip())}"
        ) from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(f"{named} cannot be expanded by xacro: {reason_of(error)}") from None
    return done.stdout


def _elements(link: ElementTree.Element) -> list[ElementTree.Element]:
    """The collision elements of a link with a known geometry, or its visual ones if it has none."""
    for kind in _KINDS:
        found = [element for element in link.findall(kind) if _has_shape(element)]
        if found:
            return found
    return []


def _has_shape(element: ElementTree.Element) -> bool:
    known = ("mesh", *_SOLIDS)
    return any(element.find(f"geometry/{name}") is not None for name in known)


def _missing(link: str, *, is_there: bool) -> str:
    if not link:
        return "names no link"
    return f"has no shape in its link '{link}'" if is_there else f"has no link '{link}'"


def _shape(element: ElementTree.Element, urdf: Path, where: str) -> LinkShape:
    from scipy.spatial.transform import Rotation

    origin = element.find("origin")
    place = {} if origin is None else origin.attrib
    turn = _numbers(place, "rpy", where, default="0 0 0")
    position = _numbers(place, "xyz", where, default="0 0 0")
    rotation = Rotation.from_euler("xyz", turn).as_matrix()
    mesh = element.find("geometry/mesh")
    if mesh is not None:
        scale = _numbers(mesh.attrib, "scale", where, default="1 1 1")
        return LinkShape(_located(mesh.get("filename", ""), urdf), scale, rotation, position)
    return LinkShape(_triangles(element, where), np.ones(3), rotation, position)


def _triangles(element: ElementTree.Element, where: str) -> Array:
    """The triangles of a solid [m]."""
    for name, (attributes, make) in _SOLIDS.items():
        solid = element.find(f"geometry/{name}")
        if solid is None:
            continue
        values = []
        for attribute in attributes:
            value = _numbers(solid.attrib, attribute, where, count=3 if attribute == "size" else 1)
            if not (value > 0.0).all():
                raise InputError(
                    f"{where} a {name} whose {attribute} is {value.tolist()}; it must be positive"
                )
            values.append(value if attribute == "size" else float(value[0]))
        return make(*values)
    raise InputError(f"{where} a shape without a known geometry")


def _numbers(
    attributes: dict[str, str], name: str, where: str, *, default: str = "", count: int = 3
) -> Array:
    text = attributes.get(name, default)
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.empty(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        must = "three numbers" if count == 3 else "a number"
        raise InputError(f"{where} a {name} that is '{text[:40]}'; it must be {must}")
    return numbers


def _located(name: str, urdf: Path) -> Path:
    """The file that a URDF names. A package that is not installed or sourced is looked for above the URDF."""
    uri = re.sub(r"^\$\(find ([^)]+)\)", r"package://\1", name)  # which xacro would replace
    if "://" not in uri:
        return urdf.parent / uri
    try:
        return locate_mesh(uri)
    except InputError:
        package, _, path = uri.removeprefix("package://").partition("/")
        if uri.startswith("package://") and ".." not in Path(unquote(path)).parts:
            for folder in resolved(urdf).parents:
                for place in (folder, folder / package):
                    if (
                        package in (place.name, _package_in(place))
                        and (place / unquote(path)).is_file()
                    ):
                        return place / unquote(path)
        raise


def _package_in(folder: Path) -> str:
    """The name that a folder's package.xml gives; "" if there is none."""
    try:
        return ElementTree.fromstring(read_text(folder / "package.xml", "package")).findtext(
            "name", ""
        )
    except (InputError, ElementTree.ParseError):
        return ""
