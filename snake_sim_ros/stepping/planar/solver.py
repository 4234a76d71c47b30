"""What solves the contacts of a step in the plane."""

from snake_sim_ros.dynamics.compilation import Dispatched


@Dispatched
def solve_in_plane(solver, model, work, closed, history):
    """
    Solve the contacts of a step in the plane with the method that the type of `solver` stands for.

    Compiled. As `contact.solver.solve`, but the loads follow from the friction: a method fills
    impulses and relative velocities in `work.contacts`, and `work.twist`, for which it has
    `equilibrium`.

    Parameters
    ----------
    solver : NamedTuple
    model : PlanarModel
    work : PlanarWorkspace
    closed : ndarray, shape (k,)
        Numbers of the closed contacts.
    history : History
        Of the last step; it is filled with that of this step.

    Returns
    -------
    Outcome

    """
