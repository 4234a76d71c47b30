# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Generalized force directions against finite differences along the exact motion of the links."""

import math

import numpy as np
import pytest
from random_states import EPS, free_links, jointed_links, moved, random_robot, rate_of

from snake_sim_ros import Robot, Scene, State
from snake_sim_ros.contact.contacts import make_contacts
from snake_sim_ros.contact.directions import contact_velocities
from snake_sim_ros.dynamics import force_directions
from snake_sim_ros.dynamics.force_directions import E_X, E_Y, E_Z
from snake_sim_ros.scene import obstacles, posture
from snake_sim_ros.scene.rotations import about, FLAT, product, rotation_matrices

pytestmark = pytest.mark.fast

# Central differences with step h = 1e-5 of r + R b: the third derivative of R b is |omega|^3 |b|.
# Here |omega| <= 2 sqrt(3) = 3.5 rad/s and |b| <= 0.12 m, the longest lever: h^2/6 |omega|^3 |b|
# is 8e-11. Positions up to 1 m are rounded by a few eps: 4 eps/h = 9e-11. Together, for points:
POINT = 2e-10  # m/s
# Products of two unit vectors of different links: (2 |omega|)^3 instead, no lever: 6e-9.
ANGLE = 7e-9  # 1/s
# Relations without differences: sums of a dozen products of numbers up to 10.
ROUNDING = 120 * EPS

SEEDS = range(30)


@pytest.fixture(params=SEEDS)
def free(request):
    """Five different links anywhere: 150 in all seeds together."""
    rng = np.random.default_rng(request.param)
    return random_robot(rng, 5), free_links(rng, 5)


@pytest.fixture(params=SEEDS)
def jointed(request):
    """Five different links with closed joints, angles up to 1.4 rad."""
    rng = np.random.default_rng(request.param)
    robot = random_robot(rng, 5)
    angle = rng.uniform(-1.4, 1.4, (4, 2))
    return robot, angle, jointed_links(rng, robot, angle)


def frames(state):
    return rotation_matrices(state.q[:, 3:])


def contacts(robot):
    """Yield number, link and sign of every contact in the order of eq. (10)."""
    n = robot.link_count
    return [(a, a % n, 1 if a < n else -1) for a in range(2 * n)]


def test_velocities_of_floor_contacts_are_those_of_the_force_directions(free):
    robot, state = free
    W_N, W_T, _ = force_directions.contact_directions(robot, frames(state))
    gamma = force_directions.floor_contact_velocities(robot, state.q, state.u)
    assert gamma[:, 0] == pytest.approx(W_N.T @ state.u.ravel(), abs=ROUNDING)
    assert gamma[:, 1:].ravel() == pytest.approx(W_T.T @ state.u.ravel(), abs=ROUNDING)


def test_gaps_are_the_heights_of_the_lowest_sphere_points(free):
    robot, state = free
    R = frames(state)
    for a, i, sign in contacts(robot):
        # Eq. (9): g = (r_G + sign L_GS e_z^B) . e_z^I - L_SC.
        sphere = state.q[i, :3] + sign * robot.contact_offset[i] * R[i, :, 2]
        lowest = sphere[2] - robot.contact_radius[i]
        assert abs(posture.gaps(robot, state.q)[a] - lowest) < 4 * EPS


def test_normal_directions(free):
    robot, state = free
    W_N, _, _ = force_directions.contact_directions(robot, frames(state))
    # gamma_N = W_N^T u = dg_N/dt, eqs. (17)-(20).
    expected = rate_of(lambda q: posture.gaps(robot, q), state)
    assert np.abs(W_N.T @ state.u.ravel() - expected).max() < POINT


def test_sliding_directions(free):
    robot, state = free
    R = frames(state)
    _, W_T, _ = force_directions.contact_directions(robot, R)
    gamma_T = (W_T.T @ state.u.ravel()).reshape(-1, 2)
    for a, i, sign in contacts(robot):
        # The body-fixed point that is at the contact now: gamma_T are its horizontal velocities
        # along and across the projection of the link axis.
        lever = sign * robot.contact_offset[i] * R[i, :, 2] - robot.contact_radius[i] * E_Z
        point_B = R[i].T @ lever

        def point(q, i=i, point_B=point_B):
            return q[i, :3] + rotation_matrices(q[i, 3:]) @ point_B

        along = np.array([R[i, 0, 2], R[i, 1, 2], 0.0]) / math.hypot(R[i, 0, 2], R[i, 1, 2])
        across = np.array([-along[1], along[0], 0.0])
        velocity = rate_of(point, state)
        assert np.abs(gamma_T[a] - [along @ velocity, across @ velocity]).max() < POINT


