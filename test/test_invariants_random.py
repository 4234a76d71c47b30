"""What holds in every step, whatever the robot, its posture and the floor: random steps."""

from dataclasses import replace

from dense_step import dense_step
from dense_step import EPS
from dense_step import one_step
from hypothesis import given
from hypothesis import HealthCheck
from hypothesis import settings
from hypothesis import strategies as st
import numpy as np
import pytest

from snake_sim_ros.parameters import Friction
from snake_sim_ros.parameters import Robot
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import Solver
from snake_sim_ros.posture import chain
from snake_sim_ros.posture import gaps
from snake_sim_ros.posture import joint_angles
from snake_sim_ros.rotations import about
from snake_sim_ros.rotations import product
from snake_sim_ros.rotations import rotation_matrices
from snake_sim_ros.stepping import IMPULSE
from snake_sim_ros.stepping import make_stepper
from snake_sim_ros.stepping import no_history
from snake_sim_ros.stepping import State
from snake_sim_ros.stepping import Status

RESIDUAL = 1e-9  # m/s
LIMIT = 500  # iterations
each_method = pytest.mark.parametrize('method', ['newton', 'newton_dense'])
often = settings(
    derandomize=True,
    deadline=None,
    max_examples=25,
    database=None,
    suppress_health_check=[HealthCheck.differing_executors],
)


@st.composite
def cases(draw):
    """Return scene, state and number of steps: a random robot near the floor."""
    n = draw(st.integers(2, 8))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    spread = draw(st.sampled_from([1.0, 1.2, 3.0]))

    def around(value):
        return tuple(value * np.exp(rng.uniform(-np.log(spread), np.log(spread), n)))

    length, radius, mass = around(0.122), around(0.0525), around(7.5 / 11)
    # Moments of inertia that a body can have: Theta_3 <= 2 Theta_1.
    across = tuple(m * lg**2 / 10 for m, lg in zip(mass, length, strict=True))
    robot = Robot(
        link_count=n,
        link_length=length,
        link_mass=mass,
        inertia_transversal=across,
        inertia_axial=tuple(rng.uniform(0.1, 1.5) * theta for theta in across),
        contact_offset=tuple(0.32 * value for value in length),
        contact_radius=radius,
    )
    friction = Friction(
        longitudinal=draw(st.sampled_from([0.0, 0.1, 0.3, 0.5])),
        transversal=draw(st.sampled_from([0.0, 0.2, 0.5])),
        rolling=draw(st.sampled_from([0.0, 0.0, 0.02, 0.1])),
    )
    scene = Scene(
        robot=robot,
        friction=friction,
        solver=Solver(iteration_limit=LIMIT),
        dt=draw(st.sampled_from([1 / 4000, 1 / 1000])),
    )
    pitch = draw(st.sampled_from([0.0, 0.02, 0.3]))
    angle = rng.uniform(-1.0, 1.0, (n - 1, 2)) * [0.6, pitch]
    q = chain(robot, angle)
    turn = product(about(2, rng.uniform(-np.pi, np.pi)), about(1, rng.uniform(-pitch, pitch)))
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    q[:, 2] += draw(st.sampled_from([-1e-3, -1e-9, 1e-7])) - gaps(robot, q).min()
    # One rigid body: velocities that the joints allow.
    speed = draw(st.sampled_from([0.0, 0.1, 1.0]))
    omega = rng.uniform(-1.0, 1.0, 3) * speed
    u = np.zeros((n, 6))
    u[:, :3] = rng.uniform(-1.0, 1.0, 3) * speed + np.cross(omega, q[:, :3] - q[0, :3])
    u[:, 3:] = np.einsum('iab,a->ib', rotation_matrices(q[:, 3:]), omega)
    return scene, State(q, u), draw(st.integers(1, 5))


