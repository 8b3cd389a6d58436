"""The parameter table as ROS parameters: declared, validated before a change, applied after it."""

from array import array
from collections.abc import Callable, Mapping
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from rft_ros.errors import InputError
from rft_ros.estimator.parameters import PARAMETERS, Parameter, Value, checked

__all__ = ["NodeParameters"]

_FLOAT_TYPES = {
    RosParameter.Type.INTEGER: RosParameter.Type.DOUBLE,
    RosParameter.Type.INTEGER_ARRAY: RosParameter.Type.DOUBLE_ARRAY,
}


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    descriptor = ParameterDescriptor(
        name=parameter.name,
        description=parameter.description + unit,
        additional_constraints=f"one of: {', '.join(parameter.choices)}" if parameter.choices else "",
        read_only=parameter.applies == "restart",
        dynamic_typing=True,  # so that a wrong type is answered by the table's sentence, not by "Wrong parameter type"
    )
    if parameter.type == "double" and parameter.low > -float("inf"):
        descriptor.floating_point_range = [FloatingPointRange(from_value=parameter.low, to_value=parameter.high)]
    return descriptor


class NodeParameters:
    """The node's values of the table.

    `validate(values)`: raises InputError if a set of checked values cannot be used; called before a change, without
    side effects. `apply(values, changed)`: called after it. A refused value leaves everything as it was.
    """

    def __init__(
        self,
        node: Node,
        *,
        validate: Callable[[Mapping[str, Value]], None],
        apply: Callable[[Mapping[str, Value], frozenset[str]], None],
    ) -> None:
        self._node = node
        self._validate = validate
        self._apply = apply
        self._own: dict[str, Value] = {}
        for p in PARAMETERS:
            # A value from a file is checked by the table, which answers in sentences; an integer for a double is taken.
            override = node._parameter_overrides.get(p.name)
            self._own[p.name] = value = p.default if override is None else checked(p.name, _plain(override.value))
            ros_value = list(value) if isinstance(value, tuple) else value
            node.declare_parameter(p.name, ros_value, _descriptor(p), ignore_override=True)
        validate(self._own)
        node.add_pre_set_parameters_callback(self._with_doubles)
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after)

    @property
    def values(self) -> Mapping[str, Value]:
        """The checked values in force."""
        return self._own

    def undeclared(self) -> list[str]:
        """Names in the parameter file or on the command line that this node does not have."""
        known = self._node._parameters
        return [name for name in self._node._parameter_overrides if name not in known]

    def set_all(self, values: Mapping[str, Value]) -> None:
        """Set parameters together, from within the node."""
        self._node.set_parameters_atomically(
            [RosParameter(k, value=list(v) if isinstance(v, tuple) else v) for k, v in values.items()]
        )

    def _with_doubles(self, parameters: list[RosParameter]) -> list[RosParameter]:
        own = {p.name for p in PARAMETERS if p.type != "string"}
        return [_as_double(p) if p.name in own and p.type_ in _FLOAT_TYPES else p for p in parameters]

    def _merged(self, parameters: list[RosParameter]) -> dict[str, Value]:
        changes = {p.name: checked(p.name, _plain(p.value)) for p in parameters if p.name in self._own}
        return {**self._own, **changes}

    def _on_set(self, parameters: list[RosParameter]) -> SetParametersResult:
        try:
            merged = self._merged(parameters)
            if merged != self._own:
                self._validate(merged)
        except InputError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _after(self, parameters: list[RosParameter]) -> None:
        merged = self._merged(parameters)
        changed = frozenset(name for name, value in merged.items() if value != self._own[name])
        if changed:
            self._own = merged
            self._apply(merged, changed)


def _as_double(p: RosParameter) -> RosParameter:
    value = _plain(p.value)
    number = [float(v) for v in value] if isinstance(value, list) else float(value)
    return RosParameter(p.name, _FLOAT_TYPES[p.type_], number)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, array | tuple) else value
