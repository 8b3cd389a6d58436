"""The shapes of a link of a URDF, each with its place in the link: mesh files, boxes, cylinders, spheres, capsules."""

import re
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
from rft_ros.tool.locate import checked_mesh, link_in, locate_mesh

Array = NDArray[np.float64]

ROBOT_SUFFIXES = ".urdf", ".xacro"
"""Suffixes of descriptions of robots."""

_SOLIDS: dict[str, tuple[Callable[..., Array], dict[str, float]]] = {
    "box": (solids.box, {"size": 0.5}),
    "sphere": (solids.ellipsoid, {"radius": 1.0}),
    "cylinder": (solids.cylinder, {"radius": 1.0, "length": 0.5}),
    "capsule": (solids.capsule, {"radius": 1.0, "length": 0.5}),
}
"""By the element of a solid: what makes its triangles, and of which attributes [m], each times a factor."""

_XACRO_TIMEOUT_S = 60.0


class LinkShape(NamedTuple):
    """A shape of a link. `source`: a mesh file, or triangles, shape [n, 3, 3]; in metres.

    `to_link`: the homogeneous matrix that scales it and places it in the link's frame, shape [4, 4].
    """

    source: Path | Array
    to_link: Array


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
    source_name = f"mesh file '{urdf}'"
    try:
        links = list(ElementTree.fromstring(_text(urdf, source_name)).iter("link"))
    except ElementTree.ParseError as error:
        raise InputError(
            f"{source_name} is not XML: {reason_of(error)}; give a URDF file (xacro writes one)"
        ) from None
    shapes = {str(element.get("name")): _shapes(element) for element in links}
    if not shapes.get(link):
        usable = ", ".join(name for name, its in shapes.items() if its) or "none"
        raise InputError(
            f"{source_name} has no link '{link}' with a shape; write {urdf.name}#LINK, "
            f"with one of its links that have one: {usable}"
        )
    return [
        _placed(shape, geometry, urdf, f"{source_name} has in its link '{link}'")
        for shape, geometry in shapes[link]
    ]


def _text(urdf: Path, source_name: str) -> str:
    """The URDF as text, expanded if it is a xacro file."""
    text = read_text(checked_mesh(urdf), "mesh file")
    if urdf.suffix.lower() != ".xacro":
        return text
    try:
        return subprocess.run(
            ["xacro", str(urdf)],
            capture_output=True,
            text=True,
            timeout=_XACRO_TIMEOUT_S,
            check=True,
        ).stdout
    except FileNotFoundError:
        urdf_name = urdf.with_suffix("").name
        raise InputError(
            f"{source_name} needs xacro, which is not installed; expand it with xacro: xacro FILE -o {urdf_name}"
        ) from None
    except subprocess.CalledProcessError as error:
        raise InputError(
            f"{source_name} cannot be expanded by xacro: {shown(error.stderr.strip())}"
        ) from None
    except (OSError, subprocess.TimeoutExpired) as error:
        raise InputError(
            f"{source_name} cannot be expanded by xacro: {reason_of(error)}"
        ) from None


def _shapes(link: ElementTree.Element) -> list[tuple[ElementTree.Element, ElementTree.Element]]:
    """The collision shapes of a link, each with its mesh or solid: what touches; or else the visual ones."""
    known_tags = ("mesh", *_SOLIDS)
    for kind in ("collision", "visual"):
        shapes = [
            (shape, part_geometry)
            for shape in link.findall(kind)
            for part_geometry in shape.iterfind("geometry/*")
        ]
        usable = [(shape, geometry) for shape, geometry in shapes if geometry.tag in known_tags]
        if usable:
            return usable
    return []


def _placed(
    shape: ElementTree.Element, geometry: ElementTree.Element, urdf: Path, where: str
) -> LinkShape:
    from trimesh.transformations import compose_matrix

    origin = shape.find("origin")
    place = {} if origin is None else origin.attrib
    to_link = compose_matrix(
        scale=_numbers(geometry.attrib, "scale", where, default="1 1 1"),
        angles=_numbers(place, "rpy", where, default="0 0 0"),
        translate=_numbers(place, "xyz", where, default="0 0 0"),
    )
    if geometry.tag == "mesh":
        return LinkShape(_located(geometry.get("filename", ""), urdf), to_link)
    triangles_of, factors = _SOLIDS[geometry.tag]
    sizes = []
    for name, factor in factors.items():
        size = _numbers(geometry.attrib, name, where, count=3 if name == "size" else 1)
        if not (size > 0.0).all():
            raise InputError(f"{where} a {name} that is {size.tolist()}; it must be positive")
        sizes.append(factor * size.squeeze())
    return LinkShape(triangles_of(*sizes), to_link)


def _numbers(
    attributes: dict[str, str], name: str, where: str, *, default: str = "", count: int = 3
) -> Array:
    text = attributes.get(name, default)
    try:
        numbers = np.array(text.split(), dtype=np.float64)
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
        scheme, _, place = uri.partition("://")
        package, _, quoted_path = place.partition("/")
        path = Path(unquote(quoted_path))
        if scheme != "package" or not package.strip(".") or not _stays_inside(path):
            raise
        for folder in resolved(urdf).parents:
            root = folder if _package_in(folder) == package else folder / package
            if (root / path).is_file():
                return root / path
        raise


def _stays_inside(path: Path) -> bool:
    """Whether a path from a package's folder leads to a place in it."""
    return not path.is_absolute() and ".." not in path.parts


def _package_in(folder: Path) -> str:
    """The name that a folder's package.xml gives; "" if there is none."""
    try:
        return ElementTree.fromstring(read_text(folder / "package.xml", "package")).findtext(
            "name", ""
        )
    except (InputError, ElementTree.ParseError):
        return ""