def check_step(scene, step, end, history, report):
    """Check T20 of one step against the dense step."""
    closed, P = step.active, history[IMPULSE, step.active]
    assert report.steps == 1
    assert report.contacts == len(closed)
    assert (np.delete(history[IMPULSE], closed, axis=0) == 0.0).all()
    converged = report.status is Status.CONVERGED
    assert converged == (report.residual_max <= RESIDUAL)
    assert converged or report.iterations >= LIMIT
    if not len(closed):
        return converged
    gamma = step.gamma(end.u)
    speed = np.abs(end.u).max()
    # Roundings of gamma, and of the impulses over r_T = 0.01 kg.
    slack = 100 * EPS * (speed + np.abs(P).max() / 0.01)
    residual = step.residual(P, gamma, step.compliance)
    assert residual <= report.residual_max + slack
    assert converged or residual > RESIDUAL - slack
    assert (P[:, 0] >= 0.0).all()
    if not converged:
        return False

    e = RESIDUAL + slack
    # Complementarity with the rule: what carries does not move off, nothing moves in.
    ruled = gamma[:, 0] + step.compliance * (P[:, 0] - step.center)
    assert (ruled >= -e).all()
    assert (ruled[P[:, 0] > scene.solver.r_normal * e] <= e).all()
    friction, r = scene.friction, scene.solver
    work = 0.0
    for part, mu, r_k in (
        (slice(1, 3), (friction.longitudinal, friction.transversal), r.r_sliding),
        (slice(3, 5), (friction.rolling, friction.rolling), r.r_rolling),
    ):
        # Within r e of the ellipse; a half axis of 0 leaves r e.
        for k, coefficient in enumerate(mu):
            bound = coefficient * P[:, 0] * (1 + 8 * EPS) + r_k * e
            assert (np.abs(P[:, part][:, k]) <= bound).all()
        if min(mu) > 0.0:
            used = np.linalg.norm(P[:, part] / mu, axis=1)
            assert (used <= P[:, 0] * (1 + 8 * EPS) + r_k * e / min(mu)).all()
        # P' = P - r e is in the set and -(gamma - e) normal to it, 0 is in it, too: the power
        # is not positive but for what e adds.
        power = np.einsum('ak,ak->a', P[:, part], gamma[:, part])
        size = np.linalg.norm(P[:, part], axis=1)
        along = np.linalg.norm(gamma[:, part], axis=1)
        allowed = e * (size + r_k * along + r_k * e)
        assert (power <= allowed).all()
        work += allowed.sum()
    # E(u_E) = E(u_free) + P . gamma - P . G P/2: contacts take energy. What u_E is off the
    # balance of its impulses (see test_newton) comes with its momentum.
    work += (P[:, 0] * e).sum()
    free = step.velocities(np.zeros(P.shape))
    off = np.abs(step.velocities(P) - end.u.ravel()).max()
    if scene.method == 'newton':
        assert off <= step.balance_error(P, end.u)
    else:
        # The condition of the joints, 1.4e5 for the paper's robot, times the ratio of masses.
        assert off <= 9 * 1.4e5 * EPS * max(1e-3, speed)
    work += off * np.abs(step.M).sum() * speed
    before = step.energy(free)
    assert step.energy(end.u) <= before + work + 100 * EPS * before
    return True


@each_method
@often
@given(case=cases())
def test_the_invariants_of_a_step(method, case):
    scene, state, steps = case
    scene = replace(scene, method=method)
    history, angle = no_history(scene), joint_angles(state.q)
    rate = np.zeros(angle.shape)
    for _ in range(steps):
        step = dense_step(scene, state, history, angle, rate)
        end, after, report = one_step(scene, state, history, angle, rate)
        check_step(scene, step, end, after, report)
        state, history = end, after


@pytest.mark.parametrize('method', ['newton', 'newton_dense', 'bdf2'])
@often
@given(case=cases())
def test_the_same_bits_twice(method, case):
    scene, state, steps = case
    scene = replace(scene, method=method)
    angle = np.tile(joint_angles(state.q), (steps, 1, 1))
    rate = np.zeros(angle.shape)
    used = make_stepper(scene)
    # A stepper that has done something else before, and a new one.
    used.advance(State(state.q + 0.0, 0.5 * state.u), no_history(scene), angle, rate)
    results = []
    for stepper in (used, make_stepper(scene)):
        end, history, report = stepper.advance(state, no_history(scene), angle, rate)
        results.append((end.q.tobytes(), end.u.tobytes(), history.tobytes(), report.iterations))
    assert results[0] == results[1]
