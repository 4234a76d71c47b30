"""The compiled step against the dense one, and the sweeps of the chain against a dense solve."""

from dataclasses import astuple
from dataclasses import replace

import numpy as np
import pytest
from random_states import EPS
from random_states import jointed_links
from random_states import random_parameters
from random_states import random_robot
from random_states import random_velocities

from snake_sim_ros import gait
from snake_sim_ros import posture
from snake_sim_ros import reference
from snake_sim_ros.articulated_body import articulated_inertia
from snake_sim_ros.articulated_body import articulated_velocity
from snake_sim_ros.articulated_body import invert
from snake_sim_ros.kinematics import chain_geometry
from snake_sim_ros.parameters import DRIFT_CORRECTIONS
from snake_sim_ros.parameters import Friction
from snake_sim_ros.parameters import load_scene
from snake_sim_ros.parameters import PD_SCHEMES
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import Solver
from snake_sim_ros.rotations import about
from snake_sim_ros.rotations import FLAT
from snake_sim_ros.rotations import H_bar
from snake_sim_ros.rotations import product
from snake_sim_ros.rotations import rotation_matrices
from snake_sim_ros.stepping import initial_state
from snake_sim_ros.stepping import METHODS
from snake_sim_ros.stepping import no_impulse
from snake_sim_ros.stepping import State

# Both methods do the same arithmetic in another order. The dense one solves a system with a
# condition of up to 1.4e5 for the joint impulses: eps times that is 3e-11 of velocities around 1.
# Sweeps contract, so that their rounding does not add up.
AGREEMENT = 1e-10
FRICTIONS = {
    'isotropic': Friction(longitudinal=0.2, transversal=0.2),
    'orthotropic': Friction(longitudinal=0.1, transversal=0.5),
    'rolling': Friction(longitudinal=0.3, transversal=0.6, rolling=0.05),
    'none': Friction(longitudinal=0.0, transversal=0.0),
    'rolling only': Friction(longitudinal=0.0, transversal=0.0, rolling=0.1),
    'across only': Friction(longitudinal=0.0, transversal=0.4, rolling=0.02),
}


def random_scene(rng, link_count, friction, pd_scheme, drift_correction):
    return Scene(
        robot=replace(
            random_robot(rng, link_count),
            yaw_stiffness=rng.uniform(10, 100),
            pitch_stiffness=rng.uniform(100, 800),
            yaw_damping=rng.uniform(0.1, 0.3),
            pitch_damping=rng.uniform(0.1, 0.3),
        ),
        friction=friction,
        solver=Solver(
            iteration_limit=40,
            r_normal=rng.uniform(0.05, 0.2),
            r_sliding=rng.uniform(0.005, 0.015),
            r_rolling=rng.uniform(0.02, 0.05),
        ),
        gravity=tuple(rng.uniform([-3, -3, -11], [3, 3, -8])),
        dt=rng.uniform(1e-4, 5e-4),
        pd_scheme=pd_scheme,
        drift_correction=drift_correction,
    )


def lying(rng, robot):
    """Return coordinates of a crooked robot on the floor, with about half of its spheres in it."""
    n = robot.link_count
    q = jointed_links(rng, robot, rng.uniform(-0.6, 0.6, (n - 1, 2)) * [1.0, 0.1]).q
    # Link 1 with any heading, a little pitched about e_y^I and rolled about its axis.
    first = product(about(2, rng.uniform(-3, 3)), product(about(1, rng.uniform(-0.1, 0.1)), FLAT))
    first = product(first, about(2, rng.uniform(-0.2, 0.2)))
    turn = product(first, q[0, 3:] * [1, -1, -1, -1])
    q = np.hstack([q[:, :3] @ rotation_matrices(turn).T, product(turn, q[:, 3:])])
    q[:, 2] -= np.median(posture.gaps(robot, q)) + rng.uniform(0.0, 1e-3)
    return q


def half_a_step_before(q_M, u, dt):
    """Return the state from which eq. (72) leads to q_M, exactly: it is the step back."""
    q_A = q_M.copy()
    q_A[:, :3] -= dt / 2 * u[:, :3]
    for p_A, p_M, omega in zip(q_A[:, 3:], q_M[:, 3:], u[:, 3:], strict=True):
        p_A[:] = p_M - dt / 4 * H_bar(p_M).T @ omega
        p_A /= np.linalg.norm(p_A)
    return State(q_A, u)