def test_compiled_velocities_on_the_floor_are_those_of_the_directions(free):
    robot, state = free
    R, n = frames(state), robot.link_count
    omega = np.einsum('nij,nj->ni', R, state.u[:, 3:])
    twist = np.column_stack([omega, state.u[:, :3] - np.cross(omega, state.q[:, :3])])
    table = make_contacts(obstacles.contact_links(Scene(robot=robot)))
    geometry = table['geometry']
    for a, i, sign in contacts(robot):
        lever = sign * robot.contact_offset[i] * R[i, :, 2] - robot.contact_radius[i] * E_Z
        geometry['point'][a] = state.q[i, :3] + lever
        geometry['heading'][a] = force_directions.contact_frame(R, i)[0][:2]
        geometry['radius'][a] = robot.contact_radius[i]
    contact_velocities(np.arange(2 * n), table, None, twist)
    W_N, W_T, W_V = force_directions.contact_directions(robot, R)
    expected = np.column_stack(
        [(W.T @ state.u.ravel()).reshape(2 * n, -1) for W in (W_N, W_T, W_V)]
    )
    assert np.abs(table['solution']['gamma'] - expected).max() < ROUNDING


def test_rolling_directions(free):
    robot, state = free
    R = frames(state)
    _, _, W_V = force_directions.contact_directions(robot, R)
    gamma_V = (W_V.T @ state.u.ravel()).reshape(-1, 2)
    for a, i, _ in contacts(robot):
        # Where the contact is on its sphere, in B; it wanders as the link turns. The rolling
        # velocity is minus the velocity of this wandering, eqs. (36), (37).
        def wandering(q, i=i):
            return rotation_matrices(q[i, 3:]).T @ (-robot.contact_radius[i] * E_Z)

        expected = -(R[i] @ rate_of(wandering, state))[:2]
        assert np.abs(gamma_V[a] - expected).max() < POINT
        # The same in closed form: L_SC (-omega_y, omega_x), omega in I.
        omega = R[i] @ state.u[i, 3:]
        closed = robot.contact_radius[i] * np.array([-omega[1], omega[0]])
        assert np.abs(gamma_V[a] - closed).max() < ROUNDING


def test_joint_gaps_and_directions(free):
    robot, state = free
    g_J = force_directions.joint_gaps(robot, state.q)
    R, half = frames(state), robot.per_link('link_length') / 2
    for i in range(4):
        # Eqs. (11)-(13): the difference of the two joint points, and e_y^i . e_x^i+1.
        front = state.q[i, :3] + half[i] * R[i, :, 2]
        rear = state.q[i + 1, :3] - half[i + 1] * R[i + 1, :, 2]
        expected = [*(front - rear), R[i, :, 1] @ R[i + 1, :, 0]]
        assert np.abs(g_J[i] - expected).max() < ROUNDING
    W_J = force_directions.joint_directions(robot, R)
    rate = (W_J.T @ state.u.ravel()).reshape(4, 4)
    difference = rate - rate_of(lambda q: force_directions.joint_gaps(robot, q), state)
    assert np.abs(difference[:, :3]).max() < 2 * POINT  # of two points
    assert np.abs(difference[:, 3]).max() < ANGLE


def test_joint_angles_are_recovered(jointed):
    _, angle, state = jointed
    # Each angle comes from its sine and cosine, which are products of entries of matrices.
    assert np.abs(posture.joint_angles(state.q) - angle).max() < ROUNDING


def test_closed_joints_have_no_gap(jointed):
    robot, _, state = jointed
    # Points up to 0.7 m from link 1, each from a dozen roundings.
    assert np.abs(force_directions.joint_gaps(robot, state.q)).max() < ROUNDING


