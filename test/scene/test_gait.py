# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Joint references of the gaits and the postures in which the scenes begin."""

import math

import numpy as np
import pytest
from random_states import EPS, random_robot

from snake_sim_ros import Gait, Robot, Scene, Wave
from snake_sim_ros.scene import gait, posture
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.rotations import rotation_matrices

pytestmark = pytest.mark.fast

SCENES = ['lateral_undulation', 'lateral_undulation_isotropic', 'sidewinding', 'sinus_lifting']
JOINTS = 10
# Angles up to 1 rad from a phase up to 100 rad, whose rounding the sine passes on.
ROUNDING = 100 * EPS


@pytest.fixture(params=SCENES)
def scene(request):
    return load_scene(request.param)


def test_rates_are_the_derivatives_of_the_angles(scene):
    T_s, h = scene.gait.soft_start, 1e-5
    # Within h of the end of the soft start its second derivative jumps; next test.
    times = np.linspace(0.01, 14.99, 1000)
    times = times[np.abs(times - T_s) > 2 * h]
    (later, _), (sooner, _) = (
        gait.reference(scene.gait, times + sign * h, JOINTS) for sign in (1, -1)
    )
    _, rate = gait.reference(scene.gait, times, JOINTS)
    # Central difference: h^2/6 |alpha'''|, where alpha = s A sin(omega t + ..), |s| <= 1,
    # |s'| <= 1.5/T_s, |s''| <= 6/T_s^2, |s'''| = 12/T_s^3: less than A (omega + 2.3/T_s)^3, with
    # A <= 0.53, omega <= 2.8 /s, T_s = 4.5 s or s = 1: 18 rad/s^3. Phases up to 42 rad are rounded
    # by eps/2 times 32, and the difference of two sines by twice A times that over 2 h.
    bound = h**2 / 6 * 18 + 0.53 * 16 * EPS / h
    assert np.abs(rate - (later - sooner) / (2 * h)).max() < bound


def test_soft_start_formula():
    T_s = 4.5
    # s = 3 x^2 - 2 x^3, x = t/T_s: 0 before, 1/2 in the middle, 27/32 at three quarters, 1 after.
    times = T_s * np.array([-1.0, 0.0, 0.25, 0.5, 0.75, 1.0, 2.0])
    s, s_dot = gait.soft_start(times, T_s)
    assert s == pytest.approx([0, 0, 5 / 32, 1 / 2, 27 / 32, 1, 1], abs=4 * EPS)
    # s' = 6 x (1 - x)/T_s
    assert s_dot == pytest.approx(np.array([0, 0, 9 / 8, 3 / 2, 9 / 8, 0, 0]) / T_s, abs=4 * EPS)


def test_soft_start_is_continuous_with_its_rate():
    T_s, h = 4.5, 1e-6
    for edge in (0.0, T_s):
        s, s_dot = gait.soft_start(edge + h * np.array([-1.0, 1.0]), T_s)
        # The rate is continuous, |s''| <= 6/T_s^2 on either side.
        assert abs(s_dot[1] - s_dot[0]) < 2 * h * 6 / T_s**2
        # So is the angle, with rate 0 at both edges: |s'| <= 6/T_s^2 h there.
        assert abs(s[1] - s[0]) < 2 * h * 6 / T_s**2 * h + 2 * EPS


def test_no_soft_start_is_full_at_once():
    s, s_dot = gait.soft_start(np.array([0.0, 1.0]), 0.0)
    assert s.tolist() == [1.0, 1.0]
    assert s_dot.tolist() == [0.0, 0.0]


