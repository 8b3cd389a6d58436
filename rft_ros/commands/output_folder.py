"""The folder that a long piece of work will write to."""

import tempfile
from pathlib import Path

from rft_ros.errors import InputError, reason_of

__all__ = ["make_output_folder"]


def make_output_folder(folder: Path) -> None:
    """Make the folder, before the work begins; InputError where it cannot be made or takes no files."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):  # a folder's permissions are not all that decides
            pass
    except OSError as error:
        raise InputError(f"output folder '{folder}' cannot be written: {reason_of(error)}") from None
