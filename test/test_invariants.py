"""
What holds in every step of every gait: the contact laws, dissipation, symmetry, repeatability.

With eps the tolerance and r a prox parameter: the last sweep P' = prox_C(P - r gamma) changed P by
less than eps, where gamma are the velocities that the step ends with.
"""

import math

import numpy as np
import pytest
from scenes import CLOSED
from scenes import course
from scenes import EPS
from scenes import kinetic_energy
from scenes import references
from scenes import run

from snake_sim_ros.parameters import Friction
from snake_sim_ros.parameters import Gait
from snake_sim_ros.parameters import PD_SCHEMES
from snake_sim_ros.parameters import Robot
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import Solver
from snake_sim_ros.parameters import Wave
from snake_sim_ros.posture import gaps
from snake_sim_ros.reference import contact_directions
from snake_sim_ros.reference import middle_coordinates
from snake_sim_ros.rotations import about
from snake_sim_ros.rotations import product
from snake_sim_ros.rotations import rotation_matrices
from snake_sim_ros.stepping import initial_state
from snake_sim_ros.stepping import make_stepper
from snake_sim_ros.stepping import no_history
from snake_sim_ros.stepping import Report
from snake_sim_ros.stepping import State


def wave(sign=1.0):
    """Return the yaw wave of lateral undulation, or its mirror image."""
    degree = math.radians(1.0)
    return Wave(
        amplitude=sign * 30 * degree, angular_frequency=80 * degree, phase_lag=-50 * degree
    )


PITCH = Wave(
    amplitude=math.radians(10),
    angular_frequency=math.radians(80),
    phase_lag=math.radians(-50),
    phase=math.pi / 2,
)
UNDULATION, SIDEWINDING = Gait(yaw=wave()), Gait(yaw=wave(), pitch=PITCH)
ORTHOTROPIC = Friction()
ROLLING = Friction(longitudinal=0.2, transversal=0.2, rolling=0.05)


def contact_velocities(scene, q_mid, u):
    """Return (normal, sliding x y, rolling x y) of every contact [m/s], shape (2n, 5)."""
    W = contact_directions(scene.robot, rotation_matrices(q_mid[:, 3:]))
    gamma_N, gamma_T, gamma_V = (W_k.T @ u.ravel() for W_k in W)
    return np.column_stack([gamma_N, gamma_T.reshape(-1, 2), gamma_V.reshape(-1, 2)])


@pytest.mark.parametrize(
    ('method', 'links', 'steps', 'gait', 'friction'),
    [
        ('paper', 11, 200, UNDULATION, ORTHOTROPIC),
        ('paper', 11, 400, SIDEWINDING, ORTHOTROPIC),
        ('paper', 3, 400, SIDEWINDING, ROLLING),
        ('reference', 3, 40, SIDEWINDING, ROLLING),
        ('reference', 3, 40, UNDULATION, ORTHOTROPIC),
    ],
)
def test_contacts_obey_their_laws_and_take_energy_in_every_step(
    method, links, steps, gait, friction
):
    solver = Solver(tolerance=1e-7, iteration_limit=20000)
    eps, r = solver.tolerance, np.array([solver.r_normal, solver.r_sliding, solver.r_rolling])
    scene = Scene(
        robot=Robot(link_count=links), gait=gait, friction=friction, solver=solver, method=method
    )
    state = initial_state(scene)
    state.q[:, 2] += CLOSED
    states, impulses, report = course(scene, state, steps)
    assert not report.unconverged
    closed, sliding = [], 0
    angle, rate = references(scene, steps)
    stepper = make_stepper(scene)
    for k in range(steps):
        start, end = (State(states.q[j], states.u[j]) for j in (k, k + 1))
        q_mid = middle_coordinates(start, scene.dt)
        touching = gaps(scene.robot, q_mid) <= 0.0
        P = impulses[k + 1][touching]
        gamma = contact_velocities(scene, q_mid, end.u)[touching]
        closed.append(touching.sum())
        P_N, P_T, P_V = P[:, 0], P[:, 1:3], P[:, 3:]
        gamma_N, gamma_T, gamma_V = gamma[:, 0], gamma[:, 1:3], gamma[:, 3:]
        # Signorini: P_N >= 0; where P_N' > 0, P_N' - P_N = -r gamma; where not, gamma >= -eps/r.
        assert (P_N >= 0.0).all()
        assert (P_N * np.abs(gamma_N) <= P_N * eps / r[0]).all()
        assert (gamma_N >= -eps / r[0]).all()
        # Coulomb: in the ellipse, up to rounding of its projection.
        radii = np.array([friction.longitudinal, friction.transversal])
        reserve = P_N - np.hypot(*(P_T / radii).T)
        assert (reserve >= -8 * EPS * P_N).all()
        sliding += (reserve < 1e-6 * P_N).sum()
        assert (np.hypot(*P_V.T) <= friction.rolling * P_N * (1 + 8 * EPS)).all()
        # Dissipation: P' is nearer to P - r gamma than 0, which is in the set too, so that
        # r gamma . P' <= (P - P') . P' <= eps |P'|.
        for impulse, velocity, parameter in ((P_T, gamma_T, r[1]), (P_V, gamma_V, r[2])):
            power = np.sum(impulse * velocity, axis=1)
            assert (power <= eps * np.hypot(*impulse.T) / parameter * (1 + 8 * EPS)).all()
        # Energy of the step against that of the same step without a floor, 10 m higher: joints do
        # no work on either velocity, so the difference is the work of the contact impulses at the
        # mean of both velocities: exactly so for the impulses before the last sweep, eps away.
        lifted = State(start.q + 10.0 * np.eye(7)[2], start.u)
        free, _, _ = stepper.advance(lifted, no_history(scene), angle[k : k + 1], rate[k : k + 1])
        loss = kinetic_energy(scene.robot, free.u) - kinetic_energy(scene.robot, end.u)
        mean = (gamma + contact_velocities(scene, q_mid, free.u)[touching]) / 2
        # Friction, normal and rolling parts change by eps each; 1e-15 J of rounding in energies of
        # 1e-2 J with their 66 summands.
        assert abs(loss + np.sum(P * mean)) < 3 * eps * np.linalg.norm(mean) + 1e-15
        work = np.abs(P).sum(axis=0) @ (eps / r[[0, 1, 1, 2, 2]])
        assert loss >= -work - 1e-15
    # The test has seen what it is about: sliding, and sticking or open contacts.
    assert sliding
    assert min(closed) < 2 * links if gait is SIDEWINDING else sliding < sum(closed)


