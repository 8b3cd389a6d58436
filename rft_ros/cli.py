"""The command ``rft``: works without ROS.

Exit status: 0 done, 1 failed, 2 wrong usage or unusable input, 130 interrupted.
"""

import argparse
import difflib
import sys
from collections.abc import Iterable, Sequence
from types import ModuleType
from typing import NoReturn

from rft_ros.commands import calibrate, chart, check_mesh, demo, predict, reduce, replay, study, sweep, view, warm_up
from rft_ros.errors import InputError

__all__ = ["main", "parser"]

# The modules import what they need when they run, so that `rft --help` answers at once.
_MODULES: tuple[ModuleType, ...] = (
    *(predict, check_mesh, reduce, replay, calibrate, chart, study, sweep, view, demo, warm_up),
)
_COMMANDS = {module.__name__.rpartition(".")[2].replace("_", "-"): module for module in _MODULES}


def parser() -> argparse.ArgumentParser:
    """The whole command line: a subcommand for each module, named as it is.

    The first line of a module's docstring describes its command, what follows are examples.
    """
    whole = _Parser(
        prog="rft",
        description="The wrench that dry granular material puts on a moving tool, by 3D Resistive Force Theory.",
        epilog="rft COMMAND --help says more of each. " + (__doc__ or "").partition("\n\n")[2],
        formatter_class=_Help,
    )
    whole.add_argument("--version", action=_Version, nargs=0, help="show the installed version and exit")
    commands = whole.add_subparsers(dest="command", required=True, title="commands", metavar="COMMAND")
    for name, module in _COMMANDS.items():
        text, _, examples = (module.__doc__ or "").strip().partition("\n\n")
        epilog = "\n".join(["example:", *(f"  {line}" for line in examples.splitlines())])
        command = commands.add_parser(name, help=text, description=text, epilog=epilog, formatter_class=_Help)
        module.add_options(command)
        command.set_defaults(run=module.run, own=command)
    return whole


class _Parser(argparse.ArgumentParser):
    """Answers wrong usage with a sentence, and leaves the rest to --help."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


class _Help(argparse.HelpFormatter):
    """Names and what they mean side by side where they fit; examples as they are written."""

    def __init__(self, prog: str) -> None:
        super().__init__(prog, max_help_position=30)
        self._action_max_length = 14  # of the longest command, whose indent argparse does not count

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return text if "\n" in text else super()._fill_text(text, width, indent)


class _Version(argparse.Action):
    """What the package is installed as; looked up only when asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        from importlib.metadata import PackageNotFoundError, version

        try:
            print(f"rft {version('rft_ros')}")
        except PackageNotFoundError:
            print("rft, not installed")
        parser.exit()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status."""
    arguments = sys.argv[1:] if arguments is None else arguments
    whole = parser()
    if not arguments:
        whole.print_help(sys.stderr)
        return 2
    word = arguments[0]
    if not word.startswith("-") and word not in _COMMANDS:
        print(f"rft: there is no command '{word}'; {_meant(word, _COMMANDS)}", file=sys.stderr)
        return 2
    parsed, left = whole.parse_known_args(arguments)
    if left:
        options = [name for name in parsed.own._option_string_actions if name.startswith("--")]
        parsed.own.error(f"'{left[0]}' is not one of its arguments; {_meant(left[0], options)}")
    try:
        status: int = parsed.run(parsed)
        return status
    except InputError as error:
        # a damaged file's names may hold control characters
        sentence = "".join(c if c.isprintable() else repr(c)[1:-1] for c in str(error))
        print(f"rft {parsed.command}: {sentence}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(f"rft {parsed.command}: interrupted", file=sys.stderr)
        return 130


def _meant(word: str, names: Iterable[str]) -> str:
    """What to say after what is none of the names: the nearest, else all of them."""
    near = difflib.get_close_matches(word, names, n=1)
    return f"did you mean '{near[0]}'?" if near else f"there are {', '.join(names)}"


if __name__ == "__main__":
    sys.exit(main())
