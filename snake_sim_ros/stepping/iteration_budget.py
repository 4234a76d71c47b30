# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A bound on the contact iterations of several steps together, for programs that keep a period."""

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import Report, Stepper
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable
from snake_sim_ros.stepping.state import History, State

FLOOR = 40  # iterations of every step; with fewer, `newton` may end before it has held radii once
TOGETHER = 5  # steps that are tried in one call


class IterationBudget:
    """
    Iterations that the steps of a call share, whichever of them need more than `FLOOR`.

    A few steps are tried together, each with an equal part of what is left as its limit. If one of
    them does not converge, they are taken again, one after the other, each with all that is left
    as its limit. Iterations of both count. Steps that converge have the bits that they have
    without a budget, as long as no step before them was cut. Planar steps at the level `auto` have
    their own low limit.

    Attributes
    ----------
    share : float
        Iterations a step in the mean; 0 is no budget.
    cut : int
        How many steps ended before they converged, since the budget was used up.
    cycles : ndarray, shape (steps+1,)
        Time stamps of the steps of the last call, as `base.Stepper` has them.

    """

    def __init__(self) -> None:
        self.share, self.cut, self.cycles = 0.0, 0, np.zeros(1, np.int64)

    def advance(
        self, stepper: Stepper, most: int, state: State, history: History, angle: Array,
        rate: Array, pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """
        Return state, history and report after as many steps as there are references.

        Parameters
        ----------
        stepper : Stepper
            Of a compiled method.
        most : int
            The limit of a step without a budget. The stepper has it again afterwards.
        state, history, angle, rate, pushes
            As in `base.Stepper.advance`.

        """
        report, ticks = Report(level=stepper.level), [np.zeros(1, np.int64)]
        left, single = int(self.share * len(angle)), 0
        try:
            while report.steps < len(angle) and not report.failure:
                count = 1 if single else min(TOGETHER, len(angle) - report.steps)
                limit = min(most, max(FLOOR, left // count))
                stepper.limit_iterations(limit)
                part = slice(report.steps, report.steps + count)
                acting = pushes.after(report.steps)
                end = stepper.advance(state, history, angle[part], rate[part], None, acting)
                left -= end[2].iterations
                if end[2].unconverged and count > 1 and limit < most:
                    single = count
                    continue
                single = max(0, single - 1)
                self.cut += end[2].unconverged if limit < most else 0
                ticks.append(np.diff(stepper.cycles[: end[2].steps + 1]))
                state, history, report = *end[:2], report + end[2] if report.steps else end[2]
        finally:
            stepper.limit_iterations(most)
        self.cycles = np.cumsum(np.concatenate(ticks))
        return state, history, report
