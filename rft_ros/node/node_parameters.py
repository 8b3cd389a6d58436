"""Declares the parameter table as ROS parameters. A change is validated before it is accepted, and then applied."""

import itertools
from array import array
from collections import ChainMap
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from rft_ros.errors import InputError
from rft_ros.node.swap import Prepared
from rft_ros.parameters import PARAMETERS, Config, Parameter, Value, Values, checked
from rft_ros.parameters.config import NAMES
from rft_ros.parameters.file import checked_in_file, placed
from rft_ros.parameters.sections import Given, Section, read_sections, read_value


def given_sections(arguments: Sequence[str]) -> Iterator[tuple[Path | None, list[Section]]]:
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
    for option, text in itertools.pairwise(for_ros):
        if option == "--params-file":
            file = Path(text)
            yield file, read_sections(file)
        elif option in ("-p", "--param"):
            name, _, value = text.partition(":=")
            of_node, separator, parameter = name.rpartition(":")
            key = of_node if separator else "/**"
            read = read_value(value, f"'{option} {text}'")
            yield None, [Section(key, {parameter: read})]


def _descriptor(p: Parameter) -> ParameterDescriptor:
    ranges = [FloatingPointRange(from_value=p.bounds[0], to_value=p.bounds[1])]
    return ParameterDescriptor(
        description=p.description + (f" [{p.unit}]" if p.unit else ""),
        additional_constraints=f"one of: {', '.join(p.choices)}" if p.choices else "",
        read_only=p.applies == "restart",
        dynamic_typing=True,  # so that `checked` refuses a wrong type, with a clearer sentence than rclpy's
        floating_point_range=ranges if isinstance(p.default, float) else [],
    )


class RefusedChangeError(InputError, ParameterNotDeclaredException):
    """Refuses a change of parameters. rclpy answers a client with its sentence; other exceptions would end the node."""


class NodeParameters:
    """The node's parameters.

    `arguments`: the node's command line. Before a change, `prepare` is called with all parameters, the changed ones
    among them; it raises ValueError to refuse the change. After the change `apply` is called with the result of
    `prepare`. Each change is logged.
    """

    def __init__(
        self,
        node: Node,
        arguments: Sequence[str],
        *,
        prepare: Callable[[Config], Prepared],
        apply: Callable[[Prepared], None],
    ) -> None:
        self._node = node
        self._prepare = prepare
        self._apply = apply
        self._why = ""
        self._accepted: Prepared | None = None
        """The result of `prepare` for the last change; None if that was refused, changes nothing or is applied."""
        self.config = Config.of(self._given(arguments))
        """The current parameters."""
        values = self.config.values
        for p in PARAMETERS:
            # Not with the value that ROS has read: after a name that is given twice it would mix up their types.
            node.declare_parameter(
                p.name, _plain(values[p.name]), _descriptor(p), ignore_override=True
            )
        node.add_pre_set_parameters_callback(self._on_pre_set)
        node.add_post_set_parameters_callback(self._on_post_set)

    def _given(self, arguments: Sequence[str]) -> dict[str, Value]:
        """The checked values on the command line. Raises InputError for values of a file that cannot be used.

        As in ROS, sections of one name are merged, also across files, and stand in the place of the first; a later
        value overrides an earlier one. ``-p`` sets parameters of ``/**``.
        """
        own_name = self._node.get_fully_qualified_name()
        logger = self._node.get_logger()
        by_section: dict[str, dict[str, tuple[Given, Path | None]]] = {}
        for file, sections in given_sections(arguments):
            own = [section for section in sections if section.is_for(own_name)]
            if file and not own and any(section.parameters for section in sections):
                logger.warning(
                    f"no section of {file} is for {own_name}: ROS takes nothing from it"
                )
            for section in own:
                in_section = by_section.setdefault(section.key, {})
                in_section |= {name: (value, file) for name, value in section.parameters.items()}
        given = ChainMap(*reversed(by_section.values()))
        values: dict[str, Value] = {}
        for name, (value, file) in given.items():
            if file:
                values |= placed(checked_in_file(file, {name: value}), Path.cwd())
            elif name in NAMES:
                values[name] = checked(name, value)
            elif not (self._node.has_parameter(name) or name.startswith("qos_overrides.")):
                logger.warning(f"there is no parameter '{name}'; it is ignored")
        return values

    def set_all(self, values: Values, *, why: str) -> None:
        """Set parameters together, from within the node. `why`: the reason for the log.

        Raises InputError if the change is refused, also by ROS, as by a callback of someone else's.
        """
        parameters = [RosParameter(name, value=_plain(value)) for name, value in values.items()]
        self._why = f" ({why})"
        try:
            result = self._node.set_parameters_atomically(parameters)
        finally:
            self._why = ""
        if not result.successful:
            raise InputError(result.reason)

    def _on_pre_set(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Check and prepare a change; returns its parameters in the types of the table."""
        self._accepted = None
        try:
            new = {
                p.name: checked(p.name, _plain(p.value))
                for p in parameters
                if p.name in NAMES or not self._node.has_parameter(p.name)
            }
            config = self.config.changed(new)
            if config != self.config:
                self._accepted = self._prepare(config)
        except ValueError as error:
            raise RefusedChangeError(str(error)) from None
        return [RosParameter(p.name, value=_plain(new.get(p.name, p.value))) for p in parameters]

    def _on_post_set(self, parameters: list[RosParameter]) -> None:
        accepted = self._accepted
        # rclpy calls this also for the qos_overrides that `_apply` declares, perhaps after it has refused a change
        if accepted is None or not any(p.name in NAMES for p in parameters):
            return
        self._accepted = None  # or it would keep the model of this change after later swaps
        before = self.config.values
        said = ", ".join(
            f"{name} {before[name]!r} -> {value!r}"
            for name, value in accepted.config.values.items()
            if value != before[name]
        )
        self._node.get_logger().info(f"parameters set: {said}{self._why}")
        self.config = accepted.config
        self._apply(accepted)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, array | tuple) else value
