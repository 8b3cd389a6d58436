"""``python -m rft_ros.tool.prepare FILE SCALE X Y Z OUT``: load and check a tool and pickle it to OUT.

The node runs this beside itself when its mesh is swapped. On failure it prints one sentence and ends with status 2.
"""

import os
import pickle
import sys
from pathlib import Path

from rft_ros.errors import InputError
from rft_ros.tool import load_tool


def main() -> int:
    """Run the command."""
    file, scale, x, y, z, out = sys.argv[1:]
    os.nice(5)  # the ticks come first
    try:
        tool = load_tool(file, scale=float(scale), origin=(float(x), float(y), float(z)))
    except InputError as error:
        print(error, file=sys.stderr)
        return 2
    Path(out).write_bytes(pickle.dumps(tool, protocol=5))
    return 0


if __name__ == "__main__":
    sys.exit(main())
