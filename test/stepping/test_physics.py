# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Laws of mechanics that one link has to obey, each with its closed solution.

Every time stepper of `methods.METHODS` is held to every law. Where its step has a solution of its
own that differs from that of the differential equation, the test holds it to both: to the first
within the tolerance of the contact iteration, to the second within a power of dt. All methods but
`bdf2` take the step of the paper, and have its solution.
"""

import math

import numpy as np
from oracle import ORACLE
import pytest
from scenes import (
    ACROSS,
    ALONG,
    chain_rounding,
    CLOSED,
    course,
    each_method,
    EPS,
    G,
    impulse_error,
    isotropic,
    kinetic_energy,
    late_stop,
    link_scene,
    lying,
    MASS,
    OFFSET,
    particle_impulse,
    particle_scene,
    RADIUS,
    ROBOT,
    run,
    sliding_error,
    slope,
    SPEED,
    TOLERANCE,
    whole_steps,
)
from scipy.integrate import quad
from scipy.optimize import brentq

from snake_sim_ros import Friction, Robot
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.scene.rotations import about, FLAT, product

ELLIPSE = (0.1, 0.5)  # mu along and across the link
CYLINDER = MASS * RADIUS**2 / 2  # Theta_3 of a cylinder with the radius of the contacts


@each_method
@pytest.mark.parametrize('v0', [1.0, 0.3])
def test_sliding_along_the_axis_stops_where_friction_has_used_the_energy(method, dt, v0):
    # v = v0 - mu g t up to T = v0/(mu g) = 1.01937 s; d = v0^2/(2 mu g) = 0.509684 m for 1 m/s.
    mu, scene = 0.1, link_scene(method, dt)
    duration, distance = v0 / (mu * G), v0**2 / (2 * mu * G)
    steps = math.ceil(duration / dt)
    every = steps // 20
    states, impulses, report = course(scene, lying((v0, 0.0, 0.0)), steps + every, every)
    time = np.minimum(np.arange(len(states.q)) * every * dt, (steps + every) * dt)
    expected = np.maximum(v0 - mu * G * time, 0.0)
    drift = sliding_error(method, mu, steps)
    assert np.abs(states.u[:, 0, 0] - expected).max() < drift + SPEED
    # The last step ends at rest though the link has stopped within it: too far, never too short.
    excess = states.q[-1, 0, 0] - distance
    late = mu * G * dt**2 * late_stop(method)
    assert -duration * drift < excess < late + duration * drift
    # Friction acts L_SC below the center and is balanced by the normal forces:
    # N = m g/2 (1 +- mu L_SC/L_GS) = 3.79108 N in front, 2.89756 N behind.
    share = np.array([1.0, -1.0]) * mu * RADIUS / OFFSET
    span = whole_steps(method) * dt
    force = impulses[10, :, 0] / span
    assert np.abs(force - MASS * G / 2 * (1 + share)).max() < impulse_error(method) / span
    assert not report.unconverged


@each_method
@pytest.mark.parametrize(
    ('inertia', 'time', 'speed'), [(ALONG, 0.02266, 0.888850), (CYLINDER, 0.06796, 2 / 3)]
)
def test_sliding_sideways_ends_in_rolling(method, dt, inertia, time, speed):
    # The momentum about the contact line is kept: v = v0 k/(1 + k), k = m r^2/Theta_3, whatever
    # mu is, from t* = v0/(mu g (1 + k)) on; before, v = v0 - mu g t. A cylinder has k = 2.
    mu, v0, k = 0.5, 1.0, MASS * RADIUS**2 / inertia
    start, end = v0 / (mu * G * (1 + k)), v0 * k / (1 + k)
    assert start == pytest.approx(time, abs=5e-6)  # the numbers of the table, five digits
    assert end == pytest.approx(speed, abs=5e-7)
    scene = link_scene(method, dt, robot=Robot(link_count=1, inertia_axial=inertia))
    steps = 2 * math.ceil(start / dt)
    states, _, report = course(scene, lying((0.0, v0, 0.0)), steps)
    t = np.arange(steps + 1) * dt
    # The step's own solution has no error: the step in which the link begins to roll sticks at its
    # end, and the momentum is kept in it too.
    expected = np.where(t < start, v0 - mu * G * t, end)
    error = sliding_error(method, mu, steps) + SPEED
    error += steps * chain_rounding(method, v0) / MASS
    assert np.abs(states.u[:, 0, 1] - expected).max() < error
    # Rolling along +y turns about -x of I, which is -e_z of the link: v = -r omega_z.
    rolling = states.u[t >= start, 0]
    assert np.abs(rolling[:, 1] + RADIUS * rolling[:, 5]).max() < SPEED
    assert not report.unconverged


@each_method
def test_rolling_friction_stops_a_rolling_link(method, dt):
    # m a = F, Theta_3 a/r = -F r - mu_V m g r: a = -mu_V g k/(1 + k); T = v0/|a| = 1.14684 s,
    # d = v0^2/(2 |a|) = 0.286710 m.
    mu, v0, k = 0.05, 0.5, MASS * RADIUS**2 / ALONG
    a = mu * G * k / (1 + k)
    duration, distance = v0 / a, v0**2 / (2 * a)
    assert (duration, distance) == pytest.approx((1.14684, 0.286710), abs=5e-6)
    scene = link_scene(method, dt, friction=Friction(transversal=0.5, rolling=mu))
    state = lying((0.0, v0, 0.0), (0.0, 0.0, -v0 / RADIUS))
    steps = math.ceil(duration / dt)
    half, history, early = run(scene, state, steps // 2)
    # Each step leaves |gamma_T| <= SPEED and less than that, as for sliding, from friction.
    error = steps * (SPEED + chain_rounding(method, v0) / MASS)
    assert abs(half.u[0, 1] - (v0 - a * (steps // 2) * dt)) < error
    end, _, report = run(scene, half, steps - steps // 2 + 2, history)
    assert abs(end.u[0, 1]) < SPEED
    late = a * dt**2 * late_stop(method)  # as for sliding
    assert -duration * error < end.q[0, 1] - distance < late + duration * error
    assert not early.unconverged + report.unconverged


@each_method
def test_sticks_on_a_slope_up_to_the_friction_angle_without_creeping(method, dt):
    # tan b <= mu: rest, here 0.01 deg below atan(0.5) = 26.5651 deg.
    steps = round(1.0 / dt)
    gravity = slope(math.atan(0.5) - math.radians(0.01))
    scene = link_scene(method, dt, friction=isotropic(0.5), gravity=gravity)
    states, _, report = course(scene, lying(), steps, steps // 50)
    assert np.abs(states.u).max() < SPEED / OFFSET  # rotations: contact speed over the lever
    # Without creeping: the position error does not grow beyond that of single steps.
    assert np.abs(states.q - states.q[0]).max() < SPEED / OFFSET
    assert not report.unconverged


@each_method
def test_slides_down_a_slope_steeper_than_the_friction_angle(method, dt):
    # v = g (sin b - mu cos b) t; 0.01 deg above atan(0.5): 1.914262e-3 m/s after 1 s.
    steps, mu, angle = round(1.0 / dt), 0.5, math.atan(0.5) + math.radians(0.01)
    acceleration = G * (math.sin(angle) - mu * math.cos(angle))
    assert acceleration == pytest.approx(1.914262e-3, abs=5e-10)
    scene = link_scene(method, dt, friction=isotropic(mu), gravity=slope(angle))
    state, _, report = run(scene, lying(), steps)
    # A constant acceleration makes no error in v, and none in x = a t^2/2.
    drift = sliding_error(method, mu, steps)
    assert abs(state.u[0, 0] - acceleration) < drift
    assert abs(state.q[0, 0] - acceleration / 2) < drift
    assert not report.unconverged


def elliptic_acceleration(gravity):
    """
    Return the acceleration from rest with the coefficients 0.1 along and 0.5 across.

    ``a = g_t - N/m [mu_x^2 a_x, mu_y^2 a_y]/s``, ``s = sqrt(mu_x^2 a_x^2 + mu_y^2 a_y^2)``: with
    ``l = N/(m s)``, ``a = g_t/(1 + l mu^2)``, and ``l s(l) = N/m`` fixes l. No l: the body rests.
    """
    mu = np.array(ELLIPSE)

    def acceleration(factor):
        return gravity[:2] / (1 + factor * mu**2)

    def excess(factor):
        return factor * math.hypot(*(mu * acceleration(factor))) + gravity[2]

    if excess(1e9) < 0:  # the limit is the load measured by the ellipse
        return np.zeros(2)
    return acceleration(brentq(excess, 0.0, 1e9, xtol=1e-13, rtol=1e-14))


@each_method
@pytest.mark.parametrize(
    ('load', 'expected'),
    [(0.99, (0.0, 0.0)), (1.01, None), (0.3 / 0.114708, (1.5394081, 0.0900861))],
)
def test_elliptic_friction_on_a_slope(method, dt, load, expected):
    # Downhill 30 deg from the axis: rest iff tan b sqrt(cos^2/mu_x^2 + sin^2/mu_y^2) <= 1, which
    # is tan b <= 0.114708. Tested 1 % below and above, and at tan b = 0.3.
    direction = math.radians(30)
    onset = 1 / math.hypot(math.cos(direction) / 0.1, math.sin(direction) / 0.5)
    assert onset == pytest.approx(0.114708, abs=5e-7)
    gravity = np.array(slope(math.atan(load * onset), direction))
    acceleration = elliptic_acceleration(gravity)
    if expected:
        # The table's numbers, rounded, as is the tangent: 0.3 (1 +- 5e-6).
        assert acceleration == pytest.approx(expected, abs=2e-5)
    scene = particle_scene(method, dt, ELLIPSE, gravity)
    steps = round(1.0 / dt)
    state, _, report = run(scene, lying(radius=0.0), steps)
    # The direction is constant: a step makes no error, v = a t and x = a t^2/2. What a
    # sweep leaves is eps/m a step, in either contact, and a residual R leaves r_T R in place of
    # eps; brentq and rounding are as small.
    error = 4 * steps * particle_impulse(method) / MASS
    assert np.abs(state.u[0, :2] - acceleration).max() < error
    assert np.abs(state.q[0, :2] - acceleration / 2).max() < error
    assert not report.unconverged


@each_method
@pytest.mark.parametrize(
    ('v0', 'stop', 'duration'),
    [
        ((1.0, 1.0), (0.629883, 0.112316), 1.142759),
        ((1.0, 0.2), (0.518880, 0.009061), 1.028761),
    ],
)
def test_elliptic_friction_turns_the_sliding_direction(method, dt, v0, stop, duration):
    # a = -g [mu_x^2 v_x, mu_y^2 v_y]/sqrt(mu_x^2 v_x^2 + mu_y^2 v_y^2), so that v_y = C v_x^25.
    # Time and path follow by integration over v_x: dt = sqrt(mu_x^2 + mu_y^2 (v_y/v_x)^2)/(mu_x^2
    # g) dv_x.
    (mu_x, mu_y), ratio = ELLIPSE, v0[1] / v0[0]

    def pace(v_x):
        return math.hypot(mu_x, mu_y * ratio * (v_x / v0[0]) ** 24) / (mu_x**2 * G)

    integrals = [
        quad(integrand, 0.0, v0[0], epsabs=1e-12)[0]
        for integrand in (
            pace,
            lambda v: v * pace(v),
            lambda v: v0[1] * (v / v0[0]) ** 25 * pace(v),
        )
    ]
    assert integrals == pytest.approx([duration, *stop], abs=5e-7)

    if method != 'bdf2':  # its first steps, which are others, would be long
        dt = max(dt, 1 / 1000)  # each step is a call
    scene = particle_scene(method, dt, ELLIPSE, (0.0, 0.0, -G))
    steps = math.ceil(duration / dt) + 5
    states, _, report = course(scene, lying((*v0, 0.0), radius=0.0), steps)
    v = states.u[:, 0, :2]
    # The step's own law, up to its last one: the force has the direction that the end velocity
    # gives it. What the iteration leaves is eps/m in v, over g dt in the force. With BDF2 the
    # difference is over two steps, from the third one on: the first has parts.
    left = particle_impulse(method)
    mu, last = np.array(ELLIPSE), np.flatnonzero(np.hypot(*v.T) > 10 * left)[-1]
    braking = (v[1 : last - 1] - v[2:last]) / (G * dt)
    if method == 'bdf2':
        braking += ((v[1 : last - 1] - v[2:last]) - (v[: last - 2] - v[1 : last - 1])) / (
            2 * G * dt
        )
    direction = v[2:last] * mu**2 / np.hypot(*(v[2:last] * mu).T)[:, None]
    # A velocity that is off by left/r turns the direction, by left/(r |v|), on a point of the
    # ellipse of which the curvature is mu_x/mu_y^2 at most.
    turn = 0.25 / 0.1 * left / (MASS / 2) / np.hypot(*v[2:last].T)
    error = 4 * left / (MASS * G * dt) + turn
    law = np.abs(braking - direction).max(axis=1) < error
    assert law[1:].all() if method == 'bdf2' else law.all()
    # Velocity steps are implicit Euler steps down the gradient of the norm g |D v|: at most
    # dt |a0|/sqrt(2) from the solution, |a0| <= mu_y g (error bound for convex gradient flows), so
    # that the time of rest is off by that over mu_x g and one step. BDF2 is nearer.
    bound = 0.5 * G * dt / math.sqrt(2)
    assert abs((last + 1) * dt - integrals[0]) < bound / (0.1 * G) + dt
    assert np.abs(states.q[-1, 0, :2] - integrals[1:]).max() < duration * bound
    assert not report.unconverged


def bdf2_spin(omega, rate, dt, steps):
    """
    Return a perpendicular spin after some steps of BDF2, the gyroscopic torque at its prediction.

    ``w_E = w + c (w - w') + i rate h (w + r (w - w'))`` with the ratio r of the steps, c and h as
    in `oracle.bdf2`. The first step is explicit for a quarter, and BDF2 for a quarter and a
    half.
    """

    def next_one(w, before, step, ratio):
        c, h = ratio**2 / (1 + 2 * ratio), step * (1 + ratio) / (1 + 2 * ratio)
        return w + c * (w - before) + 1j * rate * h * (w + ratio * (w - before))

    before, now = omega, omega * (1 + 1j * rate * dt / 4)
    for step, ratio in [(dt / 4, 1), (dt / 2, 2), (dt, 2), *[(dt, 1)] * (steps - 2)]:
        before, now = now, next_one(now, before, step, ratio)
    return now


@each_method
@pytest.mark.parametrize(('spin', 'growth'), [(30.0, 0.0583), (3.0, None)])
def test_free_spin_gains_what_the_explicit_gyroscopic_term_gives_it(method, dt, spin, growth):
    # Without torque omega_z is constant and omega_x + i omega_y turns at W = (Theta_3 - Theta_1)/
    # Theta_1 omega_z. The explicit step multiplies it by 1 + i W dt: it turns by atan(W dt) and
    # grows by sqrt(1 + W^2 dt^2), which is exp(W^2 dt t/2) in time: 1.902 after 10 s at 30 rad/s
    # and dt = 1/4000 s, +5.83 % of energy. This is an error of the method, of first order. That of
    # BDF2 is of third order in the amount of W.
    steps = 100 if method == ORACLE else 40000
    rate = (ALONG - ACROSS) / ACROSS * spin
    scene = link_scene(method, dt, gravity=(0.0, 0.0, 0.0))
    state = lying(omega=(1.0, 2.0, spin))
    state.q[0, 2] = 1.0
    end, _, report = run(scene, state, steps)
    perpendicular = (1 + 2j) * (1 + 1j * rate * dt) ** steps
    if method == 'bdf2':
        perpendicular = bdf2_spin(1 + 2j, rate, dt, steps)
    # A step goes from B to I and back, a few roundings of the angular velocity, always the same
    # ones. What omega_z gets of them turns the other two further and further.
    error = steps * 4 * EPS * spin
    assert abs(end.u[0, 5] - spin) < error
    error = steps * 4 * EPS + error * steps * dt
    assert abs(complex(*end.u[0, 3:5]) - perpendicular) < error * abs(perpendicular)
    if method == 'bdf2':
        turn = abs(rate) * dt  # its square is of the first step
        grown = turn**2 + turn**3 * abs(rate) * steps * dt
        assert abs(abs(perpendicular) / math.sqrt(5) - 1) < grown
    elif growth and steps * dt == 10.0:
        energies = kinetic_energy(ROBOT, np.array([state.u, end.u]))
        assert energies[1] / energies[0] - 1 == pytest.approx(growth, abs=5e-5)
        assert abs(perpendicular) / math.sqrt(5) == pytest.approx(1.902, abs=5e-4)
    assert not report.contacts


@each_method
@pytest.mark.parametrize('v0', [(6.0, 0.0, 0.0), (0.0, 6.0, 0.0)])
def test_fast_sliding_does_not_lift(method, dt, v0):
    # Coulomb friction is not associated: 6 m/s along the floor leave the normal velocity 0.
    # Convex relaxations of it let a body climb mu v dt a step.
    scene = link_scene(method, dt, friction=isotropic(0.5))
    steps = math.ceil(6.0 / (0.5 * G) / dt)
    states, impulses, report = course(scene, lying(v0), steps, steps // 40)
    assert np.abs(states.u[:, 0, 2]).max() < SPEED
    # Each step moves less than SPEED dt up or down.
    assert np.abs(gaps(ROBOT, states.q)).max() < -CLOSED + steps * SPEED * dt
    error = max(4 * TOLERANCE, 2 * MASS * SPEED)  # momentum between two normal velocities
    weight = whole_steps(method) * MASS * G * dt
    assert np.abs(impulses[2:, :, 0].sum(axis=1) - weight).max() < error
    assert report.contacts == 2


@each_method
@pytest.mark.parametrize('axis', [0, 1, 2])
def test_constant_spin_turns_by_the_cayley_map(method, dt, axis):
    # Two half steps (72), (83) with the same omega turn by 4 atan(omega dt/4), exactly; on the way
    # the Euler parameters keep their length. BDF2 turns them at i omega/2 in their plane, as e^(i
    # phi/2): its error is (omega dt/2)^2/3 of the angle, which is held to three times that.
    spin, steps, scene = 10.0, 100, link_scene(method, dt, gravity=(0.0, 0.0, 0.0))
    omega = spin * np.eye(3)[axis]
    state = lying(omega=omega)
    state.q[0, 2] = 1.0
    end, _, _ = run(scene, state, steps)
    expected = product(FLAT, about(axis, steps * 4 * math.atan(spin * dt / 4)))
    error = steps * 4 * EPS
    if method == 'bdf2':
        expected = product(FLAT, about(axis, steps * spin * dt))
        error += steps * spin * dt / 2 * (spin * dt / 2) ** 2
    assert np.abs(end.q[0, 3:] - expected).max() < error
