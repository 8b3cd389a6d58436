"""Where files live: paths, package:// URIs and the names of shipped meshes, with and without ROS installed."""

from pathlib import Path

from rft_ros.errors import InputError
from rft_ros.installation import share_directory

__all__ = ["locate_mesh", "shipped_meshes"]

_SCHEME = "package://"


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
