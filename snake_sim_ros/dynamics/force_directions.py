# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Generalized force directions, mass matrix and smooth forces in dense NumPy, sections II to IV.

Single letters are those of the paper; NOTATION.md maps them to names. Contacts are numbered as in
eq. (10): the front spheres F of all links, then the rear spheres R. R, shape (n, 3, 3), are the
link frames in I.
"""

from functools import lru_cache
import math

import numpy as np

from snake_sim_ros.scene import obstacles, posture
from snake_sim_ros.scene.parameters import Array, Robot, Scene
from snake_sim_ros.scene.rotations import cross, rotation_matrices, tilde

E_X, E_Y, E_Z = np.eye(3)


def link_rows(i: int) -> slice:
    """Return the rows of link i in u, h and W."""
    return slice(6 * i, 6 * i + 6)


def contact_lever(robot: Robot, R: Array, i: int, sign: int) -> Array:
    """Return r_GC, link center to contact point, eq. (14) [m, frame I]; sign 1 front, -1 rear."""
    offset = sign * robot.per_link('contact_offset')[i] * R[i] @ E_Z
    return np.asarray(offset - robot.per_link('contact_radius')[i] * E_Z)


def contact_frame(R: Array, i: int) -> tuple[Array, Array]:
    """
    Return e_x and e_y of the contact frame Pi of link i: along and across the link, horizontal.

    Deviation: a vertical link has no horizontal direction; e_x^I replaces it, so that a step
    depends on nothing but its arguments.
    """
    a = R[i] @ E_Z
    c = math.hypot(a[0], a[1])
    e_x = np.array([a[0] / c, a[1] / c, 0.0]) if c > 1e-6 else E_X
    return e_x, cross(E_Z, e_x)


def contact_directions(robot: Robot, R: Array) -> tuple[Array, Array, Array]:
    """
    Return the generalized force directions of the contacts, eqs. (17)-(37).

    Returns
    -------
    W_N : ndarray, shape (6n, 2n)
        ``gamma_N = W_N^T u``: normal velocities [m/s].
    W_T : ndarray, shape (6n, 4n)
        ``gamma_T = W_T^T u``: sliding velocities along and across the link [m/s].
    W_V : ndarray, shape (6n, 4n)
        ``gamma_V = W_V^T u``: rolling velocities along e_x, e_y of I [m/s].

    """
    n = robot.link_count
    W_N, W_T, W_V = np.zeros((6 * n, 2 * n)), np.zeros((6 * n, 4 * n)), np.zeros((6 * n, 4 * n))
    for a in range(2 * n):
        i, sign = a % n, 1 if a < n else -1
        r_GC = contact_lever(robot, R, i, sign)
        e_x, e_y = contact_frame(R, i)
        W_N[link_rows(i), a] = point_direction(R[i], r_GC, E_Z)
        W_T[link_rows(i), 2 * a] = point_direction(R[i], r_GC, e_x)
        W_T[link_rows(i), 2 * a + 1] = point_direction(R[i], r_GC, e_y)
        D = np.column_stack([E_X, E_Y])
        r_CS = robot.per_link('contact_radius')[i] * E_Z
        W_V[6 * i + 3 : 6 * i + 6, 2 * a : 2 * a + 2] = (D.T @ tilde(r_CS) @ R[i]).T
    return W_N, W_T, W_V


def scene_contacts(scene: Scene, q: Array) -> tuple[Array, Array, Array, Array]:
    """
    Return gaps and generalized force directions of all contacts of a scene.

    In a scene with more than a flat floor, rolling velocities are along the axes of the contact
    frames.

    Parameters
    ----------
    scene : Scene
    q : ndarray, shape (n, 7)
        Link centers [m, frame I] and unit Euler parameters.

    Returns
    -------
    gap : ndarray, shape (contacts,)
        [m]
    W_N, W_T, W_V : ndarray
        As `contact_directions` returns them, for all contacts.

    """
    robot, R = scene.robot, rotation_matrices(q[:, 3:])
    if obstacles.is_flat(scene):
        return posture.gaps(robot, q), *contact_directions(robot, R)
    gap, lever, frame = obstacles.contact_geometry(scene, q)
    (i, j), a = obstacles.contact_links(scene).T, np.arange(len(gap))
    W, rolling = np.zeros((len(gap), 3, len(R), 6)), np.zeros((len(gap), 2, len(R), 6))
    W[a, :, i] = _point_directions(R[i], lever, frame)
    pairs = np.flatnonzero(j >= 0)
    i_2, j_2 = i[pairs], j[pairs]
    arm = q[i_2, :3] + lever[pairs] - q[j_2, :3]
    W[pairs, :, j_2] = -_point_directions(R[j_2], arm, frame[pairs])
    r_CS = robot.per_link('contact_radius')[i, None] * frame[:, 0]
    rolling[a, :, i, 3:] = -np.cross(r_CS[:, None], frame[:, 1:]) @ R[i]
    W_N, W_T, W_V = (part.reshape(-1, 6 * len(R)).T for part in (W[:, 0], W[:, 1:], rolling))
    return gap, W_N, W_T, W_V


def scene_gaps(scene: Scene, q: Array) -> Array:
    """Return the gaps of all contacts of a scene [m], as `scene_contacts` does."""
    if obstacles.is_flat(scene):
        return posture.gaps(scene.robot, q)
    return obstacles.contact_geometry(scene, q)[0]


def joint_gaps(robot: Robot, q: Array) -> Array:
    """Return the joint violations g_J, eqs. (11)-(13), shape (n-1, 4) [m, m, m, 1]."""
    R, half = rotation_matrices(q[:, 3:]), robot.per_link('link_length') / 2
    g_J = np.zeros((robot.link_count - 1, 4))
    for i in range(robot.link_count - 1):
        r_JF = q[i, :3] + half[i] * R[i] @ E_Z
        r_JR = q[i + 1, :3] - half[i + 1] * R[i + 1] @ E_Z
        g_J[i, :3] = r_JF - r_JR
        g_J[i, 3] = (R[i] @ E_Y) @ (R[i + 1] @ E_X)
    return g_J


def joint_directions(robot: Robot, R: Array) -> Array:
    """Return W_J, eqs. (38)-(43), so that ``dg_J/dt = W_J^T u``, shape (6n, 4(n-1))."""
    n, half = robot.link_count, robot.per_link('link_length') / 2
    W_J = np.zeros((6 * n, 4 * (n - 1)))
    for i in range(n - 1):
        for k, e_chi in enumerate((E_X, E_Y, E_Z)):
            W_J[link_rows(i), 4 * i + k] = point_direction(R[i], half[i] * R[i] @ E_Z, e_chi)
            arm = -half[i + 1] * R[i + 1] @ E_Z
            W_J[link_rows(i + 1), 4 * i + k] = -point_direction(R[i + 1], arm, e_chi)
        normal = cross(R[i] @ E_Y, R[i + 1] @ E_X)
        W_J[6 * i + 3 : 6 * i + 6, 4 * i + 3] = R[i].T @ normal
        W_J[6 * i + 9 : 6 * i + 12, 4 * i + 3] = -R[i + 1].T @ normal
    return W_J


def torque_directions(R: Array) -> Array:
    """
    Return W_tau, so that the rates of (yaw, pitch) are ``W_tau^T u``, shape (6n, 2(n-1)).

    Yaw turns about e_y of link i, pitch about e_x of link i+1; a joint torque acts on link i+1
    and, with the opposite sign, on link i.
    """
    n = len(R)
    W_tau = np.zeros((6 * n, 2 * (n - 1)))
    for i in range(n - 1):
        for k, axis in enumerate((R[i] @ E_Y, R[i + 1] @ E_X)):
            W_tau[6 * i + 3 : 6 * i + 6, 2 * i + k] = -R[i].T @ axis
            W_tau[6 * i + 9 : 6 * i + 12, 2 * i + k] = R[i + 1].T @ axis
    return W_tau


def mass_matrix(robot: Robot) -> Array:
    """Return M, eqs. (47), (48), shape (6n, 6n): constant and diagonal."""
    m, theta_1, theta_3 = (
        robot.per_link(name) for name in ('link_mass', 'inertia_transversal', 'inertia_axial')
    )
    return np.diag(np.column_stack([m, m, m, theta_1, theta_1, theta_3]).ravel())


@lru_cache(maxsize=64)
def mean_delassus(robot: Robot) -> float:
    """
    Return the mean diagonal entry of G_NN of the straight robot with all spheres on the floor.

    G is the Delassus operator [1/kg], W_N^T M^-1 W_N less the part that the joints take off,
    section 7.3. The compliance of the selection rule is relative to this number, which is the same
    in all postures.
    """
    R = np.tile(rotation_matrices(np.full((1, 4), 0.5)), (robot.link_count, 1, 1))
    M_inv, W_J = 1.0 / np.diag(mass_matrix(robot))[:, None], joint_directions(robot, R)
    W_N, _, _ = contact_directions(robot, R)
    G = W_N.T @ (M_inv * W_N)
    if robot.link_count > 1:
        G_JN = W_J.T @ (M_inv * W_N)
        G -= G_JN.T @ np.linalg.solve(W_J.T @ (M_inv * W_J), G_JN)
    return float(np.mean(np.diag(G)))


def smooth_forces(robot: Robot, gravity: Array, u: Array) -> Array:
    """Return h(u): gravity and gyroscopic torque -omega x Theta omega, shape (6n,)."""
    h = np.zeros_like(u)
    for i, m in enumerate(robot.per_link('link_mass')):
        theta_1, theta_3 = (
            robot.per_link(name)[i] for name in ('inertia_transversal', 'inertia_axial')
        )
        omega = u[i, 3:]
        h[i, :3] = m * gravity
        h[i, 3:] = -tilde(omega) @ (np.array([theta_1, theta_1, theta_3]) * omega)
    return h.ravel()


def point_direction(R: Array, lever: Array, e: Array) -> Array:
    """
    Return w, shape (6,), such that w^T u is the velocity along e of a body-fixed point of a link.

    Parameters
    ----------
    R : ndarray, shape (3, 3)
        Link frame in I.
    lever : ndarray, shape (3,)
        Link center to point [m, frame I].
    e : ndarray, shape (3,)
        Direction in I.

    """
    return np.concatenate([e, -(e @ tilde(lever) @ R)])


def _point_directions(R: Array, lever: Array, e: Array) -> Array:
    """Return `point_direction` for links (k, 3, 3), levers (k, 3) and directions (k, m, 3)."""
    return np.concatenate([e, np.cross(lever[:, None], e) @ R], axis=2)
