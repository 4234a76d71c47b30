"""ROS parameters of the nodes: a record's fields under their dotted names, with descriptors."""

from collections.abc import Mapping
import difflib
import math
import sys
from typing import Any

from rcl_interfaces.msg import FloatingPointRange
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from snake_sim_ros.records import ParameterError

# Parameters that rclpy itself knows.
OF_RCLPY = ('use_sim_time', 'start_type_description_service')


def given_parameters(node: Node) -> dict[str, Any]:
    """Return name -> value of all parameters that the user set; the node declares them itself."""
    return {name: item.value for name, item in node.get_parameters_by_prefix('').items()}


def declare(node: Node, name: str, value: Any, limits: Mapping[str, Any], read_only: bool) -> None:
    """Declare a parameter or, if the user set it, describe it; `limits` as made by `quantity`."""
    unit = f' [{limits["unit"]}]' if limits['unit'] not in ('', '1') else ''
    descriptor = ParameterDescriptor(
        name=name,
        description=limits['meaning'] + unit,
        read_only=read_only,
        dynamic_typing=True,
        additional_constraints=', '.join(limits['choices']),
    )
    low = max(limits['minimum'], limits['above'])
    if isinstance(value, float) and (math.isfinite(low) or math.isfinite(limits['maximum'])):
        largest = sys.float_info.max
        descriptor.floating_point_range = [
            FloatingPointRange(
                from_value=max(low, -largest), to_value=min(limits['maximum'], largest)
            )
        ]
    if isinstance(value, tuple):
        value = list(value)
    if node.has_parameter(name):
        node.undeclare_parameter(name)
    node.declare_parameter(name, value, descriptor, ignore_override=True)


def refuse_unknown(given: Mapping[str, Any], known: set[str]) -> None:
    """
    Raise if the user set a parameter that the node does not have.

    Raises
    ------
    ParameterError
        Naming the nearest right one.

    """
    for name in given:
        if name not in known and name not in OF_RCLPY and not name.startswith('qos_overrides.'):
            close = difflib.get_close_matches(name, sorted(known), n=1)
            hint = (
                f'did you mean {close[0]!r}?'
                if close
                else f'choose from: {", ".join(sorted(known))}'
            )
            raise ParameterError(f'unknown parameter {name!r}; {hint}')
