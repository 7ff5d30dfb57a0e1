"""ROS parameters from pydantic models: declared, described, checked."""

import difflib
import math
from collections.abc import Callable
from typing import Any, Generic, TypeVar

from pydantic.fields import FieldInfo
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from usmap_ros.errors import ConfigurationError
from usmap_ros.io.yaml_files import validated
from usmap_ros.parameters.fields import (
    bounds_of,
    constraints_of,
    flat_fields,
    flat_values,
    former_names,
    is_among,
    nested_values,
    unit_of,
)
from usmap_ros.parameters.nodes import NodeParameters

_Parameters = TypeVar("_Parameters", bound=NodeParameters)

#: What rclpy declares by itself.
_OF_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")
_MAX_INTEGER = 2**63 - 1


def descriptor_of(name: str, info: FieldInfo, read_only: bool) -> ParameterDescriptor:
    """Describe a parameter to ROS: meaning, unit, range, constraints."""
    unit = unit_of(info)
    descriptor = ParameterDescriptor(
        name=name,
        description=(info.description or "") + (f" [{unit}]" if unit else ""),
        additional_constraints=constraints_of(info),
        read_only=read_only,
    )
    bounds = bounds_of(info)
    if not bounds:
        return descriptor
    # ROS knows closed ranges only; an open end is checked with the model.
    least, greatest = bounds.get("ge", bounds.get("gt")), bounds.get("le", bounds.get("lt"))
    if info.annotation is int:
        descriptor.integer_range = [
            IntegerRange(
                from_value=-_MAX_INTEGER if least is None else int(least),
                to_value=_MAX_INTEGER if greatest is None else int(greatest),
                step=0,
            )
        ]
    elif info.annotation is float:
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=-math.inf if least is None else float(least),
                to_value=math.inf if greatest is None else float(greatest),
                step=0.0,
            )
        ]
    return descriptor


class ParameterServer(Generic[_Parameters]):
    """The parameters of a node as a model that is always valid.

    The node must declare parameters from overrides automatically, so that those which nobody
    knows can be named.

    Parameters
    ----------
    node : Node
        Whose parameters they are.
    group : type
        Model to declare.
    why_fixed : callable, optional
        For the name of a parameter: why it cannot be changed now, or None if it can.

    Raises
    ------
    ConfigurationError
        If a value given at the start is unusable.
    """

    def __init__(
        self,
        node: Node,
        group: type[_Parameters],
        why_fixed: Callable[[str], str | None] = lambda name: None,
    ) -> None:
        self._node = node
        self._group = group
        self._why_fixed = why_fixed
        #: Called after `value` has changed.
        self.on_change: list[Callable[[], None]] = []
        fields = dict(flat_fields(group))
        given = {}
        for name in [*fields, *dict(former_names(group))]:
            if node.has_parameter(name):
                given[name] = node.get_parameter(name).value
                node.undeclare_parameter(name)
        self._named = f"parameters of {node.get_fully_qualified_name()}"
        #: The current values.
        self.value = validated(self._named, group, nested_values(given))
        self._warn_of_unknown(fields)
        for name, value in flat_values(self.value).items():
            descriptor = descriptor_of(name, fields[name], is_among(name, group.fixed))
            node.declare_parameter(name, value, descriptor, ignore_override=True)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def refused(self, name: str, cause: str) -> ConfigurationError:
        """Error of a parameter that cannot be used."""
        return ConfigurationError(self._named, f"{name}: {cause}")

    def _warn_of_unknown(self, fields: dict[str, FieldInfo]) -> None:
        # Only a warning: a file may be shared by several nodes under the wildcard /**.
        for name in self._node.list_parameters([], 0).names:
            if not name.startswith(_OF_RCLPY):
                near = difflib.get_close_matches(name, fields, n=1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                self._node.get_logger().warning(f"parameter {name!r} is unknown{hint}")

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        changed = self._ours(parameters)
        for name in changed:
            reason = self._why_fixed(name)
            if reason is not None:
                return SetParametersResult(successful=False, reason=f"{name}: {reason}")
        try:
            self._with(changed)
        except ConfigurationError as error:
            return SetParametersResult(successful=False, reason=error.cause)
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        changed = self._ours(parameters)
        if changed:
            self.value = self._with(changed)
            for callback in self.on_change:
                callback()

    def _ours(self, parameters: list[Parameter]) -> dict[str, Any]:
        known = flat_values(self.value)
        return {item.name: item.value for item in parameters if item.name in known}

    def _with(self, changed: dict[str, Any]) -> _Parameters:
        content = nested_values(flat_values(self.value) | changed)
        return validated("parameters", self._group, content)
