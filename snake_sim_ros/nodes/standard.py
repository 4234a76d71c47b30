# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The package simulation_interfaces, the standard of simulators in ROS 2, where it is installed.

`messages`, `services` and `actions` are its modules, or None: the ROS 2 packages on PyPI do not
have it. A type that only newer versions have is looked for with `getattr`.
"""

from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
import re
from typing import Any

Answer = Callable[[Any, Any], Any]  # takes a request and a response, and returns the response
NO_WORLD = 'no world is loaded: call ~/load_world first'


class Refused(ValueError):
    """A request is refused; `code` is that of its result."""

    def __init__(self, code: int, sentence: str) -> None:
        super().__init__(sentence)
        self.code = code


def _module(name: str) -> Any:
    try:
        return import_module(f'simulation_interfaces.{name}')
    except ImportError:
        return None


messages, services, actions = (_module(name) for name in ('msg', 'srv', 'action'))


def offer(node: Any, answers: Mapping[str, Answer]) -> None:
    """Offer those services, by the names of their types, that the package has."""
    for name, answer in answers.items():
        if kind := getattr(services, name, None):
            topic = re.sub('(?<!^)([A-Z])', r'_\1', name).lower()
            node.create_service(kind, f'~/{topic}', answer)


def offer_with_world(node: Any, answers: Mapping[str, Answer]) -> None:
    """Offer services, see `offer`, that refuse all requests while `node.world` is empty."""

    def answer_with_world(answer: Answer, request: Any, response: Any) -> Any:
        if node.world:
            return answer(request, response)
        return answered(response, messages.Result.RESULT_OPERATION_FAILED, NO_WORLD)

    offer(node, {name: partial(answer_with_world, each) for name, each in answers.items()})


def answered(response: Any, code: int, why: str = '') -> Any:
    """Return a response with its result."""
    response.result.result, response.result.error_message = code, why
    return response
