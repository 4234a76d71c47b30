# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Where the next rounds of Newton's method start if the first ones do not converge.

The rounds here take the laws as `linear_problem.close_law` makes them linear: whether a contact
sticks, and where it slides to, follows from velocity and impulse together, as in [1]_. Near a
solution that is the same as before. Farther from it, friction does not turn by half a turn when a
velocity changes its sign.

The first of these rounds begins at the prediction. Where it fails, the selection rule leads to the
solution (continuation): with a compliance as large as the Delassus operator, contacts hardly feel
each other, and from any start the problem is solved in a few iterations. The compliance then
falls to that of the step; each round begins at the end of the last one that converged, and takes
the larger a step the better that went. First the rule is compliant about the predicted impulses,
so that it begins near them. Where no path leads on from there, since the robot jams or jumps, it
begins at no impulses.

.. [1] P. Alart, A. Curnier, "A mixed formulation for frictional contact problems prone to Newton
   like solution methods", Comput. Methods Appl. Mech. Eng. 92, 1991.
"""

import math
from typing import NamedTuple

from snake_sim_ros.contact.admissible import anchor_at_iterate
from snake_sim_ros.contact.contacts import Contacts
from snake_sim_ros.contact.delassus import end_twists
from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.contact.problem import ContactHistory, Problem
from snake_sim_ros.contact.sweeps import predict
from snake_sim_ros.dynamics.articulated_body import factor_chain, reset_chain
from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.scene.parameters import Array

# Where a path begins: at the prediction without compliance, with compliance about the prediction,
# with compliance about no impulses; ENDED: there is no other one.
PREDICTED, ABOUT_PREDICTION, ABOUT_NOTHING, ENDED = range(4)
FIRST_COMPLIANCE = 1e6  # relative to that of the proximal point method
FIRST_SHARE = 0.1  # of the compliance that the next round has
LEAST_SHARE = 1e-4
MOST_SHARE = 0.97  # a path that goes on by less than this ends
CLOSE_ITERATIONS = 10  # of a round, unless the residual falls
ROUGH = 1e4  # residual at which rounds on the way end, over the tolerance


class Stage(NamedTuple):
    """A round on the way to the laws of a step."""

    path: int  # where it began
    compliance: float  # of the selection rule [1/kg]
    reached: float  # that of the last round that converged, infinite before [1/kg]
    share: float  # of it that this round has [1]


@inlined
def first_stage(laws: Laws, path: int) -> Stage:
    """Return the stage in which a path begins."""
    if path == PREDICTED:
        return Stage(path, laws.compliance, math.inf, FIRST_SHARE)
    return Stage(path, FIRST_COMPLIANCE * laws.proximal_compliance, math.inf, FIRST_SHARE)


@inlined
def next_stage(laws: Laws, stage: Stage, converged: bool) -> Stage:
    """Return the stage after one that converged, or that did not."""
    path, compliance, reached, share = stage
    if converged:
        if reached < math.inf:
            share = max(share * share, LEAST_SHARE)
        reached = compliance
    else:
        share = math.sqrt(share)
        if share > MOST_SHARE or reached == math.inf:
            return first_stage(laws, path + 1)
    compliance = share * reached
    if compliance <= max(laws.compliance, laws.proximal_compliance):
        compliance = laws.compliance
    return Stage(path, compliance, reached, share)


@inlined
def laws_of_stage(laws: Laws, stage: Stage) -> Laws:
    """Return the laws with the compliance of a stage."""
    return Laws(
        laws.sliding, laws.rolling, stage.compliance, laws.least_compliance,
        laws.proximal_compliance, laws.r_N, laws.r_T, laws.r_V, laws.residual_tolerance,
        laws.change_tolerance, laws.other,
    )  # fmt: skip


@inlined
def predicted_load(history: ContactHistory, a: int) -> float:
    """Return the normal impulse of contact a if it changes as in the last step [N s]."""
    P_N = history.impulse[a, 0]
    return max(0.0, P_N + history.change[a, 0]) if P_N > 0.0 else 0.0


@compiled
def begin_stage(problem: Problem, history: ContactHistory, stage: Stage) -> None:
    """Fill trial, iterate, anchors and selection centers of the contacts for a stage."""
    laws, closed, contacts, chain, _, _ = problem
    solution, newton = contacts.solution, contacts.newton
    if stage.reached == math.inf:
        for a in closed:
            for j in range(5):
                P = history.impulse[a, j] if stage.path != ABOUT_NOTHING else 0.0
                solution.impulse[a, j] = P
            if stage.path != ABOUT_NOTHING:
                solution.impulse[a, 0] = predicted_load(history, a)
        reset_chain(chain)
        factor_chain(chain)
        end_twists(closed, contacts, chain)
        if stage.path == PREDICTED:
            predict(laws, closed, contacts, history)
        else:
            for a in closed:
                for j in range(5):
                    newton.trial[a, j] = solution.gamma[a, j]
                    newton.iterate[a, j] = solution.impulse[a, j]
    else:
        for a in closed:
            for j in range(5):
                newton.trial[a, j] = newton.saved_trial[a, j]
                newton.iterate[a, j] = newton.saved_iterate[a, j]
    share = laws.compliance / stage.compliance if stage.compliance > laws.compliance else 1.0
    for a in closed:
        about = predicted_load(history, a) if stage.path == ABOUT_PREDICTION else 0.0
        solution.selection_center[a] = share * newton.rule_center[a] + (1.0 - share) * about
        if stage.reached < math.inf and newton.iterate[a, 0] > 0.0:
            newton.trial[a, 0] = stage.compliance * (
                solution.selection_center[a] - newton.iterate[a, 0]
            )
    anchor_at_iterate(laws, closed, contacts)


@inlined
def end_stage(closed: Array, contacts: Contacts) -> None:
    """Keep the end of a stage that converged, from which the next one begins."""
    newton = contacts.newton
    for a in closed:
        for j in range(5):
            newton.saved_trial[a, j] = newton.trial[a, j]
            newton.saved_iterate[a, j] = newton.iterate[a, j]


@inlined
def keep_centers(closed: Array, contacts: Contacts) -> None:
    """Keep the selection centers of the step."""
    for a in closed:
        contacts.newton.rule_center[a] = contacts.solution.selection_center[a]


@inlined
def end_continuation(closed: Array, contacts: Contacts) -> None:
    """Return to the selection centers of the step."""
    for a in closed:
        contacts.solution.selection_center[a] = contacts.newton.rule_center[a]