def random_reference(rng, state):
    """Return joint references of one step, near the angles of a state."""
    angle = posture.joint_angles(state.q)
    shape = (1, *angle.shape)
    return angle + rng.uniform(-0.05, 0.05, shape), rng.uniform(-1, 1, shape)


def random_impulse(rng, scene):
    """Return impulses as an earlier step could have left them, up to 1e-3 N s."""
    impulse = rng.uniform(-1e-3, 1e-3, (2 * scene.robot.link_count, 5))
    impulse[:, 0] = np.abs(impulse[:, 0])
    return impulse * [1, 1, 1, *[scene.friction.rolling > 0] * 2]


def both(scene, state, impulse, angle, rate):
    """Return what the dense and the compiled method make of the same step."""
    # No contact may be so nearly closed that rounding decides, eqs. (9), (72).
    gap = posture.gaps(scene.robot, reference.middle_coordinates(state, scene.dt))
    assert np.abs(gap).min() > 1e-9
    return (
        METHODS[name](scene).advance(state, impulse, angle, rate)
        for name in ('reference', 'paper')
    )


def assert_agreement(scene, state, impulse, angle, rate):
    """Assert that both methods take the same step, and return the report."""
    dense, compiled = both(scene, state, impulse, angle, rate)
    assert np.abs(dense[0].q - compiled[0].q).max() < AGREEMENT
    assert np.abs(dense[0].u - compiled[0].u).max() < AGREEMENT
    assert np.abs(dense[1] - compiled[1]).max() < AGREEMENT
    expected, report = dense[2], compiled[2]
    for name in ('steps', 'iterations', 'iterations_max', 'unconverged', 'contacts', 'failure'):
        assert getattr(report, name) == getattr(expected, name), name
    assert report.status == expected.status
    # The residual is a change of impulses over a prox parameter: a velocity, like gamma itself.
    for name in ('residual_max', 'penetration_max', 'joint_gap_max', 'joint_twist_max'):
        assert abs(getattr(report, name) - getattr(expected, name)) < AGREEMENT, name
    return report


def random_step(seed, link_count, friction, pd_scheme, drift_correction):
    """
    Return a scene, a state on the floor, impulses and joint references.

    Velocities are random, whatever the joints say. That the joints are closed in the middle of the
    step leaves no doubt about the axes of their torques.
    """
    rng = np.random.default_rng([seed, link_count])
    scene = random_scene(rng, link_count, friction, pd_scheme, drift_correction)
    u = random_velocities(rng, link_count)
    state = half_a_step_before(lying(rng, scene.robot), u, scene.dt)
    return scene, state, random_impulse(rng, scene), *random_reference(rng, state)


LINK_COUNTS = pytest.mark.parametrize('link_count', [1, 2, 5, 6, 11])
ALL_SCHEMES = pytest.mark.parametrize('pd_scheme', PD_SCHEMES)
ALL_CORRECTIONS = pytest.mark.parametrize('drift_correction', DRIFT_CORRECTIONS)


@LINK_COUNTS
@ALL_SCHEMES
@ALL_CORRECTIONS
def test_steps_agree_in_contact(link_count, pd_scheme, drift_correction):
    closed = 0
    for seed, friction in enumerate(FRICTIONS.values()):
        step = random_step(seed, link_count, friction, pd_scheme, drift_correction)
        report = assert_agreement(*step)
        assert report.iterations > 1
        closed += report.contacts
    # Some of the contacts were open.
    assert len(FRICTIONS) <= closed < len(FRICTIONS) * 2 * link_count


@LINK_COUNTS
@ALL_SCHEMES
@ALL_CORRECTIONS
def test_steps_agree_in_flight(link_count, pd_scheme, drift_correction):
    friction = FRICTIONS['rolling']
    scene, state, *others = random_step(7, link_count, friction, pd_scheme, drift_correction)
    state.q[:, 2] += 1.0
    report = assert_agreement(scene, state, *others)
    # One iteration finds that there is nothing to do.
    assert (report.contacts, report.iterations, report.unconverged) == (0, 1, 0)


@pytest.mark.parametrize('link_count', [1, 2, 5])
def test_steps_agree_after_many_iterations(link_count):
    # 39, 305 and 5000, most of them with the contact problem condensed.
    friction = FRICTIONS['orthotropic']
    scene, state, *others = random_step(12, link_count, friction, 'midpoint', 'paper')
    scene = replace(scene, solver=Solver())
    report = assert_agreement(scene, state, *others)
    assert report.iterations > 30 > 3 * report.contacts


