# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The order of the time step: how its error shrinks with dt.

Positions and constant forces are taken at the middle of a step, which is second order. First order
are the velocities that it takes from its start (damping, gyroscopic torques) or its end (implicit
control), the joints, whose direction it freezes at the middle, and friction that turns. Each error
is measured over four halvings or more and the slope of a line through the logarithms is compared.
Where no closed solution exists, errors are the differences of successive halvings: they shrink
with the same order, and no reference has to be trusted.
"""

from itertools import pairwise
import math

import numpy as np
import pytest
from scenes import ACROSS, ALONG, course, G, HEIGHT, lying, MASS, particle_scene, PRINTED, run
from scipy.integrate import quad
from scipy.optimize import brentq

from snake_sim_ros import Robot, Scene, State
from snake_sim_ros.scene.parameters import load_scene, PD_SCHEMES, with_settings
from snake_sim_ros.scene.posture import center_of_mass, chain_coordinates, joint_angles
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.methods import empty_history, make_stepper, METHODS
from snake_sim_ros.stepping.state import initial_state

# In NumPy the same takes minutes; the oracle agrees with `paper` step by step, see
# test_agreement.
COMPILED = list(METHODS)
compiled_method = pytest.mark.parametrize('method', COMPILED)


def check_order(expected, band, steps, errors):
    """Check the slope of log(error) over log(step)."""
    observed = np.polyfit(np.log(steps), np.log(errors), 1)[0]
    assert abs(observed - expected) < band, (
        f'observed order {observed:.3f}, expected {expected} +- {band}; errors {errors}'
    )


def differences(paths):
    """Return the largest difference of each path to the next finer one."""
    return [np.abs(fine - coarse).max() for coarse, fine in pairwise(paths)]


@pytest.mark.parametrize(
    ('method', 'scheme', 'damping', 'order'),
    [
        ('newton', 'midpoint', 0.0, 2),
        ('newton', 'midpoint', 0.05, 1),
        ('newton', 'start', 0.0, 1),
        ('newton', 'start', 0.05, 1),
        ('newton', 'average', 0.0, 2),
        ('newton', 'average', 0.05, 2),
        ('newton', 'end', 0.0, 1),
        ('newton', 'end', 0.05, 1),
        ('bdf2', 'average', 0.0, 2),
        ('bdf2', 'average', 0.05, 2),
        ('bdf2', 'end', 0.0, 2),
        ('bdf2', 'end', 0.05, 2),
    ],
)
def test_order_of_an_oscillating_joint(method, scheme, damping, order):
    # Two links with their joint at both centers: no joint force, only the yaw controller.
    # a'' = -(K_p a + K_d a')/J with J = Theta_1/2: a = A e^(-d t) (cos w t + d/w sin w t),
    # d = K_d/(2 J), w^2 = K_p/J - d^2. Forces of q only at the middle of a step: second order. So
    # are angle and rate in the mean of the step, and whatever is at the end of a two-step formula.
    # From w dt = 0.036 on, terms of the next order are a few percent of the error: slope +- 0.1.
    stiffness, J, amplitude, duration = 40.0, ACROSS / 2, 0.2, 0.05
    d = damping / (2 * J)
    w = math.sqrt(stiffness / J - d**2)
    phase = w * duration
    expected = amplitude * math.exp(-d * duration) * (math.cos(phase) + d / w * math.sin(phase))
    counts = 400 * 2 ** np.arange(6)
    errors = []
    for count in counts:
        robot = Robot(link_count=2, link_length=1e-6, yaw_stiffness=stiffness, yaw_damping=damping)
        settings = {'method': method, 'pd_scheme': scheme, 'dt': duration / count}
        scene = Scene(robot=robot, gravity=(0.0, 0.0, 0.0), **settings)
        q = chain_coordinates(robot, np.array([[amplitude, 0.0]]))
        q[:, 2] = 1.0
        end, _, _ = run(scene, State(q, np.zeros((2, 6))), count)
        errors.append(abs(joint_angles(end.q)[0, 0] - expected))
    check_order(order, 0.1, duration / counts, errors)


def gait_in_the_air(links, scheme, dt):
    """Return the ends of the links and their velocities after a quarter second of sidewinding."""
    settings = {'gait.soft_start': 0.5, 'robot.link_count': links, 'pd_scheme': scheme, 'dt': dt}
    scene = with_settings(load_scene('sidewinding'), settings)
    state = initial_state(scene)
    state.q[:, 2] += HEIGHT
    return run(scene, state, round(0.25 / dt))[0]


@pytest.mark.parametrize('scheme', PD_SCHEMES)
@pytest.mark.parametrize('links', [3, 11])
def test_order_of_a_gait_in_the_air(links, scheme):
    # First order: damping and joints. The highest mode of 11 links, 1776 rad/s, is only just
    # resolved by the largest step, w dt = 0.22: that much of the next order takes part there, half
    # as much after each halving, 0.08 on average over the four differences.
    band, steps = 0.1, 1 / 8000 / 2 ** np.arange(5)
    ends = [gait_in_the_air(links, scheme, dt) for dt in steps]
    check_order(1, band, steps[:-1], differences([end.q[:, :3] for end in ends]))
    check_order(1, band, steps[:-1], differences([end.u for end in ends]))


def test_order_of_angular_momentum_in_the_air():
    # The sum of r x m v + Theta omega about the center of mass is constant: internal forces. The
    # step loses what frozen joints and explicit gyroscopic terms make, O(dt).
    steps, errors = 1 / 4000 / 2 ** np.arange(6), []
    for dt in steps:
        end = gait_in_the_air(11, 'midpoint', dt)
        robot = Robot()
        r = end.q[:, :3] - center_of_mass(robot, end.q)
        theta = np.array([ACROSS, ACROSS, ALONG])
        spin = np.einsum('nij,nj->i', rotation_matrices(end.q[:, 3:]), theta * end.u[:, 3:])
        errors.append(np.linalg.norm(spin + np.cross(r, MASS * end.u[:, :3]).sum(axis=0)))
    check_order(1, 0.1, steps, errors)


def swinging_particle(time, load, omega, mu):
    """
    Return the path of a particle from rest under gravity (load g sin(omega t), 0, -g), exactly.

    It rests while |load sin| <= mu. Sliding in direction s from t0 to the next zero of v, it has
    ``v = load g/omega (cos(omega t0) - cos(omega t)) - s mu g (t - t0)``. Also return how many
    times it came to rest or turned.
    """
    x, path, t0, stops = 0.0, np.zeros_like(time), 0.0, 0
    while t0 < time[-1]:
        strength = load * math.sin(omega * t0)
        if abs(strength) <= mu * (1 - 1e-12):  # rests up to the next angle asin(mu/load) + k pi
            onset = math.asin(mu / load)
            half = math.floor(omega * t0 / math.pi)
            half += omega * t0 - half * math.pi > onset
            path[time >= t0] = x
            t0 = (half * math.pi + onset) / omega
            side = 1 - 2 * (half % 2)
        else:
            side = math.copysign(1.0, strength)

        def velocity(t, t0=t0, side=side):
            force = load / omega * (math.cos(omega * t0) - math.cos(omega * t))
            return G * (force - side * mu * (t - t0))

        def position(t, t0=t0, side=side, x=x):
            swing = math.cos(omega * t0) * (t - t0)
            swing -= (math.sin(omega * t) - math.sin(omega * t0)) / omega
            return x + G * (load / omega * swing - side * mu * (t - t0) ** 2 / 2)

        end = t0 + 1e-3 / omega
        while velocity(end) * side > 0:
            end += 1e-2 / omega
        end = brentq(velocity, end - 1e-2 / omega, end, xtol=1e-15)
        path[time >= t0] = [position(t) for t in time[time >= t0]]
        x, t0, stops = position(end), end, stops + 1
    return path, stops


def swung_particle(method, count, gravity, mu):
    """Return x, y and whether the particle rests, at 20 times in 1 s of `count` steps."""
    dt, state, path = 1.0 / count, lying(radius=0.0), []
    scene = particle_scene(method, dt, mu, gravity(0.0))
    stepper, history = make_stepper(scene), empty_history(scene)
    still = np.zeros((1, 0, 2))
    acts = 1.0 if method == 'bdf2' else 0.5  # part of a step at which forces are taken
    for k in range(count):
        # A new stepper for every gravity would take ten times as long as its step.
        stepper.model.robot.gravity[:] = gravity((k + acts) * dt)
        state, history, _ = stepper.advance(state, history, still, still)
        path.append([*state.q[0, :2], np.abs(state.u[0, :2]).max() < 1e-10])
    return np.array(path)[count // 20 - 1 :: count // 20]


@compiled_method
def test_order_of_stick_slip_on_a_line(method):
    # A force that depends on time only is integrated with second order by its value at the middle;
    # a transition at rest falls somewhere within a step, an error of up to mu g dt^2/8 each. So
    # this stick-slip keeps the second order. The fraction of the step at which transitions fall is
    # different in each run and scatters the errors by a factor of 2 or so: slope +- 0.3.
    load, omega, mu = 0.5, 8.2, 0.3
    exact, stops = swinging_particle(np.linspace(0.05, 1.0, 20), load, omega, mu)
    assert stops >= 2
    # Steps of bdf2 are not in the range of its order at 40 a second.
    counts, errors = (120 if method == 'bdf2' else 40) * 2 ** np.arange(5), []
    for count in counts:
        path = swung_particle(
            method, count, lambda t: (load * G * math.sin(omega * t), 0.0, -G), (mu, mu)
        )
        errors.append(np.abs(path[:, 0] - exact).max())
    check_order(2, 0.3, 1.0 / counts, errors)


@pytest.mark.parametrize(
    ('mu', 'load', 'phase'), [((0.3, 0.3), (0.3, 0.3), 0.0), ((0.1, 0.5), (0.12, 0.6), 2.1)]
)
@compiled_method
def test_order_of_stick_slip_in_the_plane(method, mu, load, phase):
    # Gravity swings in x and y with a lag, so that the body sticks, slides along bends and sticks
    # again. The direction of friction is that of the velocity at the end of the step: first order,
    # or second where the step is that of two states, but for transitions within a step.
    def gravity(t):
        x, y = (load[k] * math.sin(8.0 * t + phase + 0.5 * k) for k in (0, 1))
        return x * G, y * G, -G

    counts = (60 if method == 'bdf2' else 40) * 2 ** np.arange(5)
    paths = [swung_particle(method, count, gravity, mu) for count in counts]
    assert 0 < paths[-1][:, 2].sum() < 20
    order, band = (2, 0.3) if method == 'bdf2' else (1, 0.1)
    check_order(order, band, 1.0 / counts[:-1], differences([path[:, :2] for path in paths]))


@compiled_method
def test_order_of_sliding_that_turns_and_stops(method):
    # Orthotropic friction, (1, 1) m/s: the end of the path by the integrals over v_x that are
    # derived in test_physics.py. The direction of friction is that of the end velocity: first
    # order, or second where all else is taken there, too.
    (mu_x, mu_y), stop = (0.1, 0.5), []
    for power in (1, 25):
        stop.append(quad(
            lambda v, power=power: v**power * math.hypot(mu_x, mu_y * v**24) / (mu_x**2 * G),
            0.0, 1.0, epsabs=1e-13,
        )[0])  # fmt: skip
    steps, errors = 1 / 1000 / 2 ** np.arange(6), []
    for dt in steps:
        scene = particle_scene(method, dt, (mu_x, mu_y), (0.0, 0.0, -G))
        end, _, _ = run(scene, lying((1.0, 1.0, 0.0), radius=0.0), round(1.2 / dt))
        errors.append(np.abs(end.q[0, :2] - stop).max())
    check_order(2 if method == 'bdf2' else 1, 0.1, steps, errors)


@pytest.mark.parametrize('method', ['newton', 'paper'])
def test_order_of_lateral_undulation_on_the_floor(method):
    # Joints, and friction that turns at 22 sliding contacts: first order, as far as the split of
    # the normal forces converges too: by the printed laws it is not unique, the selection rule
    # makes it so. The tolerance shrinks with dt, as impulses do. From rest, the first quarter
    # second; sampled every 25 ms.
    steps, paths = 1 / 1000 / 2 ** np.arange(5), []
    for dt in steps:
        settings = {
            'method': method,
            'dt': dt,
            'solver.tolerance': 4e-5 * dt,
            'solver.residual_tolerance': 1e-6 * dt,
            'solver.iteration_limit': 20000,
            'level': 'spatial',
        }
        if method == 'paper':
            settings |= {f'solver.{name}': value for name, value in PRINTED.items()}
        scene = with_settings(load_scene('lateral_undulation'), settings)
        start = initial_state(scene)
        start.q[:, 2] -= 1e-6  # contacts safely closed
        every = round(0.025 / dt)
        states, _, _ = course(scene, start, 10 * every, every)
        paths.append(states.q[:, :, :3])
    check_order(1, 0.1, steps[:-1], differences(paths))
