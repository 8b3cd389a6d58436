"""The exception for unusable input, and the wording of file errors."""

__all__ = ["InputError", "reason_of"]


class InputError(ValueError):
    """Input that cannot be used: one sentence that names the file or field and the value.

    The command line prints it and exits with status 2; the node logs it and keeps what it had.
    """


def reason_of(error: Exception) -> str:
    """Why a file could not be used, without its name."""
    if isinstance(error, UnicodeDecodeError):
        return "it is not UTF-8 text"
    return (isinstance(error, OSError) and error.strerror) or str(error)
