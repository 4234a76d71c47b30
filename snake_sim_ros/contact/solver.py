"""The contact problem of a step, and what solves it."""

from typing import Any
from typing import NamedTuple

from snake_sim_ros.contact.laws import Laws
from snake_sim_ros.dynamics.articulated_body import Chain
from snake_sim_ros.dynamics.compilation import dispatched
from snake_sim_ros.scene.parameters import Array


class Problem(NamedTuple):
    """
    The closed contacts of a step, their laws, and the links that they act on.

    A solver fills `contacts.impulse`, `contacts.gamma` and `chain.twist` with the solution.
    """

    laws: Laws
    closed: Array  # (k,) numbers of the closed contacts
    contacts: Any  # (c,) records of all contacts, see `table`
    chain: Chain


class Outcome(NamedTuple):
    """How a contact solver ended."""

    iterations: int
    converged: bool
    residual: float  # natural-map residual with the selection rule [m/s], see `natural_map`
    printed_residual: float  # without the rule [m/s]
    fell_back: bool  # whether the solver fell back on a slower method


@dispatched
def solve(solver, model, problem, history):
    """
    Solve the contact problem of a step with the method that the type of `solver` stands for.

    Compiled. Every method registers a class of its own, which holds the arrays that it needs.

    Parameters
    ----------
    solver : NamedTuple
    model : Model
        See `stepping.model`: tolerances, iteration limit and time step.
    problem : Problem
    history : History
        See `stepping.base`: the impulses of the last step, where the method starts from. It is
        filled with those of this step.

    Returns
    -------
    Outcome

    """
