# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What controllers are given to see: contact forces and inertial units, only if they ask."""

import numpy as np
import pytest

from snake_sim_ros import load_scene, run
from snake_sim_ros.recording.sensors import recorded_sensors, Sensors
from snake_sim_ros.scene import gait
from snake_sim_ros.stepping.exact_sensors import ACCELERATION, ANGULAR_VELOCITY, ORIENTATION
from snake_sim_ros.stepping.simulation import simulate

PERIOD = 0.05


class Watching:
    """Keep what is measured, and move by the gait of the scene."""

    period, sees_poses = PERIOD, False

    def start(self, scene):
        self.seen, self.gait, self.joints = [], scene.gait, scene.robot.link_count - 1

    def control(self, measured, time):
        self.seen.append(measured)
        return lambda times: gait.reference(self.gait, times, self.joints)


class Feeling(Watching):
    """Ask for contact forces and inertial units."""

    sees_contacts = sees_imus = True


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_measurements_are_those_of_the_sensors(method):
    values, controller = {'duration': 1.0, 'method': method, 'dt': 1 / 4000}, Feeling()
    run('sidewinding', values, controller=controller)
    scene = load_scene('sidewinding', values)
    sensors = Sensors(imu_links='all', contact_force_links='all')
    found = recorded_sensors(simulate(scene, rate=1 / PERIOD), sensors)
    count = len(controller.seen)
    assert count == 20
    imu = np.array([each.imu for each in controller.seen])
    wrench = np.array([each.contact_wrench for each in controller.seen])
    pairs = (
        (imu[..., ORIENTATION], 'imu_orientation'),
        (imu[..., ANGULAR_VELOCITY], 'imu_angular_velocity'),
        (imu[..., ACCELERATION], 'imu_linear_acceleration'),
        (wrench, 'contact_wrench'),
    )
    # References differ by rounding, and steps are solved to 1e-9 m/s: 4e-6 N in 1/4000 s.
    for seen, name in pairs:
        assert seen == pytest.approx(found[name][:count], rel=1e-9, abs=1e-5), name
    assert np.abs(wrench).max() > 1.0


def test_controllers_that_do_not_ask_are_given_joints_alone():
    controller = Watching()
    run('sidewinding', duration=0.1, controller=controller)
    for each in controller.seen:
        assert each.imu is each.contact_wrench is each.position is None
        assert len(each.joint_angle) == 20
