# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The contact problem of a step, and the call that solves it."""

from typing import Any, NamedTuple

from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.compilation import Dispatched
from snake_sim_ros.scene.parameters import Array


class Problem(NamedTuple):
    """
    The closed contacts of a step, their laws, and the links that they act on.

    Functions that take `laws`, `closed`, `contacts` or `chain` take these parts of a problem.

    A solver fills `contacts.impulse`, `contacts.gamma` and `chain.twist` with the solution.
    """

    laws: Laws
    closed: Array  # (k,) numbers of the closed contacts
    contacts: Any  # (c,) table of all contacts, see `table`
    chain: Chain


class Outcome(NamedTuple):
    """How a contact solver ended."""

    iterations: int
    converged: bool
    residual: float  # natural-map residual with the selection rule [m/s], see `natural_map`
    printed_residual: float  # without the rule [m/s]
    fell_back: bool  # whether a slower method had to help


@Dispatched
def solve(solver, model, problem, history, limit):
    """
    Solve the contact problem of a step with the method that belongs to the type of `solver`.

    The call is compiled. Every method registers a class of its own, which holds its arrays.

    Parameters
    ----------
    solver : NamedTuple
        Arrays of the method.
    model : Model
        Tolerances and time step; see `stepping.model`.
    problem : Problem
        Its contacts and chain are filled with the solution.
    history : History
        Impulses of the last step, from which the method starts; see `stepping.state`. They are
        replaced by those of this step.
    limit : int
        Most iterations that it may take, at least 1.

    Returns
    -------
    Outcome

    """