def test_reference_formula():
    wave = {'amplitude': 0.5, 'angular_frequency': 1.4, 'phase_lag': -0.9, 'phase': 0.3}
    pitch = Wave(amplitude=0.2, angular_frequency=2.8, phase_lag=-1.8, phase=-0.8, offset=-0.05)
    gaits = Gait(yaw=Wave(**wave, offset=0.1), pitch=pitch, soft_start=2.0)
    angle, rate = gait.reference(gaits, 1.5, JOINTS)
    s, s_dot = 27 / 32, 9 / 8 / 2.0  # at x = 3/4
    for i in range(1, JOINTS + 1):
        # Eqs. (70), (71): s (A sin(omega t + (i - 1) delta + delta_0) + psi), i = 1 to n-1.
        yaw = 0.5 * math.sin(1.4 * 1.5 - 0.9 * (i - 1) + 0.3) + 0.1
        assert abs(angle[i - 1, 0] - s * yaw) < ROUNDING
        yaw_rate = 0.5 * 1.4 * math.cos(1.4 * 1.5 - 0.9 * (i - 1) + 0.3)
        assert abs(rate[i - 1, 0] - s * yaw_rate - s_dot * yaw) < ROUNDING
        value = 0.2 * math.sin(2.8 * 1.5 - 1.8 * (i - 1) - 0.8) - 0.05
        assert abs(angle[i - 1, 1] - s * value) < ROUNDING


def test_offsets_shift_and_fade_in():
    yaw, pitch = Wave(offset=0.3), Wave(offset=-0.1)
    # Waves without amplitude are their offset, psi at full strength and s psi before.
    angle, rate = gait.reference(Gait(yaw=yaw, pitch=pitch), 7.0, JOINTS)
    assert angle.tolist() == [[0.3, -0.1]] * JOINTS
    assert rate.tolist() == [[0.0, 0.0]] * JOINTS
    angle, rate = gait.reference(Gait(yaw=yaw, pitch=pitch, soft_start=4.0), 2.0, JOINTS)
    assert angle == pytest.approx(np.tile([0.15, -0.05], (JOINTS, 1)), abs=ROUNDING)
    # s' = 3/2/T_s in the middle
    assert rate == pytest.approx(np.tile([0.3, -0.1], (JOINTS, 1)) * 3 / 8, abs=ROUNDING)


def test_a_negative_phase_lag_sends_the_wave_to_the_last_link(scene):
    wave = scene.gait.yaw
    assert wave.phase_lag < 0
    # alpha_i+1(t + delay) = alpha_i(t), delay = -delta/omega, after the soft start.
    delay = -wave.phase_lag / wave.angular_frequency
    now, _ = gait.reference(scene.gait, 9.0, JOINTS)
    later, _ = gait.reference(scene.gait, 9.0 + delay, JOINTS)
    assert np.abs(later[1:, 0] - now[:-1, 0]).max() < ROUNDING


def test_arrays_and_single_times_agree(scene):
    times = np.array([0.0, 0.3, 4.5, 11.0])
    angles, rates = gait.reference(scene.gait, times, JOINTS)
    assert angles.shape == rates.shape == (4, JOINTS, 2)
    for k, time in enumerate(times):
        angle, rate = gait.reference(scene.gait, float(time), JOINTS)
        assert angle.shape == rate.shape == (JOINTS, 2)
        # Sines of arrays may be computed by other instructions than those of single numbers.
        assert np.abs(angle - angles[k]).max() < ROUNDING
        assert np.abs(rate - rates[k]).max() < 3 * ROUNDING


@pytest.mark.parametrize('joint_count', [0, 1, 4])
def test_any_number_of_joints(scene, joint_count):
    angle, rate = gait.reference(scene.gait, np.zeros(3), joint_count)
    assert angle.shape == rate.shape == (3, joint_count, 2)


def test_scenes_stay_within_the_limits_of_the_joints(scene):
    angle, rate = gait.reference(scene.gait, np.linspace(0, scene.duration, 5000), JOINTS)
    assert np.abs(angle).max() < scene.robot.joint_limit
    assert np.abs(rate).max() < scene.robot.joint_rate_limit


# ---- initial postures -----------------------------------------------------------------------


