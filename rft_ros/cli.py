"""The command ``rft``: works without ROS.

Exit status: 0 done, 1 failed, 2 wrong usage or unusable input, 130 interrupted.
"""

import argparse
import io
import os
import re
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from inspect import getdoc
from pathlib import Path
from typing import Any, NoReturn

from rft_ros.errors import InputError, reason_of
from rft_ros.installation import program, release
from rft_ros.progress import line_if_long

_COMMANDS = {
    "predict": ("predict", "Predict the wrench at each state of a CSV file."),
    "check-mesh": ("tools", "Report the extent of a mesh and its defects."),
    "replay": ("replay", "Run recorded bags through the estimator."),
    "calibrate": ("calibrate", "Fit load cell, surface, ζ and memory to recorded bags."),
    "fit-medium": ("medium", "Fit a medium of your own to a measured map of stresses."),
    "sweep": ("tools", "Run a design study: tools × motions × media, on all cores or a cluster."),
    "view": ("predict", "Draw a tool moving through the grains: an animated page."),
    "doctor": (
        "cell",
        "Check a cell's set-up: inputs, frames, QoS, load cell, surface, mesh, running node.",
    ),
    "demo": ("cell", "Run a virtual arm, a real node and a live table (needs ROS)."),
    "warm-up": (
        "cell",
        "Compile the code of node and replay now, so that their first start is quick.",
    ),
}
"""For each command the module of `rft_ros.commands` that has it, and its help text."""


def parser(rft: str = "rft", *, only: str | None = None) -> argparse.ArgumentParser:
    """The whole command line. `rft`: what the user types to run this program; help and errors show it.

    `only`: import the module of this command alone, since an import takes half a second (default: of all commands).
    """
    whole = _Parser(
        prog=rft,
        description="The wrench that dry granular material puts on a moving tool, by 3D Resistive Force Theory.",
        epilog=f"{rft} COMMAND --help describes that command. "
        + (__doc__ or "").partition("\n\n")[2].strip(),
        formatter_class=_Help,
    )
    whole.add_argument(
        "--version", action="version", version=f"rft {release()}", help="show the version and exit"
    )
    commands = whole.add_subparsers(
        dest="command", required=True, title="commands", metavar="COMMAND"
    )
    for name, (module, text) in _COMMANDS.items():
        command = commands.add_parser(name, help=text, description=text, formatter_class=_Help)
        if only in (None, name):
            functions = vars(import_module(f"rft_ros.commands.{module}"))
            function = name.replace("-", "_")
            run = functions[function]
            functions[f"{function}_options"](command)
            command.set_defaults(run=run)
            examples = f"\n{getdoc(run)}".replace("\nrft", f"\n  {rft}")
            command.epilog = f"example:{examples}"
    return whole


class _Parser(argparse.ArgumentParser):
    """Reports wrong usage in one sentence, without argparse's usage text."""

    def __init__(self, **options: Any) -> None:
        from rft_ros.files import expanded  # imports numpy; `main` handles a Ctrl-C during it

        super().__init__(**options)
        # argparse's own takes -1e-3 for an option
        self._negative_number_matcher = re.compile(r"-\.?\d")
        # a shell leaves the ~ of --output=~/out.csv to the program
        self.register("type", Path, expanded)

    def error(self, message: str) -> NoReturn:
        name = self.prog.rpartition("/")[2].replace("'", "")  # the path of `program` may be quoted
        self.exit(2, f"{name}: {message}; see {self.prog} --help\n")


class _Help(argparse.HelpFormatter):
    """Wraps paragraphs, and leaves examples as they are."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")  # a file's name need not be UTF-8
    if arguments is None:  # as a program
        arguments = sys.argv[1:]
        # as Ctrl-C, so that unfinished files are removed
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    name = "rft"
    try:
        try:
            with line_if_long("loading Python packages"):
                whole = parser(program(), only=arguments[0] if arguments else "")
            if not arguments:
                whole.print_help(sys.stderr)
                return 2
            parsed = whole.parse_args(arguments)
            name = f"rft {parsed.command}"
            status: int = parsed.run(parsed)
            return status
        finally:
            if sys.stdout is not None:
                # a closed pipe is reported here instead of at exit, where it leaves a traceback
                sys.stdout.flush()
    except InputError as error:
        # names in a damaged file may hold control characters
        sentence = "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(error))
        print(f"{name}: {sentence}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return 130
    except OSError as error:
        with suppress(AttributeError, ValueError):  # no stdout, or one without a descriptor
            # Python would report it again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # the reader, such as head, has closed the pipe
            return 128 + signal.SIGPIPE
        what = error.filename or "the output or the working directory"
        print(f"rft: {what} cannot be used: {reason_of(error)}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
