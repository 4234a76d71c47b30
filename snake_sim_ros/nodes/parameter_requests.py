# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Requests to set parameters, of which rclpy cannot take all."""

from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterException
from rclpy.parameter_service import ParameterService

# Errors that a value causes, such as one of a type that does not exist.
NOT_USABLE = (
    *(ValueError, TypeError, ArithmeticError, LookupError, AttributeError, RuntimeError),
    *(OSError, ParameterException),
)


class ParameterRequests(ParameterService):
    """
    The services for parameters of a node, as rclpy offers them, but every request is answered.

    An error out of a callback would end the node, and leave requests that wait in their queue.
    The node is made with ``start_parameter_services=False``.
    """

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        try:
            return super()._set_parameters_callback(request, response)
        except NOT_USABLE as error:
            response.results = [_refused(error)] * len(request.parameters)
            return response

    def _set_parameters_atomically_callback(self, request: Any, response: Any) -> Any:
        try:
            return super()._set_parameters_atomically_callback(request, response)
        except NOT_USABLE as error:
            response.result = _refused(error)
            return response


def _refused(error: Exception) -> SetParametersResult:
    reason = str(error).partition('\n')[0]
    return SetParametersResult(successful=False, reason=f'not usable: {reason}')
