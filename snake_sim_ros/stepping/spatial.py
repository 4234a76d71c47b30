# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The spatial model level as a stepper."""

from collections.abc import Callable
from typing import NamedTuple

from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.base import Inputs, Report
from snake_sim_ros.stepping.loops import ANY_PITCH, Calls, End, LoopStepper, show, StepsInPlace
from snake_sim_ros.stepping.model import make_model, make_workspace, Model
from snake_sim_ros.stepping.pushes import PushTable
from snake_sim_ros.stepping.samples import Samples
from snake_sim_ros.stepping.state import copied, History, Memory, State
from snake_sim_ros.stepping.steps import copy_numbers, make_steps, Record


class InSpace(NamedTuple):
    """What `loops.show` takes after steps in space."""

    q: Array  # (n, 7)
    u: Array  # (n, 6)
    links: Array  # (n, 7) filled with q
    velocities: Array  # (n, 6) filled with u


@show.register(InSpace)
@compiled
def show_in_space(shown: InSpace) -> None:
    """Fill coordinates and velocities of the links; a loop in space fills samples itself."""
    copy_numbers(shown.q, shown.links)
    copy_numbers(shown.u, shown.velocities)


class SpatialStepper(LoopStepper):
    """A stepper with a loop over steps of all links in space; for parameters see `LoopStepper`."""

    level = 'spatial'
    model: Model

    def __init__(
        self, scene: Scene, loop: Callable[..., None], memory: Memory | None = None
    ) -> None:
        super().__init__(scene, loop, make_model(scene), make_workspace(scene), memory)

    def watch(self, settle_steps: int) -> None:
        """Let `advance` end once the robot has lain flat and still for that number of steps."""
        if self.model.settle_steps != settle_steps:
            self.model = self.model._replace(settle_steps=settle_steps)

    def take_steps(
        self, state: State, history: History, inputs: Inputs
    ) -> tuple[State, History, Report]:
        """Advance with checked arguments, of which the history is changed in place."""
        angle, rate, samples, pushes = inputs
        start, record = (state.q.copy(), state.u.copy()), self.record_of(samples)
        steps = make_steps(start, history, (angle, rate), record, pushes)
        report = self.run_loop(steps)
        history = self.empty_history() if report.failure else steps.history
        return State(steps.q, steps.u), history, report

    def record_of(self, kept: Samples) -> Record:
        """Return what the loop keeps: the samples themselves."""
        return Record(*kept[:-1])

    def in_place(
        self, count: int, state: State, history: History, pushes: PushTable, every: int = 0,
        pitch: int = ANY_PITCH,
    ) -> StepsInPlace:  # fmt: skip
        """Return steps that continue from a state and its history; see `StepsInPlace`."""
        end = End(
            history=lambda steps: copied(steps.history),
            shown=lambda steps, _, q, u: InSpace(steps.q, steps.u, q, u),
        )
        calls = Calls(count, every, pushes, pitch)
        return StepsInPlace(self, calls, (state.q, state.u), history, end, state)
