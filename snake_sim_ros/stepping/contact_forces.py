"""Where a robot touches and with what forces, from what the last step left behind."""

import numpy as np

from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.obstacles import contact_geometry
from snake_sim_ros.scene.obstacles import links
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.rotations import product
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping import bdf2
from snake_sim_ros.stepping.base import check_state
from snake_sim_ros.stepping.base import IMPULSE
from snake_sim_ros.stepping.base import method_of
from snake_sim_ros.stepping.base import PREVIOUS
from snake_sim_ros.stepping.base import State
from snake_sim_ros.stepping.planar.stepper import KNOWN


def contact_forces(scene: Scene, state: State, history: Array) -> tuple[Array, Array]:
    """
    Return points and forces of the contacts that carried load in the last step.

    Forces are impulses over the time in which they acted, those of impacts, too. Of two links that
    touch it is the force on the first one. Rolling friction is a torque, and not in them.

    Parameters
    ----------
    scene : Scene
    state : State
        After the step.
    history : ndarray, shape (7, contacts, 5)
        After the step; see `base.Stepper`.

    Returns
    -------
    points, forces : ndarray, shape (k, 3)
        [m, frame I], [N, frame I]

    Raises
    ------
    ParameterError
        If state or history are those of another scene.

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
        centers = q[links(scene)[others, 0], :3]
        points = np.concatenate([points, centers + lever[others]])
        frames = np.concatenate([frames, frame[others]])
    impulses = history[IMPULSE, loaded, :3]
    return points, np.einsum('ak,aki->ai', impulses, frames) / span


def loaded_contacts(history: Array) -> Array:
    """Return the numbers of the contacts that carried load, in the order of `contact_forces`."""
    return np.flatnonzero(history[IMPULSE, :, 0] > 0.0)


def where_impulses_acted(scene: Scene, state: State, history: Array) -> tuple[Array, float]:
    """
    Return the coordinates (n, 7) for which the last step had impulses, and how long they act [s].

    The step of the paper has them at its middle, for all of it; `bdf2` at its end as it is
    predicted, for a part of it that is kept in history, or the whole step if nothing is kept.
    """
    if method_of(scene) == 'bdf2':
        n, memory = scene.robot.link_count, history[PREVIOUS:].ravel()
        span = memory[13 * n + 3 if memory[KNOWN] else 26 * n + bdf2.SPAN]
        return state.q, span or scene.dt  # 0: of steps of another method or of another scene
    q = state.q.copy()
    q[:, :3] -= scene.dt / 2 * state.u[:, :3]
    spin = np.column_stack([np.zeros(len(q)), state.u[:, 3:]])
    q[:, 3:] -= scene.dt / 4 * product(q[:, 3:], spin)
    q[:, 3:] /= np.linalg.norm(q[:, 3:], axis=1)[:, None]
    return q, scene.dt


def contacts_below(scene: Scene, q: Array, contacts: Array) -> tuple[Array, Array]:
    """
    Return points (k, 3) and frames (k, 3, 3) of spheres on the ground below them.

    As in `obstacles.contact_geometry`, but all at once: most contacts are of this kind.
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
