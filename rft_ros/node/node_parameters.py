"""Declares the parameter table as ROS parameters. A change is validated before it is accepted, and then applied."""

import itertools
from array import array
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from rft_ros.errors import InputError
from rft_ros.node.swap import Prepared
from rft_ros.parameters import PARAMETERS, Parameter, Value, Values, checked, defaults
from rft_ros.parameters.file import absolute, checked_in_file
from rft_ros.parameters.sections import Given, Section, read_sections, read_value
from rft_ros.parameters.table import unknown_parameter


def given_sections(arguments: Sequence[str]) -> list[tuple[Path | None, list[Section]]]:
    """The sections of each parameter file, and of each parameter that ``-p`` sets, which has no file.

    Raises InputError for them, and for arguments outside of ``--ros-args``: ROS ignores those, and the node would run
    with default parameters.
    """
    for_ros = list[str]()
    others = list[str]()
    inside = False
    for argument in arguments:
        if argument == ("--" if inside else "--ros-args"):
            inside = not inside
        else:
            (for_ros if inside else others).append(argument)
    if others:
        advice = "ROS arguments, such as --params-file, come after --ros-args"
        raise InputError(f"cannot use '{' '.join(others)}'; {advice}")
    found: list[tuple[Path | None, list[Section]]] = []
    for option, text in itertools.pairwise(for_ros):
        if option == "--params-file":
            found.append((Path(text), read_sections(Path(text))))
        elif option in ("-p", "--param"):
            name, _, value = text.partition(":=")
            of_node, separator, parameter = name.rpartition(":")
            read = read_value(value, f"'{option} {text}'")
            found.append((None, [Section(of_node if separator else "/**", {parameter: read})]))
    return found


def _descriptor(p: Parameter) -> ParameterDescriptor:
    ranges = [FloatingPointRange(from_value=p.bounds[0], to_value=p.bounds[1])]
    return ParameterDescriptor(
        name=p.name,
        description=p.description + (f" [{p.unit}]" if p.unit else ""),
        additional_constraints=f"one of: {', '.join(p.choices)}" if p.choices else "",
        read_only=p.applies == "restart",
        dynamic_typing=True,  # so that `checked` refuses a wrong type, with a clearer sentence than rclpy's
        floating_point_range=ranges if isinstance(p.default, float) else [],
    )


class RefusedChangeError(ParameterNotDeclaredException):
    """Refuses a change of parameters. rclpy answers a client with its sentence; other exceptions would end the node."""

    def __init__(self, sentence: str) -> None:
        # rclpy's own names no parameter: "undeclared parameter(s): []"
        Exception.__init__(self, sentence)


class NodeParameters:
    """The node's values of the parameter table.

    `arguments`: the node's command line. Before a change, `prepare` is called with all values, including the changed
    ones; it raises ValueError to refuse the change. After the change `apply` is called with the result of `prepare`.
    Each change is logged.
    """

    def __init__(
        self,
        node: Node,
        arguments: Sequence[str],
        *,
        prepare: Callable[[Values], Prepared],
        apply: Callable[[Prepared], None],
    ) -> None:
        self._node = node
        self._prepare = prepare
        self._apply = apply
        self._why = ""
        self._accepted: tuple[dict[str, Value], Prepared] | None = None
        """The new values of the change that was accepted last, and the result of `prepare`, until it is applied."""
        self.values: Values = {**defaults(), **self._given(arguments)}
        """The current checked values. When parameters are set, this mapping is replaced and not changed."""
        for p in PARAMETERS:
            # Not with the value that ROS has read: after a name that is given twice it would mix up their types.
            node.declare_parameter(
                p.name, _plain(self.values[p.name]), _descriptor(p), ignore_override=True
            )
        node.add_pre_set_parameters_callback(self._on_pre_set)
        node.add_post_set_parameters_callback(self._on_post_set)

    def _given(self, arguments: Sequence[str]) -> dict[str, Value]:
        """The checked values on the command line. Raises InputError for values of a file that cannot be used.

        As in ROS, sections of one name are merged, also across files, and stand in the place of the first; a later
        value overrides an earlier one. ``-p`` sets parameters of ``/**``.
        """
        own_name = self._node.get_fully_qualified_name()
        by_section: dict[str, dict[str, tuple[Given, Path | None]]] = {}
        for file, sections in given_sections(arguments):
            own = [section for section in sections if section.is_for(own_name)]
            if file and not own and any(section.parameters for section in sections):
                warning = f"no section of {file} is for {own_name}: ROS takes nothing from it"
                self._node.get_logger().warning(warning)
            for section in sections:
                found = by_section.setdefault(section.key, {})
                found |= {
                    name: (value, file)
                    for name, value in section.parameters.items()
                    if section in own
                }
        values: dict[str, Value] = {}
        for name, (value, file) in [
            item for found in by_section.values() for item in found.items()
        ]:
            if file:
                values |= absolute(checked_in_file(file, {name: value}))
            elif name in defaults():
                values[name] = checked(name, value)
            elif not (self._node.has_parameter(name) or name.startswith("qos_overrides.")):
                self._node.get_logger().warning(f"there is no parameter '{name}'; it is ignored")
        return values

    def set_all(self, values: Values, *, why: str) -> str:
        """Set parameters together, from within the node. `why`: the reason for the log. Returns the refusal, or ""."""
        self._why = why
        parameters = [RosParameter(name, value=_plain(value)) for name, value in values.items()]
        try:
            result = self._node.set_parameters_atomically(parameters)
            refusal = "" if result.successful else str(result.reason)
        except RefusedChangeError as error:
            refusal = str(error)
        self._why = ""
        if refusal:
            self._node.get_logger().error(f"not set ({why}): {refusal}")
        return refusal

    def _on_pre_set(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Check and prepare a change; returns its parameters in the types of the table."""
        self._accepted = None
        new = dict[str, Value]()
        try:
            for p in parameters:
                if p.name in self.values:
                    new[p.name] = checked(p.name, _plain(p.value))
                elif not self._node.has_parameter(p.name):
                    raise InputError(unknown_parameter(p.name))
            changes = {name: value for name, value in new.items() if value != self.values[name]}
            if changes:
                self._accepted = changes, self._prepare({**self.values, **changes})
        except ValueError as error:
            raise RefusedChangeError(str(error)) from None
        return [
            RosParameter(p.name, value=_plain(new[p.name])) if p.name in new else p
            for p in parameters
        ]

    def _on_post_set(self, parameters: list[RosParameter]) -> None:
        accepted = self._accepted
        self._accepted = None  # `_apply` may declare qos_overrides, which calls this again
        if accepted is None:
            return
        changes, prepared = accepted
        if not changes.keys() <= {p.name for p in parameters}:  # rclpy has refused the change
            return
        before = self.values
        said = ", ".join(
            [f"{name} {before[name]!r} -> {value!r}" for name, value in sorted(changes.items())]
        )
        self._node.get_logger().info(
            f"parameters set: {said}" + (f" ({self._why})" if self._why else "")
        )
        self.values = {**before, **changes}
        self._apply(prepared)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, array | tuple) else value
