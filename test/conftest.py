"""What all tests share: the reference data, repeatable hypothesis runs, children that hear SIGINT and start fast."""

import os
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings

# The first example compiles the kernel: no deadline. The same examples every time: a failure is a change, not luck.
settings.register_profile("rft", deadline=None, derandomize=True)
settings.load_profile("rft")

# Jobs that a shell started in the background ignore SIGINT, and so do their children. A handler ends that: a child
# begins with the default action instead.
signal.signal(signal.SIGINT, signal.default_int_handler)

# Hundreds of child processes import the package: with its bytecode on disk each starts a second sooner.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of reference data that lies beside the project, never in it."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"the reference data is not at {SHARED_DATA}")
    return SHARED_DATA
