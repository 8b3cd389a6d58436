"""A page in headless Chromium, with no network: its console, its document once it has run, and a screenshot."""

import re
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

_NAMES = ("chromium", "chromium-browser", "google-chrome")
_OPTIONS = (
    *(
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        "--no-first-run",
        "--disable-background-networking",
    ),
    *(
        "--disable-component-update",
        "--disable-sync",
        "--enable-logging=stderr",
        "--virtual-time-budget=15000",
    ),
    "--host-resolver-rules=MAP * ~NOTFOUND",
)


class Shown(NamedTuple):
    """The console's lines, errors among them, and the document as HTML."""

    console: list[str]
    errors: list[str]
    document: str


def show(page: Path, scratch: Path) -> Shown:
    """Open a page; `scratch`: a folder for the browser's profile and ``screenshot.png``."""
    program = next(filter(None, map(shutil.which, _NAMES)), None)
    if program is None:
        pytest.skip(f"no browser: none of {', '.join(_NAMES)} is installed")
    parts = []
    for number, what in enumerate((f"--screenshot={scratch / 'screenshot.png'}", "--dump-dom")):
        profile = scratch / f"profile{number}"
        command = [
            program,
            *_OPTIONS,
            f"--user-data-dir={profile}",
            "--window-size=1400,5200",
            what,
            page.as_uri(),
        ]
        done = subprocess.run(command, capture_output=True, text=True, timeout=600)
        assert done.returncode == 0, done.stderr
        parts.append(done)
    console = [line for done in parts for line in done.stderr.splitlines() if ":CONSOLE" in line]
    errors = [line for line in console if not re.search(r":(INFO|WARNING):CONSOLE", line)]
    errors += [
        line
        for line in console
        if re.search(r"Uncaught|TypeError|ReferenceError|net::ERR|Refused to", line)
    ]
    return Shown(console, errors, parts[1].stdout)
