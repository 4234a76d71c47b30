"""Points and forces of the contacts of a robot, from the state and history of the last step."""

import numpy as np

from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.obstacles import contact_geometry
from snake_sim_ros.scene.obstacles import contact_links
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.methods import method_of
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import check_state
from snake_sim_ros.stepping.state import History
from snake_sim_ros.stepping.state import State


def contact_forces(scene: Scene, state: State, history: History) -> tuple[Array, Array]:
    """
    Return points and forces of the contacts that carried load in the last step.

    Forces are impulses over the time for which they acted, also in impacts. Of two links that
    touch it is the force on the first one. Rolling friction is a torque and is not included.

    Parameters
    ----------
    scene : Scene
    state : State
    history : History
        Those after the step.

    Returns
    -------
    points, forces : ndarray, shape (k, 3)
        [m, frame I], [N, frame I]

    Raises
    ------
    ParameterError
        If state or history do not fit the scene; see `state.check_state`.

    """
    check_state(scene.robot.link_count, contact_count(scene), state, history)
    loaded = loaded_contacts(history)
    q, span = where_impulses_acted(scene, state, history)
    ground = loaded[loaded < 2 * scene.robot.link_count]
    others = loaded[len(ground) :]
    points, frames = contacts_below(scene, q, ground)
    if len(others):
        wanted = np.isin(np.arange(contact_count(scene)), others)
        _, lever, frame = contact_geometry(scene, q, wanted)
        centers = q[contact_links(scene)[others, 0], :3]
        points = np.concatenate([points, centers + lever[others]])
        frames = np.concatenate([frames, frame[others]])
    impulses = history.impulse[loaded, :3]
    return points, np.einsum('ak,aki->ai', impulses, frames) / span


def loaded_contacts(history: History) -> Array:
    """Return the numbers of the contacts that carried load, in the order of `contact_forces`."""
    return np.flatnonzero(history.impulse[:, 0] > 0.0)


def where_impulses_acted(scene: Scene, state: State, history: History) -> tuple[Array, float]:
    """Return coordinates and time of the last impulses, by the method; see `base.Method`."""
    return METHODS[method_of(scene)].where_impulses_acted(scene, state, history.memory)


def contacts_below(scene: Scene, q: Array, contacts: Array) -> tuple[Array, Array]:
    """
    Return points (k, 3) [m, frame I] and frames (k, 3, 3) of spheres on the ground below them.

    These are those of `obstacles.contact_geometry`, computed for all contacts at once, since most
    contacts are of this kind. `contacts` (k,) are their numbers.
    """
    robot = scene.robot
    side, i = np.divmod(contacts, robot.link_count)
    axis = rotation_matrices(q[i, 3:])[:, :, 2]
    arm = np.where(side, -1.0, 1.0) * robot.per_link('contact_offset')[i]
    points = q[i, :3] + arm[:, None] * axis
    points[:, 2] -= robot.per_link('contact_radius')[i]
    vertical = np.hypot(axis[:, 0], axis[:, 1]) <= 1e-6
    heading = np.where(vertical[:, None], [1.0, 0.0], axis[:, :2])
    heading /= np.linalg.norm(heading, axis=1)[:, None]
    frames = np.zeros((len(i), 3, 3))
    frames[:, 0, 2] = 1.0
    frames[:, 1, :2] = heading
    frames[:, 2, 0], frames[:, 2, 1] = -heading[:, 1], heading[:, 0]
    return points, frames
