"""Which topic of a bag plays which role: the node's own topic names, and remaps such as ``~/pose:=/tool_pose``."""

from collections.abc import Iterable
from pathlib import Path

from rft_ros.errors import InputError
from rft_ros.estimator.messages import Role

__all__ = ["remapped_topics"]

_TOPICS: dict[Role, str] = {"pose": "~/pose", "twist": "~/twist", "wrench": "~/wrench_measured"}


def _resolved(name: str) -> str:
    """A topic's full name, as ROS resolves it for the node /rft."""
    if name.startswith("~"):
        return "/rft" + name[1:]
    return name if name.startswith("/") else f"/{name}"


def remapped_topics(remap: Iterable[str] = ()) -> dict[Role, str]:
    """Topic of each role: /rft/pose, /rft/twist and /rft/wrench_measured, unless remapped; later remaps win."""
    topics = {role: _resolved(name) for role, name in _TOPICS.items()}
    roles = {topic: role for role, topic in topics.items()}
    for rule in remap:
        left, separator, right = (part.strip() for part in rule.partition(":="))
        if not separator or not right:
            raise InputError(f"remap '{rule}' is not of the form FROM:=TO, such as ~/pose:=/tool_pose")
        if left.startswith(f"{Path.home()}/"):  # a shell has expanded the ~ of an unquoted ~/pose:=/tool_pose
            left = "~" + left.removeprefix(str(Path.home()))
        role = roles.get(left if left.startswith("/") else _resolved(left) if left.startswith("~") else "")
        if role is None:
            raise InputError(f"remap '{rule}': '{left}' is none of {', '.join(_TOPICS.values())}")
        topics[role] = _resolved(right)
    return topics
