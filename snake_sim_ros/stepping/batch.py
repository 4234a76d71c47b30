# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Many simulations that take steps in one compiled call, each with the bits that it has alone.

Robots whose steps continue in place, see `loops.StepsInPlace`, need no Python: one loop over all
of them calls the machine code of each. Where steps are not like the last ones, as after a reset or
where the level changes, a simulation advances by itself, one after the other.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from snake_sim_ros.dynamics.compilation import record_array
from snake_sim_ros.dynamics.records import call_each
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.loops import Shared, StepsInPlace
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import History, State
from snake_sim_ros.stepping.steps import LoopReport


class Batch:
    """
    Simulations with as many links each, which take the same number of steps at a time.

    Parameters
    ----------
    simulations : sequence of Simulation
        N simulations, which nobody else advances. Their scenes may differ.
    threads : int, optional
        Threads that share the simulations in a call.

    Attributes
    ----------
    q, u : ndarray, shape (N, n, 7) and (N, n, 6)
        The states of all, as `state.State` has them.
    torque : ndarray, shape (N, n-1, 2)
        Joint torques of the last steps [N m].
    unconverged : ndarray of int, shape (N,)
        As in the reports of the simulations.
    failed : ndarray of bool, shape (N,)
        Which have diverged and take no steps until a reset.

    """

    def __init__(self, simulations: Sequence[Simulation], threads: int = 1) -> None:
        self._simulations, count = list(simulations), len(simulations)
        links = {simulation.scene.robot.link_count for simulation in simulations}
        if len(links) != 1:
            raise ParameterError(
                f'simulations of a batch must have the same number of links, got {sorted(links)}'
            )
        n = links.pop()
        self.q, self.u = np.zeros((count, n, 7)), np.zeros((count, n, 6))
        self.torque, self.angle = np.zeros((count, n - 1, 2)), np.zeros((count, 0, n - 1, 2))
        self.rate, self.failed = self.angle.copy(), np.zeros(count, bool)
        self._totals: Any = record_array(count, LoopReport)
        self._noted = np.zeros(count, np.int64)  # unconverged steps that the simulations know of
        self._calls, self._values = np.zeros((count, 2), np.int64), np.zeros(count, np.int64)
        self._places: list[StepsInPlace | None] = [None] * count
        self._goes_on = np.zeros(count, bool)
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self._threads = threads
        for i in range(count):
            self._look(i)

    @property
    def unconverged(self) -> Array:
        """Steps that did not converge since the last reset, (N,)."""
        return np.asarray(self._noted + self._totals['unconverged'])

    def advance(self, angle: Array, rate: Array, rows: Array | None = None) -> None:
        """
        Take as many steps as there are references, as `Simulation.advance` does.

        Parameters
        ----------
        angle, rate : ndarray, shape (N, steps, n-1, 2)
            Joint references of every simulation [rad], [rad/s].
        rows : ndarray of int, shape (k,), optional
            Which of the simulations; default: all.

        """
        if angle.shape != self.angle.shape:
            for i in np.flatnonzero(self._goes_on):
                self.simulation(int(i))
            self.angle, self.rate = np.empty(angle.shape), np.empty(angle.shape)
            self._places = [None] * len(self.q)
        self.angle[...], self.rate[...] = angle, rate
        rows = np.arange(len(self.q)) if rows is None else np.asarray(rows)
        self._values[rows] = 0
        going = rows[self._goes_on[rows]]
        if self._pool:
            parts = [part for part in np.array_split(going, self._threads) if len(part)]
            list(self._pool.map(self._call, parts))
        else:
            self._call(going)
        for i in rows[self._values[rows] != 1]:
            self._advance_alone(int(i))

    def simulation(self, i: int) -> Simulation:
        """Return a simulation, with which one may do everything before the next call."""
        simulation, place = self._simulations[i], self._places[i]
        if place and self._goes_on[i]:
            simulation.step_count += int(self._totals['steps'][i])
            # What was handed out before may change no more.
            place.given_state = place.given_history = None
            self._goes_on[i] = False
        self._noted[i] = simulation.report.unconverged
        return simulation

    def now(self, i: int) -> tuple[Scene, State, History]:
        """Return scene, state and history of a simulation, to be read."""
        simulation = self._simulations[i]
        return simulation.scene, simulation.present_state, simulation.present_history

    def put(self, i: int, simulation: Simulation) -> None:
        """Put a simulation in the place of another one, or one that has changed."""
        self.simulation(i)
        self._simulations[i] = simulation
        self._noted[i] = simulation.report.unconverged
        self._look(i)

    def _call(self, rows: Array) -> None:
        """Let simulations go on in place."""
        call_each(self._calls, rows, self._values)

    def _advance_alone(self, i: int) -> None:
        """Let a simulation take steps by itself."""
        simulation = self.simulation(i)
        simulation.advance(self.angle[i], self.rate[i])
        self._look(i)
        if simulation.pushes or simulation.budget.share:
            return
        place = simulation.go_on_in_place(self.angle.shape[1])
        if not place:
            return
        if place is not self._places[i]:
            arrays = self.angle[i], self.rate[i], self.q[i], self.u[i], self.torque[i]
            self._calls[i] = place.bind(Shared(*arrays, self._totals[i : i + 1]))
            self._places[i] = place
        place.steps.pushes.clock[0] = simulation.step_count
        self._goes_on[i] = True

    def _look(self, i: int) -> None:
        """Take over state and torques of a simulation."""
        simulation = self._simulations[i]
        state, self.failed[i] = simulation.state, bool(simulation.report.failure)
        self.q[i], self.u[i], self.torque[i] = state.q, state.u, simulation.last.joint_torque
        self._noted[i] = simulation.report.unconverged