def check_initial_posture(scene):
    robot = scene.robot
    q = posture.initial_coordinates(scene)
    # Lengths up to 1.4 m and angles up to 1 rad, each from a dozen roundings.
    assert np.abs(np.linalg.norm(q[:, 3:], axis=1) - 1).max() < ROUNDING
    expected, _ = gait.reference(scene.gait, 0.0, robot.link_count - 1)
    assert np.abs(posture.joint_angles(q) - expected).max(initial=0.0) < ROUNDING
    # The centroid of the link centers is over the origin, the lowest sphere touches the floor.
    assert np.abs(q[:, :2].mean(axis=0)).max() < ROUNDING
    assert abs(posture.gaps(robot, q).min()) < ROUNDING
    # e_x is the principal axis: no product of inertia, and the larger second moment along it.
    (xx, xy), (_, yy) = q[:, :2].T @ q[:, :2]
    assert abs(xy) < ROUNDING
    assert xx >= yy
    # Links are chained: r_i+1 - r_i = (L_i e_z^i + L_i+1 e_z^i+1)/2.
    half = robot.per_link('link_length') / 2
    axis = half[:, None] * rotation_matrices(q[:, 3:])[:, :, 2]
    assert np.abs(np.diff(q[:, :3], axis=0) - axis[:-1] - axis[1:]).max(initial=0.0) < ROUNDING


def test_initial_posture_of_a_scene(scene):
    check_initial_posture(scene)


@pytest.mark.parametrize('link_count', [1, 2, 6])
def test_initial_posture_of_other_robots(link_count):
    wave = Wave(amplitude=0.4, phase_lag=-0.9, phase=0.5)
    pitch = Wave(amplitude=0.1, phase_lag=-1.8, offset=0.05)
    robot = random_robot(np.random.default_rng(link_count), link_count)
    check_initial_posture(Scene(robot=robot, gait=Gait(yaw=wave, pitch=pitch)))


def test_middle_link_of_case_a():
    scene = load_scene('lateral_undulation')
    assert scene.robot.middle_link == 5  # the paper's link 6
    x, y, _ = posture.initial_coordinates(scene)[scene.robot.middle_link, :3]
    # In the plane: link i has the heading sum of alpha_j, j < i, alpha_j = A sin((j - 1) delta),
    # A = 30 deg, delta = -50 deg; the principal axis is the eigenvector of the larger moment.
    joint = np.arange(10)
    heading = np.cumsum([0.0, *(math.radians(30) * np.sin(joint * math.radians(-50)))])
    steps = 0.122 * np.column_stack([np.cos(heading), np.sin(heading)])
    center = np.cumsum(steps, axis=0) - steps / 2
    center -= center.mean(axis=0)
    along = np.linalg.eigh(center.T @ center)[1][:, 1]
    along *= np.sign(along[0])
    assert abs(x - center[5] @ along) < ROUNDING
    assert abs(y - center[5] @ [-along[1], along[0]]) < ROUNDING
    # In numbers, to half of the last digit.
    assert abs(x - -0.0060) < 5e-5
    assert abs(y - -0.0661) < 5e-5


@pytest.mark.parametrize('name', ['sidewinding', 'sinus_lifting'])
def test_a_soft_start_begins_straight(name):
    scene = load_scene(name)
    q = posture.initial_coordinates(scene)
    # x_i = (i - (n + 1)/2) L, y = 0, z = L_SC, links flat: p = (1/2, 1/2, 1/2, 1/2).
    assert np.abs(q[:, 0] - (np.arange(11) - 5) * 0.122).max() < ROUNDING
    assert np.abs(q[:, 1]).max() < ROUNDING
    assert np.abs(q[:, 2] - 0.0525).max() < ROUNDING
    assert np.abs(q[:, 3:] - 0.5).max() < ROUNDING


def test_center_of_mass_weighs_the_links():
    robot = Robot(link_count=3, link_mass=(1.0, 2.0, 5.0))
    q = np.zeros((2, 3, 7))
    q[1, :, :3] = [[8.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 1.6]]
    # sum of m r over sum of m = 8 kg
    assert np.abs(posture.center_of_mass(robot, q) - [[0, 0, 0], [1, 1, 1]]).max() < 4 * EPS
