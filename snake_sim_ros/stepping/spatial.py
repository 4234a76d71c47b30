# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The spatial model level as a stepper."""

from collections.abc import Callable
from typing import Any

import numpy as np

from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.base import Inputs, Report
from snake_sim_ros.stepping.model import make_model, make_workspace
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable
from snake_sim_ros.stepping.samples import checked, make_samples, Samples
from snake_sim_ros.stepping.state import copied, empty_history, History, Returned, State
from snake_sim_ros.stepping.steps import (
    ANY_PITCH,
    End,
    make_steps,
    Record,
    report_of,
    StepsInPlace,
)


class SpatialStepper:
    """
    A stepper with a compiled loop over steps of all links in space; see `base.Stepper`.

    Parameters
    ----------
    scene : Scene
    loop : callable
        Compiled ``advance(model, work, steps)``, which takes the steps up to the first that
        diverges; see `steps.Steps`. Its first argument is bound: a contact solver of
        `moreau.advance_moreau`, or the arrays of `bdf2.advance_bdf2`.
    memory : NamedTuple of arrays, optional
        Memory of the loop before the first step; see `state.History`.

    """

    level = 'spatial'

    def __init__(self, scene: Scene, loop: Callable[..., None], memory: Any = None) -> None:
        self.model = make_model(scene)
        self.work = make_workspace(scene)
        self.loop = loop
        self.empty = empty_history(scene, memory)
        self.returned = Returned(scene.robot.link_count, self.empty)
        self.no_samples = make_samples(scene, 0, 0)
        self.no_record = Record(*self.no_samples[:-1])
        self.cycles = np.zeros(1, np.int64)

    def empty_history(self) -> History:
        """Return the history before the first step."""
        return self.returned.empty_history()

    def watch(self, settle_steps: int) -> None:
        """Let `advance` end once the robot has lain flat and still for that number of steps."""
        self.model = self.model._replace(settle_steps=settle_steps)

    def limit_iterations(self, limit: int) -> None:
        """Let a step take that many iterations at most."""
        self.model = self.model._replace(iteration_limit=limit)

    def advance(
        self, state: State, history: History, angle: Array, rate: Array,
        samples: Samples | None = None, pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """Return state, history and report after as many steps as there are references."""
        self.returned.check(state, history, angle, rate)
        inputs = Inputs(angle, rate, checked(samples, self.no_samples), pushes)
        state, history, report = self.take_steps(state, copied(history), inputs)
        self.returned.last = state, history
        return state, history, report

    def take_steps(
        self, state: State, history: History, inputs: Inputs
    ) -> tuple[State, History, Report]:
        """Advance with checked arguments, of which the history is changed in place."""
        angle, rate, samples, pushes = inputs
        start, record = (state.q.copy(), state.u.copy()), Record(*samples[:-1])
        steps = make_steps(start, history, (angle, rate), record, pushes)
        self.loop(self.model, self.work, steps)
        self.cycles = steps.cycles
        report = report_of(steps, self.work.applied, self.model.dt, self.level)
        history = self.empty_history() if report.failure else steps.history
        return State(steps.q, steps.u), history, report

    def in_place(
        self, count: int, state: State, history: History, pushes: PushTable,
        pitch: int = ANY_PITCH,
    ) -> StepsInPlace:  # fmt: skip
        """Return steps that continue from a state and its history; see `steps.StepsInPlace`."""
        end = End(
            state=lambda steps: State(steps.q.copy(), steps.u.copy()),
            history=lambda steps: copied(steps.history),
        )
        return StepsInPlace(self, count, (state.q, state.u), history, pushes, pitch, end)
