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


def contact_lever(robot: Robot, R: Array, a: int) -> Array:
    """Return r_GC of contact a with the floor, link center to contact point, eq. (14) [m, I]."""
    spheres = robot.chain.spheres
    return np.asarray(R[spheres.link[a]] @ spheres.place[a] - spheres.radius[a] * E_Z)


def contact_frame(R: Array, i: int) -> tuple[Array, Array]:
    """
    Return e_x and e_y of the contact frame Pi of link i: along and across the link, horizontal.

    Deviation: a vertical link has no horizontal direction; e_x^I replaces it, so that a step
    depends on nothing but its arguments.
    """
    a = R[i] @ E_Z
    c = math.hypot(a[0], a[1])
    e_x = np.array([a[0] / c, a[1] / c, 0.0]) if c > obstacles.UPRIGHT else E_X
    return e_x, cross(E_Z, e_x)


def contact_directions(robot: Robot, R: Array) -> tuple[Array, Array, Array]:
    """
    Return the generalized force directions of the contacts, eqs. (17)-(37).

    Returns
    -------
    W_N : ndarray, shape (6n, m)
        ``gamma_N = W_N^T u``: normal velocities [m/s], of m contacts, 2n of Aiko.
    W_T : ndarray, shape (6n, 2m)
        ``gamma_T = W_T^T u``: sliding velocities along and across the link [m/s].
    W_V : ndarray, shape (6n, 2m)
        ``gamma_V = W_V^T u``: rolling velocities along e_x, e_y of I [m/s].

    """
    rows, spheres = 6 * robot.link_count, robot.chain.spheres
    m = len(spheres.link)
    W_N, W_T, W_V = np.zeros((rows, m)), np.zeros((rows, 2 * m)), np.zeros((rows, 2 * m))
    for a, i in enumerate(spheres.link):
        r_GC = contact_lever(robot, R, a)
        e_x, e_y = contact_frame(R, i)
        W_N[link_rows(i), a] = point_direction(R[i], r_GC, E_Z)
        W_T[link_rows(i), 2 * a] = point_direction(R[i], r_GC, e_x)
        W_T[link_rows(i), 2 * a + 1] = point_direction(R[i], r_GC, e_y)
        D = np.column_stack([E_X, E_Y])
        r_CS = spheres.radius[a] * E_Z
        W_V[6 * i + 3 : 6 * i + 6, 2 * a : 2 * a + 2] = (D.T @ tilde(r_CS) @ R[i]).T
    return W_N, W_T, W_V


def floor_contact_velocities(robot: Robot, q: Array, u: Array) -> Array:
    """
    Return gamma_N, gamma_Tx, gamma_Ty of all floor contacts, eqs. (17)-(31).

    Coordinates have the shape (..., n, 7), velocities (..., n, 6), and the result (..., m, 3)
    [m/s] for m contacts.
    """
    spheres = robot.chain.spheres
    R, u = rotation_matrices(q[..., 3:])[..., spheres.link, :, :], u[..., spheres.link, :]
    omega = (R @ u[..., 3:, None])[..., 0]
    along, lever = R[..., 2], np.einsum('...aij,aj->...ai', R, spheres.place)
    below = spheres.radius[:, None] * np.array([0.0, 0.0, 1.0])
    v = u[..., :3] + np.cross(omega, lever - below)
    heading = along[..., :2] / np.linalg.norm(along[..., :2], axis=-1, keepdims=True)
    left = np.stack([-heading[..., 1], heading[..., 0]], axis=-1)
    return np.stack(
        [v[..., 2], (v[..., :2] * heading).sum(-1), (v[..., :2] * left).sum(-1)], axis=-1
    )


