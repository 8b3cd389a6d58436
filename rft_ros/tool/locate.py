"""Where files live: paths, package:// URIs and the names of shipped meshes, with and without ROS installed."""

import os
import sys
import sysconfig
from pathlib import Path
from xml.etree import ElementTree

from rft_ros.errors import InputError

__all__ = ["locate_mesh", "share_directory", "shipped_meshes"]

_SCHEME = "package://"


def share_directory(package: str) -> Path:
    """The package's share folder, which holds its meshes, configuration and launch files.

    Prefixes in AMENT_PREFIX_PATH come first, as in ROS. Next, if rft_ros runs from a source checkout, the checkout:
    its files belong to the running code, those of an older installation do not. Last, where pip puts data files.
    Raises InputError if the package is in none.
    """
    for folder in _candidates(package) if package.strip(".") else []:
        if folder.is_dir():
            return folder
    overlays = os.environ.get("AMENT_PREFIX_PATH") or "not set"
    raise InputError(f"package '{package}' has no share folder in AMENT_PREFIX_PATH ({overlays}) or {sys.prefix}")


def _candidates(package: str) -> list[Path]:
    overlays = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    user = sysconfig.get_path("data", sysconfig.get_preferred_scheme("user"))
    installed = [Path(sys.prefix), Path(sysconfig.get_path("data")), Path(user)]
    return [
        *(prefix / "share" / package for prefix in overlays),
        *_checkout(package),
        *(prefix / "share" / package for prefix in installed),
    ]


def _checkout(package: str) -> list[Path]:
    """The folder above this Python package, if its package.xml says that it is `package`."""
    folder = Path(__file__).resolve().parents[2]
    try:
        name = ElementTree.parse(folder / "package.xml").findtext("name", "")
    except (OSError, ElementTree.ParseError):
        return []
    return [folder] if name.strip() == package else []


def shipped_meshes() -> dict[str, Path]:
    """Files of the meshes that come with rft_ros, by name."""
    return {p.stem: p for p in sorted((share_directory("rft_ros") / "meshes").glob("*.stl"))}


def locate_mesh(file: str) -> Path:
    """The mesh file that `mesh.file` means: a path (also ~), a package://PACKAGE/PATH URI or a shipped mesh's name.

    A bare word, without folder or suffix, is always a shipped mesh. That the file exists is for `read_mesh` to check.
    Raises InputError for an unknown package or name.
    """
    if file.startswith(_SCHEME):
        package, _, inside = file.removeprefix(_SCHEME).partition("/")
        return share_directory(package) / inside
    if file == Path(file).stem:
        shipped = shipped_meshes()
        if file in shipped:
            return shipped[file]
        raise InputError(
            f"mesh.file '{file}' is no shipped mesh ({', '.join(shipped)}), nor the path of a mesh file, "
            f"nor a {_SCHEME} URI"
        )
    try:
        return Path(file).expanduser()
    except RuntimeError as error:
        raise InputError(f"mesh.file '{file}' names no home folder: {error}") from None