def lowered(scene):
    """
    Return the initial state with all contacts safely closed, 1e-6 m deep.

    A flat robot that touches the floor exactly has gaps of +-1e-17 m: which contacts are closed
    would be decided by rounding, and with it the split of the normal forces.
    """
    state = initial_state(scene)
    state.q[:, 2] -= 1e-6
    return state


# Symmetric runs differ by rounding, sweep by sweep; but where one stops a sweep earlier they
# differ by eps. Here all do the same number of sweeps, as the tolerance is out of reach. Rounding,
# 1e-16 of lengths of 1 m in each of 400 steps, grows along the path; contacts that open in one run
# and not in the other would make it chaotic later. 1e-9 m is far from both.
SWEEPS = Solver(tolerance=1e-300, iteration_limit=50)
PATH = 1e-9  # m

symmetric_cases = pytest.mark.parametrize(
    ('method', 'links', 'steps'), [('paper', 11, 400), ('reference', 3, 60)]
)
waves_and_friction = pytest.mark.parametrize(
    ('pitch', 'friction'), [(Wave(), ORTHOTROPIC), (PITCH, ROLLING)]
)


def check_close(end, other, start):
    """Check that two ends of runs are the same, and that they are not where they began."""
    assert np.abs(end.q[:, :3] - start.q[:, :3]).max() > 1e4 * PATH
    assert np.abs(end.q[:, :3] - other.q[:, :3]).max() < PATH
    assert np.abs(end.u[:, :3] - other.u[:, :3]).max() < 10 * PATH


@symmetric_cases
@waves_and_friction
def test_mirrored_gait_gives_the_mirrored_path(method, links, steps, pitch, friction):
    # y -> -y turns yaw angles around and leaves pitch angles and the floor as they are.
    ends, mirror = [], np.array([1.0, -1.0, 1.0])
    for sign in (1.0, -1.0):
        gait = Gait(yaw=wave(sign), pitch=pitch)
        scene = Scene(
            robot=Robot(link_count=links), gait=gait, friction=friction, solver=SWEEPS,
            method=method,
        )  # fmt: skip
        start = lowered(scene)
        ends.append(run(scene, start, steps)[0])
    end = State(mirror * ends[0].q[:, :3], mirror * ends[0].u[:, :3])
    check_close(end, ends[1], start)


@symmetric_cases
@waves_and_friction
def test_robot_turned_on_the_floor_goes_the_turned_path(method, links, steps, pitch, friction):
    gait, turn = Gait(yaw=wave(), pitch=pitch), about(2, 1.234)
    scene = Scene(
        robot=Robot(link_count=links), gait=gait, friction=friction, solver=SWEEPS, method=method
    )
    start, R = lowered(scene), rotation_matrices(turn)
    turned = start.q.copy()
    turned[:, :3] = start.q[:, :3] @ R.T
    turned[:, 3:] = product(turn, start.q[:, 3:])
    end, _, _ = run(scene, start, steps)
    other, _, _ = run(scene, State(turned, start.u), steps)
    check_close(end, State(other.q[:, :3] @ R, other.u[:, :3] @ R), start)


def same(one, other):
    """Return whether states, impulses and reports are equal bit by bit."""
    (a, P_a, report_a), (b, P_b, report_b) = one, other
    arrays = [(a.q, b.q), (a.u, b.u), (P_a, P_b)]
    arrays.append((report_a.joint_torque, report_b.joint_torque))
    values = [
        {k: v for k, v in vars(report).items() if k != 'joint_torque'}
        for report in (report_a, report_b)
    ]
    return all(x.tobytes() == y.tobytes() for x, y in arrays) and values[0] == values[1]


@pytest.mark.parametrize(
    ('method', 'links', 'chunks', 'length'), [('paper', 11, 20, 50), ('reference', 3, 5, 4)]
)
@pytest.mark.parametrize('pd_scheme', PD_SCHEMES)
def test_repeated_and_divided_runs_are_equal_bit_by_bit(method, links, chunks, length, pd_scheme):
    scene = Scene(
        robot=Robot(link_count=links), gait=SIDEWINDING, friction=ROLLING, method=method,
        pd_scheme=pd_scheme,
    )  # fmt: skip
    start, steps = initial_state(scene), chunks * length
    before = start.q.copy(), start.u.copy()
    whole = run(scene, start, steps)
    assert same(whole, run(scene, start, steps))
    # Divided, with a stepper that has done other steps before.
    stepper = make_stepper(scene)
    angle, rate = references(scene, steps)
    stepper.advance(start, no_history(scene), angle[:7], rate[:7])
    state, impulse, report = start, no_history(scene), Report()
    for k in range(0, steps, length):
        part = slice(k, k + length)
        state, impulse, news = stepper.advance(state, impulse, angle[part], rate[part])
        report += news
    assert same(whole, (state, impulse, report))
    # The arguments are left alone.
    assert np.array_equal(start.q, before[0]) and np.array_equal(start.u, before[1])
