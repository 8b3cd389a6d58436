"""The command ``rft``: works without ROS. Exit status 0 done, 1 failed, 2 wrong usage or unusable input."""

import argparse
import sys
from collections.abc import Sequence
from types import ModuleType
from typing import NoReturn

from rft_ros.commands import calibrate, chart, check_mesh, demo, predict, reduce, replay, study, sweep, view
from rft_ros.errors import InputError

__all__ = ["main", "parser"]

# The modules import what they need when they run, so that `rft --help` answers at once.
_COMMANDS: tuple[ModuleType, ...] = (predict, check_mesh, reduce, replay, calibrate, chart, study, sweep, view, demo)


def parser() -> argparse.ArgumentParser:
    """The whole command line: a subcommand for each module, named and described as the module is."""
    whole = argparse.ArgumentParser(
        prog="rft",
        description="The wrench that dry granular material puts on a moving tool, by 3D Resistive Force Theory.",
    )
    whole.add_argument("--version", action=_Version, nargs=0, help="show the installed version and exit")
    commands = whole.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for module in _COMMANDS:
        text = (module.__doc__ or "").partition("\n")[0]
        name = module.__name__.rpartition(".")[2].replace("_", "-")
        command = commands.add_parser(name, help=text, description=text)
        module.add_options(command)
        command.set_defaults(run=module.run)
    return whole


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
    parsed = parser().parse_args(arguments)
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
        return 1


if __name__ == "__main__":
    sys.exit(main())
