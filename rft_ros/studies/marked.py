"""Tables in the docs that studies write: between two marks, which stay."""

import re
from pathlib import Path

from rft_ros.errors import InputError, reason_of

__all__ = ["marked", "with_marked", "write_marked"]


def _marks(name: str) -> tuple[str, str]:
    return f"<!-- rft study {name}: begin -->\n", f"<!-- rft study {name}: end -->"


def marked(text: str, name: str) -> str | None:
    """What stands between the marks of a name; None without marks."""
    begin, end = _marks(name)
    found = re.search(f"{re.escape(begin)}(.*?){re.escape(end)}", text, re.DOTALL)
    return found.group(1) if found else None


def with_marked(text: str, name: str, content: str) -> str:
    """The text with `content` between the marks of a name; as it is without marks."""
    old = marked(text, name)
    begin, end = _marks(name)
    return text if old is None else text.replace(f"{begin}{old}{end}", f"{begin}{content}{end}")


def write_marked(file: Path, contents: dict[str, str]) -> list[str]:
    """Write contents by name between their marks in a file; returns the names that have marks there."""
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read '{file}': {reason_of(error)}") from None
    names = [name for name in contents if marked(text, name) is not None]
    if not names:
        raise InputError(f"'{file}' has no line '{_marks(next(iter(contents)))[0].strip()}', nor that of another study")
    for name in names:
        text = with_marked(text, name, contents[name])
    try:
        file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write '{file}': {error.strerror}") from None
    return names