def scene_contacts(
    scene: Scene, q: Array, geometry: tuple[Array, Array, Array] | None = None
) -> tuple[Array, Array, Array, Array]:
    """
    Return gaps and generalized force directions of all contacts of a scene.

    In a scene with more than a flat floor, rolling velocities are along the axes of the contact
    frames.

    Parameters
    ----------
    scene : Scene
    q : ndarray, shape (n, 7)
        Link centers [m, frame I] and unit Euler parameters.
    geometry : tuple of ndarray, optional
        Gaps, levers and frames, as `obstacles.contact_geometry` returns them, of a scene with more
        than a flat floor. It has none of contacts with a world: `placing.world_geometry` has.

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
    gap, lever, frame = geometry or obstacles.contact_geometry(scene, q)
    (i, j), a = obstacles.contact_links(scene).T, np.arange(len(gap))
    W, rolling = np.zeros((len(gap), 3, len(R), 6)), np.zeros((len(gap), 2, len(R), 6))
    W[a, :, i] = _point_directions(R[i], lever, frame)
    pairs = np.flatnonzero(j >= 0)
    i_2, j_2 = i[pairs], j[pairs]
    arm = q[i_2, :3] + lever[pairs] - q[j_2, :3]
    W[pairs, :, j_2] = -_point_directions(R[j_2], arm, frame[pairs])
    r_CS = obstacles.contact_radii(scene)[:, None] * frame[:, 0]
    rolling[a, :, i, 3:] = -np.cross(r_CS[:, None], frame[:, 1:]) @ R[i]
    W_N, W_T, W_V = (part.reshape(-1, 6 * len(R)).T for part in (W[:, 0], W[:, 1:], rolling))
    return gap, W_N, W_T, W_V


def scene_gaps(scene: Scene, q: Array) -> Array:
    """Return the gaps of all contacts of a scene [m], as `scene_contacts` does."""
    if obstacles.is_flat(scene):
        return posture.gaps(scene.robot, q)
    return obstacles.contact_geometry(scene, q)[0]


def joint_normals(robot: Robot, R: Array, j: int) -> list[tuple[Array, Array]]:
    """
    Return the axes in I that the constraints of joint j hold at right angles, eq. (13).

    The first of a pair belongs to link j, the second to link j+1. A joint with one axis has two
    pairs, by which nothing turns about the other axis.
    """
    places = robot.chain.places
    inner, outer = R[j] @ places.inner[j], R[j + 1] @ places.outer[j]
    pairs = [(inner[:, 1], outer[:, 0])]
    if places.present[j, 0] == 0.0:
        pairs.append((inner[:, 2], outer[:, 0]))
    elif places.present[j, 1] == 0.0:
        pairs.append((inner[:, 1], outer[:, 2]))
    return pairs


def joint_gaps(robot: Robot, q: Array) -> Array:
    """
    Return the joint violations g_J, eqs. (11)-(13), shape (n-1, 4) [m, m, m, 1].

    If any joint has one axis, there is a fifth column, 0 for joints with two.
    """
    R, places = rotation_matrices(q[:, 3:]), robot.chain.places
    g_J = np.zeros((robot.link_count - 1, 4 if places.complete else 5))
    for j in range(robot.link_count - 1):
        r_JF = q[j, :3] + R[j] @ places.distal[j]
        r_JR = q[j + 1, :3] + R[j + 1] @ places.proximal[j + 1]
        g_J[j, :3] = r_JF - r_JR
        for k, (a, b) in enumerate(joint_normals(robot, R, j)):
            g_J[j, 3 + k] = a @ b
    return g_J


def joint_directions(robot: Robot, R: Array) -> Array:
    """
    Return W_J, eqs. (38)-(43), so that ``dg_J/dt = W_J^T u``, shape (6n, 4(n-1)).

    A joint with one axis has five columns instead of four.
    """
    n, places, columns = robot.link_count, robot.chain.places, []
    for j in range(n - 1):
        for e_chi in (E_X, E_Y, E_Z):
            w = np.zeros(6 * n)
            w[link_rows(j)] = point_direction(R[j], R[j] @ places.distal[j], e_chi)
            arm = R[j + 1] @ places.proximal[j + 1]
            w[link_rows(j + 1)] = -point_direction(R[j + 1], arm, e_chi)
            columns.append(w)
        for a, b in joint_normals(robot, R, j):
            w, normal = np.zeros(6 * n), cross(a, b)
            w[6 * j + 3 : 6 * j + 6] = R[j].T @ normal
            w[6 * j + 9 : 6 * j + 12] = -R[j + 1].T @ normal
            columns.append(w)
    return np.array(columns).reshape(-1, 6 * n).T


def torque_directions(robot: Robot, R: Array) -> Array:
    """
    Return W_tau, so that the rates of the axes are ``W_tau^T u``, shape (6n, 2(n-1)).

    Yaw turns about e_y of the inner frame of a joint, pitch about e_x of its outer frame; a joint
    torque acts on link i+1 and, with the opposite sign, on link i. Of an axis that a joint does
    not have, the column is 0.
    """
    n, places = len(R), robot.chain.places
    W_tau = np.zeros((6 * n, 2 * (n - 1)))
    for i in range(n - 1):
        axes = R[i] @ places.inner[i][:, 1], R[i + 1] @ places.outer[i][:, 0]
        for k, axis in enumerate(axes):
            W_tau[6 * i + 3 : 6 * i + 6, 2 * i + k] = -places.present[i, k] * R[i].T @ axis
            W_tau[6 * i + 9 : 6 * i + 12, 2 * i + k] = places.present[i, k] * R[i + 1].T @ axis
    return W_tau


def mass_matrix(robot: Robot) -> Array:
    """Return M, eqs. (47), (48), shape (6n, 6n): constant, and diagonal for Aiko."""
    chain, n = robot.chain, robot.link_count
    M = np.zeros((6 * n, 6 * n))
    for i in range(n):
        M[6 * i : 6 * i + 3, 6 * i : 6 * i + 3] = chain.mass[i] * np.eye(3)
        M[6 * i + 3 : 6 * i + 6, 6 * i + 3 : 6 * i + 6] = chain.inertia[i]
    return M


def over_mass(robot: Robot, W: Array) -> Array:
    """Return ``M^-1 W``, shape (6n, k)."""
    M = mass_matrix(robot)
    diagonal = np.diag(M)
    if np.count_nonzero(M) == len(M):
        return (1.0 / diagonal)[:, None] * W
    return np.linalg.solve(M, W)


@lru_cache(maxsize=64)
def mean_delassus(robot: Robot) -> float:
    """
    Return the mean diagonal entry of G_NN of the straight robot with all spheres on the floor.

    G is the Delassus operator [1/kg], W_N^T M^-1 W_N less the part that the joints take off,
    section 7.3. The compliance of the selection rule is relative to this number, which is the same
    in all postures.
    """
    angle = np.zeros((robot.link_count - 1, 2))
    R = rotation_matrices(posture.chain_coordinates(robot, angle)[:, 3:])
    W_J, (W_N, _, _) = joint_directions(robot, R), contact_directions(robot, R)
    accelerated = over_mass(robot, W_N)
    G = W_N.T @ accelerated
    if robot.link_count > 1:
        G_JN = W_J.T @ accelerated
        G -= G_JN.T @ np.linalg.solve(W_J.T @ over_mass(robot, W_J), G_JN)
    return float(np.mean(np.diag(G)))


def smooth_forces(robot: Robot, gravity: Array, u: Array) -> Array:
    """Return h(u): gravity and gyroscopic torque -omega x Theta omega, shape (6n,)."""
    h, chain = np.zeros_like(u), robot.chain
    for i, m in enumerate(chain.mass):
        omega = u[i, 3:]
        h[i, :3] = m * gravity
        h[i, 3:] = -tilde(omega) @ (chain.inertia[i] @ omega)
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
