# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Services that control simulated time: ``~/reset``, ``~/pause`` and ``~/step``.

The services of the standard, simulation_interfaces, are offered as well if that package is
installed.
"""

from typing import Any, Protocol

from std_srvs.srv import SetBool, Trigger

try:
    from simulation_interfaces import msg as standard, srv as standard_services
except ImportError:  # The ROS 2 packages on PyPI do not have it.
    standard = standard_services = None

DIVERGED = 'diverged: call ~/reset first'
STILL_RUNNING = 'not paused: call ~/pause with true first'
FEATURES = (
    *('ENTITY_STATE_GETTING', 'ENTITY_STATE_SETTING'),
    *('SIMULATION_RESET', 'SIMULATION_RESET_TIME', 'SIMULATION_RESET_STATE'),
    *('SIMULATION_STATE_GETTING', 'SIMULATION_STATE_SETTING', 'SIMULATION_STATE_PAUSE'),
    *('STEP_SIMULATION_SINGLE', 'STEP_SIMULATION_MULTIPLE'),
)


class Controllable(Protocol):
    """A node whose simulated time the services control."""

    paused: bool
    failure: str
    compiling: str
    seconds: float

    def create_service(self, kind: Any, name: str, callback: Any) -> Any:
        """Offer a service, as every node can."""

    def reset(self, *, state: bool = True, time: bool = False) -> None:
        """Put the robot back to its start, or set time to zero, or both."""

    def step(self, count: int = 1) -> None:
        """Advance by some publish periods."""


class SimulationServices:
    """The services whose types every ROS 2 installation has."""

    def __init__(self, node: Controllable) -> None:
        self.node = node
        node.create_service(Trigger, '~/reset', self._on_reset)
        node.create_service(SetBool, '~/pause', self._on_pause)
        node.create_service(Trigger, '~/step', self._on_step)

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.node.compiling:
            response.message = self.node.compiling
            return response
        self.node.reset()
        response.success = True
        response.message = f'robot is at the start of the scene at t = {self.node.seconds:g} s'
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self.node.failure and not request.data:
            response.message = DIVERGED
            return response
        self.node.paused, response.success = request.data, True
        response.message = 'paused' if request.data else 'running'
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self.node.compiling or not self.node.paused:
            why = DIVERGED if self.node.failure else STILL_RUNNING
            response.message = self.node.compiling or why
            return response
        self.node.step()
        why = self.node.failure or self.node.compiling
        response.success = not why
        response.message = why or f't = {self.node.seconds:g} s'
        return response


class StandardServices:
    """The services of simulation_interfaces; a step is one publish period."""

    def __init__(self, node: Controllable) -> None:
        self.node, self.stopped = node, False
        for name, callback in (
            ('GetSimulatorFeatures', self._on_features),
            ('GetSimulationState', self._on_get_state),
            ('SetSimulationState', self._on_set_state),
            ('ResetSimulation', self._on_reset),
            ('StepSimulation', self._on_step),
        ):
            topic = ''.join('_' + c.lower() if c.isupper() else c for c in name)[1:]
            node.create_service(getattr(standard_services, name), f'~/{topic}', callback)

    @property
    def state(self) -> int:
        """State in the numbers of the standard; stopped until played, paused or stepped."""
        states = standard.SimulationState
        if not self.node.paused and not self.node.failure:
            return int(states.STATE_PLAYING)
        stopped = self.stopped and self.node.seconds == 0.0
        return int(states.STATE_STOPPED if stopped else states.STATE_PAUSED)

    def _on_features(self, _: Any, response: Any) -> Any:
        features = standard.SimulatorFeatures
        # An older version of the package does not have all of them.
        known = [name for name in FEATURES if hasattr(features, name)]
        response.features.features = [getattr(features, name) for name in known]
        response.features.custom_info = 'snake_sim_ros: a step is one publish period'
        return response

    def _on_get_state(self, _: Any, response: Any) -> Any:
        response.state.state = self.state
        response.result.result = standard.Result.RESULT_OK
        return response

    def _on_set_state(self, request: Any, response: Any) -> Any:
        states, wanted, result = standard.SimulationState, request.state.state, response.result
        result.result = standard.Result.RESULT_OK
        if wanted == self.state:
            result.result = type(response).ALREADY_IN_TARGET_STATE
        elif wanted == states.STATE_PLAYING and self.node.failure:
            result.result = type(response).STATE_TRANSITION_ERROR
            result.error_message = f'diverged, reset first: {self.node.failure}'
        elif wanted == states.STATE_STOPPED and self.node.compiling:
            result.result = type(response).STATE_TRANSITION_ERROR
            result.error_message = self.node.compiling
        elif wanted in (states.STATE_PLAYING, states.STATE_PAUSED):
            self.node.paused, self.stopped = wanted == states.STATE_PAUSED, False
        elif wanted == states.STATE_STOPPED:
            self.node.paused = self.stopped = True
            self.node.reset(state=True, time=True)
        else:
            result.result = standard.Result.RESULT_FEATURE_UNSUPPORTED
            result.error_message = f'state must be 0 (stopped), 1 (playing) or 2, got {wanted}'
        return response

    def _on_reset(self, request: Any, response: Any) -> Any:
        kind = type(request)
        scope = request.scope or kind.SCOPE_ALL
        time, state = bool(scope & kind.SCOPE_TIME), bool(scope & kind.SCOPE_STATE)
        response.result.result = standard.Result.RESULT_OK
        if not time and not state:
            response.result.result = standard.Result.RESULT_FEATURE_UNSUPPORTED
            response.result.error_message = f'scope must have bit 1 or 2, got {scope}'
        elif self.node.compiling:
            response.result.result = standard.Result.RESULT_OPERATION_FAILED
            response.result.error_message = self.node.compiling
        else:
            self.node.reset(state=state, time=time)
        return response

    def _on_step(self, request: Any, response: Any) -> Any:
        result = standard.Result
        response.result.result = result.RESULT_OK
        if self.node.compiling or not self.node.paused:
            response.result.result = result.RESULT_OPERATION_FAILED
            response.result.error_message = self.node.compiling or STILL_RUNNING
            return response
        self.node.step(request.steps)
        if why := self.node.failure or self.node.compiling:
            response.result.result = result.RESULT_OPERATION_FAILED
            response.result.error_message = why
        return response


def serve(node: Controllable) -> None:
    """Offer the services of a node whose packages are installed."""
    SimulationServices(node)
    if standard is not None:
        StandardServices(node)
