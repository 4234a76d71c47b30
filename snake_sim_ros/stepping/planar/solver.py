# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The call that solves the contacts of a step in the plane."""

from snake_sim_ros.dynamics.compilation import Dispatched


@Dispatched
def solve_in_plane(solver, model, work, closed, history, limit):
    """
    Solve the contacts of a step in the plane with the method of the type of `solver`.

    This is `contact.solver.solve` for the plane, where the normal loads follow from the friction:
    a method fills impulses and velocities in `work.contacts`, and `work.twist`; see `equilibrium`.

    Parameters
    ----------
    solver : NamedTuple
    model : PlanarModel
    work : PlanarWorkspace
    closed : ndarray, shape (k,)
        Numbers of the closed contacts.
    history : History
        That of the last step; it is replaced by that of this step.
    limit : int
        Most iterations that it may take, at least 1.

    Returns
    -------
    Outcome

    """