def test_torque_directions_give_the_joint_rates(jointed):
    robot, _, state = jointed
    R, u = frames(state), state.u.copy()
    rates = (force_directions.torque_directions(robot, R).T @ u.ravel()).reshape(-1, 2)
    # alphadot_h = e_y^i . omega_rel, alphadot_v = e_x^i+1 . omega_rel, also when the joint twists.
    assert np.abs(rates - posture.joint_rates(state.q, u)).max() < ROUNDING

    # Angles are defined where the joint does not twist. Turning link i+1 about a x b, |a x b| = 1,
    # takes the twist out, link by link from the first.
    for i in range(robot.link_count - 1):
        normal = np.cross(R[i, :, 1], R[i + 1, :, 0])
        omega_rel = R[i + 1] @ u[i + 1, 3:] - R[i] @ u[i, 3:]
        u[i + 1, 3:] -= R[i + 1].T @ normal * (normal @ omega_rel)
    u /= np.linalg.norm(u[:, 3:], axis=1).max()
    rates = (force_directions.torque_directions(robot, R).T @ u.ravel()).reshape(-1, 2)
    # The k-th derivative of an entry of R is at most 2^k now that |omega| <= 1 rad/s. The third
    # one of the angle of a unit vector x is at most |x'''| + 3 |x'| |x''| + 2 |x'|^3 = 6 2^3, for
    # two entries sqrt(2) times that: h^2/6 68 = 1.1e-9. Rounding of angles: 8 eps/h = 2e-10.
    expected = rate_of(posture.joint_angles, State(state.q, u))
    assert np.abs(rates - expected).max() < 1.3e-9


def test_joint_motion_does_not_work_against_the_joint(jointed):
    robot, _, state = jointed
    rng = np.random.default_rng(9)
    R = frames(state)
    u, rate = np.zeros((5, 6)), rng.uniform(-2, 2, (4, 2))
    omega, v = rng.uniform(-2, 2, 3), rng.uniform(-1, 1, 3)
    half = robot.per_link('link_length') / 2
    for i in range(5):
        if i > 0:
            # A joint turns about e_y^i-1 and e_x^i, and its point has one velocity.
            v = v + np.cross(omega, half[i - 1] * R[i - 1, :, 2])
            omega = omega + rate[i - 1, 0] * R[i - 1, :, 1] + rate[i - 1, 1] * R[i, :, 0]
            v = v + np.cross(omega, half[i] * R[i, :, 2])
        u[i] = [*v, *(R[i].T @ omega)]
    # W_J^T u = 0 and W_tau^T u = rates. Angular velocities up to 20 rad/s: ten times ROUNDING.
    assert np.abs(force_directions.joint_directions(robot, R).T @ u.ravel()).max() < 10 * ROUNDING
    rates = (force_directions.torque_directions(robot, R).T @ u.ravel()).reshape(-1, 2)
    assert np.abs(rates - rate).max() < 10 * ROUNDING


def test_joint_torques_on_the_links(jointed):
    robot, _, state = jointed
    rng = np.random.default_rng(10)
    R, T = frames(state), rng.uniform(-1, 1, (4, 2))
    tau_C = (force_directions.torque_directions(robot, R) @ T.ravel()).reshape(5, 6)
    # M = T_h e_y^i + T_v e_x^i+1 acts on link i+1 and -M on link i, in their frames B.
    expected = np.zeros((5, 6))
    for i in range(robot.link_count - 1):
        M = T[i, 0] * R[i, :, 1] + T[i, 1] * R[i + 1, :, 0]
        expected[i, 3:] -= R[i].T @ M
        expected[i + 1, 3:] += R[i + 1].T @ M
    assert np.abs(tau_C - expected).max() < ROUNDING
    # tau_C^T u = T_h alphadot_h + T_v alphadot_v
    power = np.sum(T * posture.joint_rates(state.q, state.u))
    assert abs(tau_C.ravel() @ state.u.ravel() - power) < ROUNDING
    # What acts between links has neither resultant force nor resultant torque.
    assert (tau_C[:, :3] == 0.0).all()
    assert np.abs(np.einsum('nij,nj->i', R, tau_C[:, 3:])).max() < ROUNDING


