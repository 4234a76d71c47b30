"""The spatial model level as a stepper."""

from collections.abc import Callable

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.base import check_arguments
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.base import State
from snake_sim_ros.stepping.model import make_model
from snake_sim_ros.stepping.model import make_workspace
from snake_sim_ros.stepping.report import report_from
from snake_sim_ros.stepping.report import REPORT_SIZE


class SpatialStepper:
    """
    A compiled contact solver in the time step of the paper; see `base.Stepper`.

    Parameters
    ----------
    scene : Scene
    loop : callable
        Compiled ``advance(model, work, q, u, history, angle, rate, report, cycles)``: advances q,
        u and history in place by one step a reference, up to the first that diverges, and fills
        cycles with the time stamps between the steps. What else it takes is bound before: a type
        of work that all loops share is compiled once.

    """

    level = 'spatial'

    def __init__(self, scene: Scene, loop: Callable[..., None]) -> None:
        self.model = make_model(scene)
        self.work = make_workspace(scene)
        self.loop = loop
        self.cycles = np.zeros(1, np.int64)

    def watch(self, settle_steps: int) -> None:
        """Let `advance` end early when the robot has lain flat and still for that many steps."""
        self.model = self.model._replace(settle_steps=settle_steps)

    def advance(
        self, state: State, history: Array, angle: Array, rate: Array
    ) -> tuple[State, Array, Report]:
        """Return state, history and report after as many steps as there are references."""
        counts = len(self.model.mass), len(self.work.contact)
        check_arguments(*counts, state, history, angle, rate)
        q, u, history = state.q.copy(), state.u.copy(), history.copy()
        numbers, self.cycles = np.zeros(REPORT_SIZE), np.zeros(len(angle) + 1, np.int64)
        angle, rate = np.ascontiguousarray(angle), np.ascontiguousarray(rate)
        self.loop(self.model, self.work, q, u, history, angle, rate, numbers, self.cycles)
        return State(q, u), history, report_from(numbers, self.work.applied, self.model.dt)
