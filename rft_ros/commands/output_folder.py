"""The output folder of a long computation."""

import tempfile
from pathlib import Path

from rft_ros.errors import InputError, reason_of

__all__ = ["make_output_folder"]


def make_output_folder(folder: Path) -> None:
    """Make the folder before the work begins; InputError where it cannot be made or written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):  # permissions alone do not decide
            pass
    except OSError as error:
        raise InputError(f"output folder '{folder}' cannot be written: {reason_of(error)}") from None