def test_mass_matrix_is_that_of_the_kinetic_energy(free):
    robot, state = free
    M = force_directions.mass_matrix(robot)
    # T = sum of m v^2/2 + Theta_1 (omega_x^2 + omega_y^2)/2 + Theta_3 omega_z^2/2
    kinetic = sum(
        robot.link_mass[i] * (u[:3] @ u[:3]) / 2
        + robot.inertia_transversal[i] * (u[3] ** 2 + u[4] ** 2) / 2
        + robot.inertia_axial[i] * u[5] ** 2 / 2
        for i, u in enumerate(state.u)
    )
    assert abs(state.u.ravel() @ M @ state.u.ravel() / 2 - kinetic) < ROUNDING
    assert (M == np.diag(np.diag(M))).all()


def test_smooth_forces(free):
    robot, state = free
    gravity = np.array([1.0, -2.0, -9.0])
    h = force_directions.smooth_forces(robot, gravity, state.u).reshape(5, 6)
    assert np.abs(h[:, :3] - np.outer(robot.link_mass, gravity)).max() < ROUNDING
    for i, (_, _, _, x, y, z) in enumerate(state.u):
        # -omega x Theta omega of a body of revolution, written out.
        slender = robot.inertia_axial[i] - robot.inertia_transversal[i]
        assert np.abs(h[i, 3:] - [-slender * y * z, slender * z * x, 0.0]).max() < ROUNDING
        # It does no work.
        assert abs(h[i, 3:] @ [x, y, z]) < ROUNDING


def test_smooth_forces_keep_the_angular_momentum(free):
    robot, state = free
    inertia = np.column_stack([robot.inertia_transversal] * 2 + [robot.inertia_axial])
    torque = force_directions.smooth_forces(robot, np.zeros(3), state.u).reshape(5, 6)[:, 3:]

    # Alone, Theta omegadot = h, and L = R Theta omega stays: with omega in R(t) constant, dL/dt is
    # R omega x Theta omega = -R h. Theta |omega| <= 1.2e-3 3.5 kg m^2/s stands where POINT has the
    # lever: h^2/6 |omega|^4 Theta = 3e-12 N m, and rounding below that.
    def spin(q):
        return np.einsum('nij,nj->ni', rotation_matrices(q[:, 3:]), inertia * state.u[:, 3:])

    change = rate_of(spin, state) + np.einsum('nij,nj->ni', frames(state), torque)
    assert np.abs(change).max() < 4e-12


def tilted(angle, heading):
    """Return R of a link whose axis is `angle` away from pointing up, toward `heading`."""
    up = product(about(1, -math.pi / 2), FLAT)  # e_z^B = e_z^I
    assert np.abs(rotation_matrices(up)[:, 2] - E_Z).max() < ROUNDING
    return rotation_matrices(product(about(2, heading), product(about(1, angle), up)))[None]


@pytest.mark.parametrize('angle', [2e-6, 1e-3, 1.0, math.pi / 2, math.pi - 2e-6])
@pytest.mark.parametrize('heading', [0.0, 1.0, -2.5])
def test_contact_frame_follows_the_link(angle, heading):
    e_x, e_y = force_directions.contact_frame(tilted(angle, heading), 0)
    # e_x is the horizontal projection of the axis, sin(angle) long and rounded by 4 eps before it
    # is normalized, and e_y completes a right-handed frame with e_z up.
    bound = 8 * EPS / math.sin(angle)
    assert np.abs(e_x - [math.cos(heading), math.sin(heading), 0.0]).max() < bound
    assert np.abs(e_y - [-math.sin(heading), math.cos(heading), 0.0]).max() < bound
    assert abs(np.linalg.norm(e_x) - 1) < 4 * EPS


@pytest.mark.parametrize('angle', [0.0, 5e-7, math.pi])
@pytest.mark.parametrize('heading', [0.0, 1.0])
def test_contact_frame_of_a_vertical_link_is_that_of_the_floor(angle, heading):
    e_x, e_y = force_directions.contact_frame(tilted(angle, heading), 0)
    assert (e_x == E_X).all()
    assert (e_y == E_Y).all()
    directions = force_directions.contact_directions(Robot(link_count=1), tilted(angle, heading))
    assert all(np.isfinite(W).all() for W in directions)


def test_moved_links_keep_unit_parameters(free):
    # The motion that everything above is compared with: |p| = 1, and back again is no motion.
    _, state = free
    q = moved(state, 0.3)
    assert np.abs(np.linalg.norm(q[:, 3:], axis=1) - 1).max() < ROUNDING
    assert np.abs(moved(State(q, state.u), -0.3) - state.q).max() < ROUNDING