@LINK_COUNTS
@ALL_SCHEMES
def test_torques_agree(link_count, pd_scheme):
    step = random_step(8, link_count, FRICTIONS['orthotropic'], pd_scheme, 'paper')
    expected, torque = (report.joint_torque for _, _, report in both(*step))
    assert torque.shape == expected.shape == (link_count - 1, 2)
    # Angles are equal up to rounding, rates agree like velocities, and act with K_d and, in the
    # implicit scheme, with K_d + K_p dt/2: below 1 N m s.
    assert np.abs(torque - expected).max(initial=0.0) < AGREEMENT


@pytest.mark.parametrize('link_count', [2, 11])
@ALL_SCHEMES
def test_steps_agree_when_the_joints_open_in_the_step(link_count, pd_scheme):
    # Closed at the start, but with velocities that twist and pull the joints: in the middle of the
    # step e_y^i . e_x^i+1 is up to dt/2 4 rad/s, and the axes of a joint are not quite orthogonal.
    friction = FRICTIONS['orthotropic']
    scene, state, *others = random_step(9, link_count, friction, pd_scheme, 'paper')
    state = State(reference.middle_coordinates(state, scene.dt), state.u)
    assert np.abs(reference.joint_gaps(scene.robot, state.q)).max() < 120 * EPS
    assert_agreement(scene, state, *others)


@pytest.mark.parametrize('name', ['lateral_undulation', 'sidewinding', 'sinus_lifting'])
@pytest.mark.parametrize('drift_correction', ['paper', 'none'])
def test_steps_agree_along_a_scene(name, drift_correction):
    # A step of its own at the end of each second; the iteration limit keeps the dense one short.
    scene = replace(load_scene(name), drift_correction=drift_correction)
    limited = replace(scene, solver=Solver(iteration_limit=40))
    stepper, state, impulse = METHODS['paper'](scene), initial_state(scene), no_impulse(scene)
    for second in range(3):
        times = second + (np.arange(4001) + 0.5) * scene.dt
        angle, rate = gait.reference(scene.gait, times, 10)
        state, impulse, _ = stepper.advance(state, impulse, angle[:4000], rate[:4000])
        assert_agreement(limited, state, impulse, angle[4000:], rate[4000:])


def test_impulses_of_rolling_are_dropped_without_rolling_friction():
    # mu_V = 0: the set of rolling impulses is a point, whatever an earlier step left.
    scene, state, impulse, angle, rate = random_step(
        10, 2, FRICTIONS['orthotropic'], 'midpoint', 'paper'
    )
    impulse[:, 3:] = 1e-4
    assert_agreement(scene, state, impulse, angle, rate)


@pytest.mark.parametrize('tilt', [0.0, 5e-7, 5e-6, 0.1])
@pytest.mark.parametrize('down', [1, -1])
def test_steps_of_an_upright_link_agree(tilt, down):
    # Around the angle where the contact frame of a vertical link takes the place of its heading.
    rng = np.random.default_rng(11)
    scene = random_scene(rng, 1, FRICTIONS['orthotropic'], 'midpoint', 'paper')
    axis = product(about(2, 0.7), about(1, tilt - down * np.pi / 2))
    q_M = np.hstack([np.zeros(3), product(axis, FLAT)])[None]
    q_M[:, 2] = -posture.gaps(scene.robot, q_M).min() - 1e-4
    u = random_velocities(rng, 1) * [1, 1, 0, 0.001, 0.001, 1] - [0, 0, 0.1, 0, 0, 0]
    state = half_a_step_before(q_M, u, scene.dt)
    report = assert_agreement(scene, state, random_impulse(rng, scene), *np.zeros((2, 1, 0, 2)))
    assert report.contacts == 1
    assert report.residual_max > 0.0


def test_many_steps_are_single_steps_one_after_another():
    scene = load_scene('sidewinding')
    times = (np.arange(40) + 0.5) * scene.dt
    angle, rate = gait.reference(scene.gait, times, 10)
    state, impulse = initial_state(scene), no_impulse(scene)
    for name in METHODS:
        limited = replace(scene, solver=Solver(iteration_limit=5))
        whole = METHODS[name](limited).advance(state, impulse, angle, rate)
        stepper, parts = METHODS[name](limited), (state, impulse, None)
        for k in range(40):
            part = stepper.advance(parts[0], parts[1], angle[k : k + 1], rate[k : k + 1])
            report = part[2] if parts[2] is None else parts[2] + part[2]
            parts = (part[0], part[1], report)
        # The same operations in the same order: the same bits.
        assert (whole[0].q == parts[0].q).all()
        assert (whole[0].u == parts[0].u).all()
        assert (whole[1] == parts[1]).all()
        assert all(
            np.array_equal(*pair)
            for pair in zip(astuple(whole[2]), astuple(parts[2]), strict=True)
        )


