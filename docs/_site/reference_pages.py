"""``python docs/_site/reference_pages.py`` writes config/default.yaml, and lists and tables of docs."""

import argparse
import math
from pathlib import Path

from rft_ros.cli import parser
from rft_ros.commands.options import BAG
from rft_ros.diagnosis.fit import NUISANCES, TOLERANCES
from rft_ros.estimator import QualityFlag, Reason, Trust, sentences, trust
from rft_ros.parameters import PARAMETERS, Parameter, Value

__all__ = [
    "check_page",
    "commands_page",
    "default_yaml",
    "main",
    "parameters_table",
    "reasons_page",
]

ROOT = Path(__file__).resolve().parents[2]


def _reasons() -> dict[str, list[Reason]]:
    """The reasons by what went wrong, in the order in which they are documented."""
    found: dict[str, list[Reason]] = {}
    for reason in Reason:
        found.setdefault(reason.sentence, []).append(reason)
    return found


def _named(action: argparse.Action) -> str:
    """The argument as a user types it, such as ``--scale M``."""
    metavar = action.metavar if action.metavar is not None else action.dest.upper()
    if action.choices is not None and action.metavar is None:
        metavar = "{" + ",".join(map(str, action.choices)) + "}"
    words = " ".join(metavar) if isinstance(metavar, tuple) else metavar.replace("|", " or ")
    if action.nargs == 0:
        words = ""
    if action.nargs == "+":
        words = f"{words} [{words} ...]"
    return " ".join([*action.option_strings[-1:], words]).strip()


def _arguments(command: argparse.ArgumentParser) -> list[argparse.Action]:
    return [action for action in command._actions if action.dest != "help"]


_AS_PARAMETERS = {
    "--scale": "mesh.scale",
    "--origin": "mesh.origin",
    "--rotate": "mesh.quaternion",
    "--hull": "mesh.hull",
    "--law": "law",
    "--medium": "medium.name",
    "--zeta": "medium.zeta",
    "--density": "medium.density",
    "--inertia": "medium.inertia",
    "--surface-friction": "medium.surface_friction",
    "--mobilization-length": "medium.mobilization_length",
    "--surface-height": "surface_height",
}
"""Options that mean what a parameter of the node means, in most commands."""

_DESCRIPTIONS = {p.name: p.description for p in PARAMETERS}


def _is_as_parameter(action: argparse.Action) -> bool:
    """Whether the option means a parameter and has its default. Its help then begins with the parameter's."""
    for option in action.option_strings:
        if option == "--medium":  # of medium.name and medium.file
            return True
        if option in _AS_PARAMETERS:
            meaning = _DESCRIPTIONS[_AS_PARAMETERS[option]].rstrip(".").lower()
            return (action.help or "").replace("%%", "%").lower().startswith(meaning)
    return False


def _command(name: str, command: argparse.ArgumentParser, described: dict[str, str]) -> str:
    """The section of a command. An argument that a command above has, by its help in `described`, is named only."""
    rows, as_above, as_parameters = [], [], []
    for action in _arguments(command):
        typed = f"`{', '.join([*action.option_strings[:-1], _named(action)])}`"
        meaning = (action.help or "").replace(BAG, "recording")
        if _is_as_parameter(action):
            as_parameters.append(typed)
        elif meaning not in described:
            described[meaning] = typed
            needed = " (required)" if action.required and action.option_strings else ""
            rows.append(f"- {typed}{needed}: {meaning}")
        elif described[meaning] == typed:
            as_above.append(typed)
        else:
            rows.append(f"- {typed}: {meaning}")
    if as_parameters:
        rows.append(f"- {', '.join(as_parameters)}: as the node's [parameters](parameters.md)")
    if as_above:
        rows.append(f"- {', '.join(as_above)}: as above")
    return (
        "\n\n".join([f"## rft {name}", command.description or "", "\n".join(rows)]).rstrip() + "\n"
    )


