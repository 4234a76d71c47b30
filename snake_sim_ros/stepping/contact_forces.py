# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Points and forces of the contacts of a robot, from the state and history of the last step."""

import math

import numpy as np

from snake_sim_ros.contact.placing import world_geometry
from snake_sim_ros.contact.surroundings import make_surroundings, Surroundings
from snake_sim_ros.dynamics.kinematics import axis_z, carried_place
from snake_sim_ros.dynamics.records import entry
from snake_sim_ros.scene.chain import Spheres
from snake_sim_ros.scene.obstacles import (
    contact_count,
    contact_friction,
    contact_geometry,
    contact_links,
    first_peg,
    UPRIGHT,
)
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.methods import method_of, METHODS
from snake_sim_ros.stepping.state import check_state, History, State

Loaded = tuple[Array, Array]  # sample and number of the contacts that carried load


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
    return last_forces(scene, state, history)[2:]


def last_forces(scene: Scene, state: State, history: History) -> tuple[Array, Array, Array, Array]:
    """Return what `sampled_forces` does, for the last step alone."""
    span = np.array([last_span(scene, history)])
    return sampled_forces(scene, state.q[None], state.u[None], history.impulse[None], span)


def sampled_forces(
    scene: Scene, q: Array, u: Array, impulse: Array, span: Array
) -> tuple[Array, Array, Array, Array]:
    """
    Return the contacts that carried load in the steps before m samples; see `contact_forces`.

    Parameters
    ----------
    scene : Scene
    q, u, impulse, span : ndarray, shapes (m, n, 7), (m, n, 6), (m, contacts, 5), (m,)
        As in `samples.Samples`.

    Returns
    -------
    sample, number : ndarray of int, shape (k,)
        Of every contact that carried load.
    points, forces : ndarray, shape (k, 3)
        [m, frame I], [N, frame I]

    """
    # NumPy returns columns of a table if there are two contacts or more: other types to compile.
    sample, number = map(np.ascontiguousarray, np.nonzero(impulse[:, :, 0] > 0.0))
    acted = METHODS[method_of(scene)].where_impulses_acted(scene, q, u)
    points, forces = np.empty((2, len(sample), 3))
    spheres = scene.robot.chain.spheres
    forces_of_ground(spheres, acted, (impulse, span), (sample, number), points, forces)
    others = number >= len(spheres.link)
    world = make_surroundings(scene) if scene.world else None
    for m in np.flatnonzero(np.bincount(sample[others])):  # np.unique imports np.ma
        here = np.flatnonzero(others & (sample == m))
        touching = number[here]
        wanted = np.isin(np.arange(contact_count(scene)), touching)
        lever, frame, _ = touching_geometry(scene, acted[m], wanted, world)
        points[here] = acted[m, contact_links(scene)[touching, 0], :3] + lever[touching]
        loads = impulse[m, touching, :3] / span[m]
        forces[here] = np.einsum('ak,aki->ai', loads, frame[touching])
    if scene.friction.is_viscous:
        add_viscous_forces(scene, acted, u, (sample, number), points, forces)
    return sample, number, points, forces


def touching_geometry(
    scene: Scene, q: Array, wanted: Array, world: Surroundings | None
) -> tuple[Array, Array, Array]:
    """
    Return levers and frames of contacts, and the grip of the solids that they touch.

    Arguments and the first two arrays are those of `obstacles.contact_geometry`, with the world of
    the scene if it has one; the third has the shape (contacts,).
    """
    _, lever, frame = contact_geometry(scene, q, wanted)
    grip = np.ones(len(lever))
    if world is not None:
        gap, world_lever, world_frame, grip = world_geometry(scene, q, world)
        of_world = np.isfinite(gap)
        lever[of_world], frame[of_world] = world_lever[of_world], world_frame[of_world]
    return lever, frame, grip


def add_viscous_forces(
    scene: Scene, q: Array, u: Array, loaded: Loaded, points: Array, forces: Array
) -> None:
    """
    Add the viscous friction of the ground to forces (k, 3) at points (k, 3).

    It is no part of the impulses; see `laws.add_viscous_friction`. Other arguments are those of
    `sampled_forces`, for the coordinates at which impulses acted, with sample and number of the
    contacts.
    """
    sample, number = loaded
    floor, ground = scene.friction, number < first_peg(scene)
    world = make_surroundings(scene) if scene.world else None
    for m in np.flatnonzero(np.bincount(sample[ground])):
        here = np.flatnonzero(ground & (sample == m))
        links = contact_links(scene)[number[here], 0]
        wanted = np.isin(np.arange(contact_count(scene)), number[here])
        _, frame, solid_grip = touching_geometry(scene, q[m], wanted, world)
        tangents = frame[number[here], 1:]
        omega = np.einsum('kij,kj->ki', rotation_matrices(q[m, links, 3:]), u[m, links, 3:])
        velocity = u[m, links, :3] + np.cross(omega, points[here] - q[m, links, :3])
        factor = contact_friction(scene, number[here], q[m])[:, 4] * solid_grip[number[here]]
        viscous = factor[:, None] * floor.viscous_of_contact
        resisted = viscous * np.einsum('kij,kj->ki', tangents, velocity)
        forces[here] -= np.einsum('ki,kij->kj', resisted, tangents)


@entry
def forces_of_ground(
    spheres: Spheres,
    q: Array,
    loads: tuple[Array, Array],
    loaded: Loaded,
    points: Array,
    forces: Array,
) -> None:
    """
    Fill points and forces (k, 3) of the contacts that are spheres on the ground below them.

    The others of the k contacts are left out. Points and frames are those of
    `obstacles.contact_geometry`.

    Parameters
    ----------
    spheres : Spheres
    q : ndarray, shape (m, n, 7)
        Coordinates at which the impulses acted.
    loads : tuple of ndarray
        impulse and span, as in `sampled_forces`.
    loaded : tuple of ndarray
        sample and number, as there.
    points, forces : ndarray
        As there; filled.

    """
    (impulse, span), (sample, number) = loads, loaded
    for k in range(len(sample)):
        m, a = sample[k], number[k]
        if a >= len(spheres.link):
            continue
        i = spheres.link[a]
        arm, (x, y, _) = (
            carried_place(spheres.straight, q[m], i, spheres.place, a),
            axis_z(q[m], i),
        )
        points[k, 0], points[k, 1] = q[m, i, 0] + arm[0], q[m, i, 1] + arm[1]
        points[k, 2] = q[m, i, 2] + arm[2] - spheres.radius[a]
        length = math.sqrt(x * x + y * y)
        c, s = (x / length, y / length) if length > UPRIGHT else (1.0, 0.0)
        P_N, P_x, P_y = impulse[m, a, 0], impulse[m, a, 1], impulse[m, a, 2]
        forces[k, 0] = (c * P_x - s * P_y) / span[m]
        forces[k, 1] = (s * P_x + c * P_y) / span[m]
        forces[k, 2] = P_N / span[m]


def last_span(scene: Scene, history: History) -> float:
    """Return the time for which the impulses of a history acted [s]."""
    span = history.memory.last_span() if history.memory else 0.0
    return span or scene.dt
