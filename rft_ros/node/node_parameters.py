"""Declares the parameter table as ROS parameters. A change is validated before it is accepted, and then applied."""

from array import array
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from rft_ros.errors import InputError
from rft_ros.node.arguments import given_parameters, parameter_files
from rft_ros.parameters import read_sections
from rft_ros.parameters.file import FILES, checked_names, node_parameters, path_beside
from rft_ros.parameters.table import PARAMETERS, Parameter, Value, Values, checked, defaults, unknown_parameter

_Prepared = TypeVar("_Prepared")


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


class UnknownParameterError(ParameterNotDeclaredException):
    """Refuses a change of a parameter that the node does not have. rclpy answers a client with its sentence."""

    def __init__(self, sentence: str) -> None:
        Exception.__init__(self, sentence)  # rclpy's own names no parameter: "undeclared parameter(s): []"


class NodeParameters(Generic[_Prepared]):
    """The node's values of the parameter table.

    Before a change, `prepare` is called with all values, including the changed ones; it raises ValueError to refuse the
    change. After the change `apply` is called with the result of `prepare`. Each change is logged.
    """

    def __init__(
        self, node: Node, *, prepare: Callable[[Values], _Prepared], apply: Callable[[_Prepared], None]
    ) -> None:
        self._node, self._prepare, self._apply = node, prepare, apply
        self._why = ""
        self._checked: dict[str, Value | InputError] = {}
        """For each parameter that is about to be set: its checked value, or the reason for refusing it."""
        self._accepted: tuple[dict[str, Value], _Prepared] | None = None
        """The new values of the change that was accepted last, and the result of `prepare`, until it is applied."""
        overrides = node._parameter_overrides  # rclpy has no public access to overrides of undeclared parameters
        files = self._check_given(node.get_fully_qualified_name(), {n: _plain(p.value) for n, p in overrides.items()})
        values = defaults()
        for p in PARAMETERS:
            # Not declared with rclpy's override, so that `checked` accepts an integer for a double.
            if p.name in overrides:
                values[p.name] = checked(p.name, _plain(overrides[p.name].value))
            if p.name in FILES and p.name in files:
                values[p.name] = path_beside(files[p.name].absolute().parent, p.name, values[p.name])
            node.declare_parameter(p.name, _plain(values[p.name]), _descriptor(p), ignore_override=True)
        self.values: Values = values
        """The current checked values. When parameters are set, this mapping is replaced and not changed."""
        logger = node.get_logger()
        for name in overrides:
            if not name.startswith("qos_overrides.") and not node.has_parameter(name):
                logger.warning(f"there is no parameter '{name}'; it is ignored")
        node.add_pre_set_parameters_callback(self._on_pre_set)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._on_post_set)

    def _check_given(self, own_name: str, overrides: Mapping[str, Any]) -> dict[str, Path]:
        """The file of each parameter that one sets.

        Raises InputError if values of the files cannot be used, or if ROS's parser read other values.
        """
        for file in parameter_files():
            sections = read_sections(file)
            checked_names(file, node_parameters(file, own_name))
            if any(s.parameters for s in sections) and not any(s.is_for(own_name) for s in sections):
                warning = f"no section of {file} is for {own_name}: ROS takes nothing from it"
                self._node.get_logger().warning(warning)
        given = given_parameters(own_name)
        for name, (value, _) in given.items():
            # compared by repr, for which 1 differs from 1.0, and nan equals nan
            if name in overrides and repr(value) != repr(overrides[name]):
                why = "ROS mixes up the values of a name that is given with different types"
                advice = "give it once, or each time with the same type, such as 1.0"
                raise InputError(f"{name} is {value!r}, but ROS takes {overrides[name]!r}: {why}; {advice}")
        return {name: file for name, (_, file) in given.items() if file is not None}

    def set_all(self, values: Values, *, why: str) -> str:
        """Set parameters together, from within the node. `why`: the reason for the log. Returns the refusal, or ""."""
        self._why = why
        parameters = [RosParameter(name, value=_plain(value)) for name, value in values.items()]
        result = self._node.set_parameters_atomically(parameters)
        self._why = ""
        if not result.successful:
            self._node.get_logger().error(f"not set ({why}): {result.reason}")
        return "" if result.successful else str(result.reason)

    # rclpy calls these three in turn for each change. If the second refuses the change, the third is not called.

    def _on_pre_set(self, parameters: list[RosParameter]) -> list[RosParameter]:
        """Convert parameters to the types of the table. `_on_set` will refuse those that `checked` refuses."""
        self._checked, self._accepted, found = {}, None, []
        for p in parameters:
            if p.name in self.values:
                try:
                    value = self._checked[p.name] = checked(p.name, _plain(p.value))
                    p = RosParameter(p.name, value=_plain(value))
                except InputError as error:
                    self._checked[p.name] = error
            elif not self._node.has_parameter(p.name):
                raise UnknownParameterError(unknown_parameter(p.name))
            found.append(p)
        return found

    def _on_set(self, _: list[RosParameter]) -> SetParametersResult:
        try:
            changes = {}
            for name, value in self._checked.items():
                if isinstance(value, InputError):
                    raise value
                if value != self.values[name]:
                    changes[name] = value
            if changes:
                self._accepted = changes, self._prepare({**self.values, **changes})
        except ValueError as error:  # an exception here would end the node
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_post_set(self, _: list[RosParameter]) -> None:
        accepted, self._accepted = self._accepted, None  # `_apply` may declare qos_overrides, which calls this again
        if accepted is None:
            return
        before, (changes, prepared) = self.values, accepted
        said = ", ".join([f"{name} {before[name]!r} -> {value!r}" for name, value in sorted(changes.items())])
        self._node.get_logger().info(f"parameters set: {said}" + (f" ({self._why})" if self._why else ""))
        self.values = {**before, **changes}
        self._apply(prepared)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, array | tuple) else value
