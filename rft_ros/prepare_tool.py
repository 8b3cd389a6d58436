"""``python -m rft_ros.prepare_tool FILE SCALE X Y Z OUT``: load and check a tool and leave it in the folder OUT.

The node runs this beside itself when its mesh is swapped. On failure it prints one sentence and ends with status 2.
A tool's arrays lie in a file of their own, which the node maps: reading 9 MB would hold up a tick for 5 ms.
"""

import mmap
import pickle
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rft_ros.errors import InputError

if TYPE_CHECKING:
    from rft_ros.tool import Tool

__all__ = ["read_tool", "write_tool"]


_ALIGNMENT = 64


def write_tool(folder: Path, tool: "Tool") -> None:
    """Write a tool for `read_tool`."""
    spans: list[tuple[int, int]] = []
    with (folder / "arrays").open("wb") as arrays:

        def keep(buffer: pickle.PickleBuffer) -> None:
            arrays.write(b"\0" * (-arrays.tell() % _ALIGNMENT))
            start = arrays.tell()
            arrays.write(buffer.raw())
            spans.append((start, arrays.tell()))

        head = pickle.dumps(tool, protocol=5, buffer_callback=keep)
    (folder / "tool").write_bytes(pickle.dumps((head, spans)))


def read_tool(folder: Path) -> "Tool":
    """The tool in a folder; its arrays stay in the mapped file, which may be deleted."""
    head, spans = pickle.loads((folder / "tool").read_bytes())
    with (folder / "arrays").open("rb") as arrays:
        view = memoryview(mmap.mmap(arrays.fileno(), 0, access=mmap.ACCESS_READ))
    tool: Tool = pickle.loads(head, buffers=[view[start:end] for start, end in spans])
    return tool


def main() -> int:
    """Run the command."""
    from rft_ros.tool import load_tool

    file, scale, x, y, z, out = sys.argv[1:]
    try:
        tool = load_tool(file, scale=float(scale), origin=(float(x), float(y), float(z)))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    write_tool(Path(out), tool)
    return 0


if __name__ == "__main__":
    sys.exit(main())
