# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs of Drake on the same scene; conftest.py leaves them out where it is not installed."""

from dataclasses import replace

import numpy as np
from pydrake import all as drake
import pytest
from scenes import G

from snake_sim_benchmarks.comparison.drake_runs import cenic_course, CenicRobot, CenicSettings
from snake_sim_benchmarks.comparison.paths import compiled_course, Start
from snake_sim_ros import Friction, Gait, Robot, Scene, Wave
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.state import initial_state

SETTINGS = CenicSettings(1e-3)


def test_a_thrown_robot_falls_as_it_should():
    # In flight the middle one of three links, all at rest with each other, is a free body.
    scene = Scene(robot=Robot(link_count=3), friction=Friction(longitudinal=0.2, transversal=0.2),
                  dt=0.02, duration=0.4)  # fmt: skip
    state = initial_state(scene)
    state.q[:, 2] += 5.0
    state.u[:, :3] = 1.0, -2.0, 3.0
    course = cenic_course(scene, Start(state, 0.0), settings=SETTINGS)
    t = course.time[:, None]
    expected = state.q[1, :3] + t * [1.0, -2.0, 3.0] - t**2 / 2 * [0.0, 0.0, G]
    assert course.time[-1] == pytest.approx(0.4) and course.seconds > 0.0
    # CENIC has velocities of the end of a step: up to g dt t/2 off.
    assert np.abs(course.path - expected).max() < 1.1 * G * 0.02 * 0.4 / 2


def test_drives_follow_the_joint_law():
    # One joint of two links in flight, as in test_peers.py: J a'' = K_p (r - a) + K_d (r' - a').
    # The joint is that of the theory but for half a step, A w dt/2; with the other sign of the
    # desired velocity it would be 0.3 A off.
    wave = Wave(amplitude=0.01, angular_frequency=30.0)
    scene = Scene(robot=Robot(link_count=2), gait=Gait(yaw=wave), gravity=(0.0, 0.0, G),
                  dt=1 / 1000, duration=0.5)  # fmt: skip
    robot = CenicRobot(drake, scene, CenicSettings(0.0), scene.dt)
    robot.start(*robot.generalized(initial_state(scene)))
    robot.simulator.AdvanceTo(0.5)
    log = robot.logger.FindLog(robot.simulator.get_context())
    found = log.data()[robot.plant.GetJointByName('yaw0').position_start()]
    J, w, times = 9.63e-4 / 2, wave.angular_frequency, log.sample_times()
    K_p, K_d = scene.robot.yaw_stiffness, scene.robot.yaw_damping
    response = (K_p + 1j * w * K_d) / (K_p - J * w**2 + 1j * w * K_d)
    expected = wave.amplitude * np.imag(response * np.exp(1j * w * times))
    off = np.abs(found - expected)[times > 0.2].max()
    assert off < wave.amplitude * w * scene.dt / 2


def test_a_gait_is_that_of_ours():
    # The first 9 s of case C, in which the robot gets 0.5 m far. Both have the same model but for
    # the springs of contacts, and errors of some percent are what was measured for them.
    scene = with_settings(load_scene('sidewinding'), {'method': 'newton', 'level': 'spatial'})
    scene = replace(scene, duration=9.0)
    ours = compiled_course(replace(scene, dt=1 / 1000))
    theirs = cenic_course(replace(scene, dt=0.02), settings=CenicSettings(1e-2, 1e6, 20.0))
    way = np.linalg.norm(ours.path[-1] - ours.path[0])
    assert way > 0.3
    assert np.linalg.norm(theirs.path[-1] - ours.path[-1]) < 0.05 * way
