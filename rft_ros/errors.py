"""The one exception that every room raises for input it cannot use."""

__all__ = ["InputError"]


class InputError(ValueError):
    """Input that cannot be used: one sentence that names the file or field and the value.

    The command line prints it and exits with status 2; the node logs it and keeps what it had.
    """
