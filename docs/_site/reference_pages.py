"""``python docs/_site/reference_pages.py``: write docs/commands.md and docs/node.md from what the code declares."""

import argparse
from pathlib import Path

from rft_ros.cli import parser
from rft_ros.estimator.parameter_docs import markdown_table
from rft_ros.estimator.quality import QualityFlag, flag_names, sentences, trust
from rft_ros.estimator.samples import Reason

__all__ = ["commands_page", "main", "node_page"]

ROOT = Path(__file__).resolve().parents[2]
_MADE = "<!-- made by python docs/_site/reference_pages.py from {} -->\n"

_REASONS = {
    Reason.MESSAGE_UNREADABLE: "the bytes are no message of the topic's type",
    Reason.POSE_NOT_FINITE: "NaN or infinity in a pose",
    Reason.POSE_QUATERNION_NOT_UNIT: "the quaternion's length is not within 1 % of 1 (zero, for one)",
    Reason.POSE_FRAME_UNKNOWN: "frame_id is not `world_frame`",
    Reason.POSE_STAMP_ZERO: "no time in the stamp",
    Reason.POSE_REPEATED: "the stamp of the pose before",
    Reason.POSE_OUT_OF_ORDER: "a stamp less than a second before that of the last pose",
    Reason.POSE_RATE_LIMITED: "sooner after the last answer than `max_rate` allows",
    Reason.POSE_HISTORY_SHORT: "`twist_source: pose_difference` has too few poses yet",
    Reason.TIME_JUMP: "stamps went back by a second or more: the estimator began afresh",
    Reason.TWIST_MISSING: "no twist has come yet",
    Reason.TWIST_STALE: "the twist's stamp is further from the pose's than `max_input_age`",
    Reason.TWIST_NOT_FINITE: "NaN or infinity in a twist",
    Reason.TWIST_FRAME_UNKNOWN: "frame_id is neither `world_frame` nor `tool_frame`",
    Reason.TWIST_STAMP_ZERO: "no time in the stamp",
    Reason.TWIST_OUT_OF_ORDER: "a stamp before that of the last twist",
    Reason.AT_REST: "in the grains, and no point of the tool as fast as `rest_speed`; not given with memory",
    Reason.ESTIMATE_NOT_FINITE: "the wrench came out as no usable number",
    Reason.WRENCH_MISSING: "no load-cell sample has come yet",
    Reason.WRENCH_STALE: "the sample's stamp is further from the pose's than `max_input_age`",
    Reason.WRENCH_NOT_FINITE: "NaN, infinity or an absurd number from the load cell",
    Reason.WRENCH_FRAME_UNKNOWN: "frame_id is not `sensor_frame`",
    Reason.WRENCH_STAMP_ZERO: "no time in the stamp",
    Reason.WRENCH_OUT_OF_ORDER: "a stamp before that of the last load-cell sample",
}


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _named(action: argparse.Action) -> str:
    """An argument as it is typed, such as ``--scale M``."""
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


def _usage(name: str, command: argparse.ArgumentParser) -> str:
    arguments = _arguments(command)
    optional = ["[OPTIONS]"] if any(a.option_strings and not a.required for a in arguments) else []
    required = [_named(a) for a in arguments if a.option_strings and a.required]
    positional = [_named(a) for a in arguments if not a.option_strings]
    return " ".join(["rft", name, *positional, *required, *optional])


def _command(name: str, command: argparse.ArgumentParser) -> str:
    rows = [
        f"| `{', '.join([*action.option_strings[:-1], _named(action)])}` | {_cell(action.help or '')} |"
        for action in _arguments(command)
    ]
    examples = [f"`{line.strip()}`" for line in (command.epilog or "").splitlines()[1:]]
    parts = [
        f"## rft {name}",
        command.description or "",
        f"Usage: `{_usage(name, command)}`",
        "\n".join(["| argument | meaning |", "|---|---|", *rows]),
        f"{'Example' if len(examples) == 1 else 'Examples'}: {', '.join(examples)}",
    ]
    return "\n\n".join(parts) + "\n"


def commands_page() -> str:
    """docs/commands.md: every command, what it takes, its defaults and an example."""
    whole = parser()
    (commands,) = (a.choices for a in whole._actions if isinstance(a, argparse._SubParsersAction))
    status = (whole.epilog or "").partition("Exit status: ")[2]
    head = [
        "# Commands\n\n" + _MADE.format("rft_ros/cli.py"),
        f"{whole.description} No command but `rft demo` needs ROS. Errors are one sentence; exit status: {status}",
        "What a recording is: a rosbag2 folder (MCAP or sqlite3), an .mcap or .db3 file, or a ROS 1 .bag.\n",
    ]
    return "\n".join([*head, *(_command(name, command) for name, command in commands.items())])


def _of_the_readme(first: str, last: str) -> str:
    """What the README says from the line that begins with `first` to the one before that with `last`."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    start = text.index("\n" + first) + 1
    return text[start : text.index("\n" + last, start)].strip() + "\n"


def node_page() -> str:
    """docs/node.md: topics, services, parameters, reasons and quality flags."""
    reasons = [f"| `{reason.value}` | {_REASONS[reason]} |" for reason in Reason]
    quality_flags = [
        f"| `{flag_names(flag)[0]}` | {sentences(flag)} | {trust(flag).value} |" for flag in QualityFlag if flag.value
    ]
    parts = [
        "# The node\n\n" + _MADE.format("the README, the parameter table, samples.py and quality_flags.py"),
        "Executable `rft_node`, node name `rft`. How to start it: the [README](../README.md#on-your-robot). What it"
        " does when things go wrong: [when inputs fail](where-it-fails.md#when-inputs-fail).\n",
        "## Topics\n\n" + _of_the_readme("| topic | type |", "| service |"),
        "## Services\n\n" + _of_the_readme("| service | type |", "Where there is no estimate"),
        "## Parameters\n\n" + markdown_table(),
        "## Reasons\n\n"
        "Why a sample was not used, or why a pose brought no estimate (no residual, for those of the load cell)."
        " Counted in `/diagnostics` and in a replay's `summary.json`.\n\n"
        + "\n".join(["| reason | when |", "|---|---|", *reasons])
        + "\n",
        "## Quality flags\n\n"
        "What may be wrong with an estimate that is given. `trust` in `/diagnostics` is the lowest that its flags"
        " leave, and OK without any. Most have a figure in [where it fails](where-it-fails.md).\n\n"
        + "\n".join(["| flag | meaning | trust |", "|---|---|---|", *quality_flags])
        + "\n",
    ]
    return "\n".join(parts)


def main() -> None:
    """Rewrite both pages in the checkout."""
    for name, page in (("commands", commands_page()), ("node", node_page())):
        (ROOT / "docs" / f"{name}.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main()
