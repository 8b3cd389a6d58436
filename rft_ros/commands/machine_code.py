"""Machine code for a command, with lines while it compiles."""

from rft_ros.estimator.warm_up import PARTS, prepare
from rft_ros.progress import line_if_long, say_compiling


def load_code(parts: frozenset[str] = PARTS) -> None:
    """Load these parts of the machine code, or compile them at the first run."""
    with line_if_long("loading or compiling code"):
        prepare(parts, on_cold_cache=say_compiling)
