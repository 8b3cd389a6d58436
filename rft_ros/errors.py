"""The exception for unusable input, and the reasons for which a file cannot be used."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

_MAX_SHOWN_CHARACTER_COUNT = 100


class InputError(ValueError):
    """Input that cannot be used: one sentence that names the file or field and the value.

    The command line prints it and exits with status 2; the node logs it and keeps what it had.
    """


def reason_of(error: Exception) -> str:
    """Why a file could not be used, without its name, in one line and without a full stop."""
    if isinstance(error, UnicodeDecodeError):
        return "it is not UTF-8 text"
    text = (isinstance(error, OSError) and error.strerror) or str(error)
    return " ".join(text.split()).rstrip(".") or type(error).__name__


def shown(value: object) -> str:
    """A value as a sentence shows it: as Python writes it, at most 100 characters."""
    try:
        text = repr(
            value[:_MAX_SHOWN_CHARACTER_COUNT] if isinstance(value, str | list | tuple) else value
        )
    except ValueError:  # Python writes no whole number of over 4,300 digits
        return "a number of thousands of digits"
    return (
        text
        if len(text) <= _MAX_SHOWN_CHARACTER_COUNT
        else f"{text[:_MAX_SHOWN_CHARACTER_COUNT]}..."
    )


@contextmanager
def file_errors(what: str, done: Literal["read", "written"]) -> Iterator[None]:
    """Turn errors of reading or writing a file in this block into InputError: "`what` cannot be read: reason"."""
    try:
        yield
    except (OSError, UnicodeDecodeError) as error:
        if done == "read" and isinstance(error, FileNotFoundError):
            raise InputError(f"{what} does not exist; give the path of one that does") from None
        raise InputError(f"{what} cannot be {done}: {reason_of(error)}") from None