# ---- the sweeps of the chain ------------------------------------------------------------------


def random_inertia(rng):
    """Return a symmetric positive definite matrix with eigenvalues between 0.1 and 2."""
    Q, _ = np.linalg.qr(rng.standard_normal((6, 6)))
    return Q @ np.diag(rng.uniform(0.1, 2.0, 6)) @ Q.T


@pytest.mark.parametrize('link_count', [1, 2, 3, 5, 6, 11, 20])
def test_sweeps_solve_the_constrained_chain(link_count):
    n, root = link_count, link_count // 2
    for seed in range(5):
        rng = np.random.default_rng([seed, n])
        R = rotation_matrices(random_parameters(rng, n))
        center, axis = np.empty((n, 3)), np.empty((n - 1, 2, 6))
        chain_geometry(rng.uniform(0.1, 0.5, n), R, center, axis)
        inertia = np.array([random_inertia(rng) for _ in range(n)])
        momentum, wrench = rng.uniform(-1, 1, (2, n, 6))
        torque = rng.uniform(-1, 1, (n - 1, 2))
        damping = rng.uniform(0, 0.5, (n - 1, 2, 2)) * (seed % 2)
        damping = damping @ np.swapaxes(damping, 1, 2)
        entries = damping[:, [0, 0, 1], [0, 1, 1]]

        swept = inertia.copy()
        gain, compliance = np.empty((n - 1, 2, 6)), np.empty((n - 1, 3))
        load, twist = np.empty((n - 1, 2)), np.empty((n, 6))
        articulated_inertia(axis, entries, swept, gain, compliance)
        articulated_velocity(
            axis, gain, compliance, swept[root], torque, momentum, wrench, load, twist
        )

        # One system for the twists V of all links and the impulses of all joints, split into
        # N lambda (a constraint: what S does not span) and S (S^T S)^-1 (torque - D q'):
        # A_i V_i - sum of joint impulses = momentum + wrench; N^T (V_outer - V_parent) = 0; with
        # q' = (S^T S)^-1 S^T (V_outer - V_parent).
        K = np.zeros((6 * n + 4 * (n - 1), 6 * n + 4 * (n - 1)))
        right = np.concatenate([(momentum + wrench).ravel(), np.zeros(4 * (n - 1))])
        for i in range(n):
            K[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = inertia[i]
        for j in range(n - 1):
            outer, parent = (j + 1, j) if j >= root else (j, j + 1)
            difference = np.zeros((6, 6 * n))
            difference[:, 6 * outer : 6 * outer + 6] = np.eye(6)
            difference[:, 6 * parent : 6 * parent + 6] = -np.eye(6)
            S = axis[j].T
            dual = S @ np.linalg.inv(S.T @ S)
            N = np.linalg.svd(S.T)[2][2:].T
            rows = slice(6 * n + 4 * j, 6 * n + 4 * j + 4)
            K[: 6 * n, : 6 * n] += difference.T @ dual @ damping[j] @ dual.T @ difference
            K[: 6 * n, rows] = -difference.T @ N
            K[rows, : 6 * n] = N.T @ difference
            right[: 6 * n] += difference.T @ dual @ torque[j]
        expected = np.linalg.solve(K, right)[: 6 * n].reshape(n, 6)
        # Rounding times size and condition of the system: the bound of Gaussian elimination.
        bound = len(K) * EPS * np.linalg.cond(K) * np.abs(expected).max()
        assert np.abs(twist - expected).max() < bound


@pytest.mark.parametrize('size', range(1, 7))
def test_invert(size):
    rng = np.random.default_rng(size)
    for _ in range(20):
        Q, _ = np.linalg.qr(rng.standard_normal((size, size)))
        eigenvalues = 10 ** rng.uniform(-3, 3, size)
        A = Q @ np.diag(eigenvalues) @ Q.T
        inverse = A.copy()
        invert(inverse)
        # Elimination without pivoting is as good as any for these matrices: eps times condition.
        bound = 16 * EPS * eigenvalues.max() / eigenvalues.min() * np.abs(np.linalg.inv(A)).max()
        assert np.abs(inverse - np.linalg.inv(A)).max() < bound