def commands_page() -> str:
    """The site's page of every command with its arguments, defaults and an example."""
    whole = parser()
    (commands,) = (a.choices for a in whole._actions if isinstance(a, argparse._SubParsersAction))
    status = (whole.epilog or "").partition("Exit status: ")[2]
    head = [
        "# Commands\n",
        "This page lists every command of `rft` with its arguments. With `--help`, a command shows the same text with"
        " examples. This command, for example, reports what is in a mesh file:\n",
        "```sh\nrft check-mesh my_tool.stl\n```\n",
        "Only `rft demo`, and `rft doctor` without `--bag`, need ROS. After `colcon build`, type `ros2 run rft_ros rft`"
        " instead of `rft`.\n",
        f"Every error is one sentence on stderr. Exit status: {status} A recording is a {BAG}.\n",
        'Units are in brackets, defaults in parentheses. "As above" means that an earlier command has the'
        " argument with the same meaning.\n",
    ]
    described: dict[str, str] = {}
    return "\n".join(
        [*head, *(_command(name, command, described) for name, command in commands.items())]
    )


def _table(*rows: str) -> str:
    return "\n".join(rows) + "\n"


def _yaml(value: Value) -> str:
    if isinstance(value, tuple):
        return "[" + ", ".join(_yaml(v) for v in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


def _allowed(p: Parameter) -> str:
    return ", ".join(p.choices) or (
        "" if math.isinf(p.bounds[0]) else "{:g} to {:g}".format(*p.bounds)
    )


def default_yaml() -> str:
    """config/default.yaml: every parameter at its default, with its description."""
    lines = [
        "# Every parameter of rft_node at its default; made by python docs/_site/reference_pages.py",
        "/**:",
        "  ros__parameters:",
    ]
    for p in PARAMETERS:
        unit = f" [{p.unit}]" if p.unit else ""
        allowed = f" Allowed: {_allowed(p)}." if _allowed(p) else ""
        restart = " Needs a restart." if p.applies == "restart" else ""
        lines += [
            f"    # {p.description}{unit}{allowed}{restart}",
            f"    {p.name}: {_yaml(p.default)}",
        ]
    return _table(*lines)


def parameters_table() -> str:
    """The site's table of all parameters, for docs/parameters.md."""
    rows = ["| parameter | default | allowed | meaning |", "|---|---|---|---|"]
    for p in PARAMETERS:
        default = f"`{_yaml(p.default)}`" + (f" {p.unit}" if p.unit else "")
        restart = " Needs a restart." if p.applies == "restart" else ""
        cells = (f"`{p.name}`", default, _allowed(p), f"{p.description}{restart}")
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return _table(*rows)


def _with_tables(file: Path, tables: dict[str, str]) -> str:
    """The file's text with each table written between the marks that carry its name."""
    page = file.read_text(encoding="utf-8")
    for name, table in tables.items():
        begin, end = f"<!-- {name}: begin (generated) -->\n", f"<!-- {name}: end -->\n"
        before, _, rest = page.partition(begin)
        page = before + begin + table + end + rest.partition(end)[2]
    return page


_TRUST = {Trust.CAUTION: "", Trust.NO: "; trust NO"}


def reasons_page() -> str:
    """docs/reasons.md with its lists of reasons and quality flags."""
    tables = {
        "reasons": _table(
            *(
                f"- {', '.join(f'`{r.value}`' for r in reasons)}: {when}"
                for when, reasons in _reasons().items()
            )
        ),
        "quality flags": _table(
            *(f"- `{f.label}`: {sentences(f)}{_TRUST[trust(f)]}" for f in QualityFlag if f)
        ),
    }
    return _with_tables(ROOT / "docs" / "reasons.md", tables)


def check_page() -> str:
    """docs/check-a-cell.md with its table of tolerances."""
    rows = [
        f"| {name.replace('_', ' ')} | {t.value:g} | {t.unit} | {t.reason} |"
        for name, t in TOLERANCES.items()
        if name not in NUISANCES
    ]
    head = ("| given value | tolerance | unit | what for |", "|---|---|---|---|")
    table = {"tolerances": _table(*head, *rows)}
    return _with_tables(ROOT / "docs" / "check-a-cell.md", table)


def main() -> None:
    """Rewrite all of them in the checkout."""
    pages = {
        "docs/check-a-cell.md": check_page(),
        "docs/reasons.md": reasons_page(),
        "config/default.yaml": default_yaml(),
    }
    for name, page in pages.items():
        (ROOT / name).write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
