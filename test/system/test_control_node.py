# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node control moves a simulated robot by controllers of the package and of a user."""

import math
from pathlib import Path
import re
import shlex

import numpy as np
from offline import nanoseconds
import pytest
from sensor_msgs.msg import JointState
from sim_client import SimClient

from snake_sim_ros import Following, PlanarPath
from snake_sim_ros.scene.parameters import load_scene

ROOT = Path(__file__).resolve().parents[2]
OWN = """
import numpy as np

class Bent:
    period, sees_poses = 0.05, False

    def start(self, scene):
        self.joints, self.tired = scene.robot.link_count - 1, None

    def control(self, measured, time):
        if self.tired is None and time > 1.9:
            self.tired = time
        if self.tired is not None and time < self.tired + 0.2:
            raise ArithmeticError('a joint that is tired')
        less = 0.1 * np.sign(measured.joint_angle.sum()) if time > 3 else 0.0
        bent = np.tile([0.3 - less, 0.0], (self.joints, 1))  # of what the robot measures
        return lambda t: (np.tile(bent, (len(t), 1, 1)), np.zeros((len(t), self.joints, 2)))
"""

FEELING = """
import numpy as np

class Feeling:
    period, sees_poses, sees_contacts, sees_imus = 0.05, False, True, True

    def start(self, scene):
        self.scene, self.joints = scene, scene.robot.link_count - 1

    def control(self, measured, time):
        force, up = measured.contact_wrench[:, 2].sum(), measured.imu[:, 9].mean()
        weight = 9.81 * self.scene.robot.chain.mass.sum()
        at_rest = abs(force / weight - 1) < 0.01 and abs(up / 9.81 - 1) < 0.01
        bent = np.tile([0.3 if at_rest else 0.0, 0.0], (self.joints, 1))
        return lambda t: (np.tile(bent, (len(t), 1, 1)), np.zeros((len(t), self.joints, 2)))
"""


@pytest.fixture(scope='module')
def client(make_graph):
    client = SimClient(
        make_graph(), 'real_time_factor:=2.5', 'publish_rate:=50.0', 'robot.command_delay:=0.02',
        'imu_links:=all', 'contact_force_links:=all',
    )  # fmt: skip
    client.wait_until_connected()
    client.commanded = client.graph.record(JointState, 'joint_command')
    return client


@pytest.fixture
def sim(client):
    """A robot at its start, and what begins to control it; that ends with the test."""
    started = []

    def control(*parameters):
        started.append(client.graph.start('control', 'use_sim_time:=true', *parameters))
        client.graph.until(lambda: started[0].count('control begins at'), 'control')
        return started[0], client.now

    client.reset()
    client.commanded.clear()
    client.control = control
    yield client
    for node in started:
        client.graph.end(node)


def wait_until_in_control(sim):
    """Wait until new diagnostics of the node say so: messages may be late on a loaded machine."""

    def in_control():
        return any(
            each.name == 'control: control' and each.message == 'in control'
            for message in sim.diagnostics[heard:]
            for each in message.status
        )

    heard = len(sim.diagnostics)
    sim.graph.until(in_control, 'the node to be in control')


def test_controller_of_a_user_moves_the_robot_and_its_errors_hold_it(sim, tmp_path):
    (tmp_path / 'own.py').write_text(OWN)
    node, begin = sim.control(f'controller.name:={tmp_path / "own.py"}:Bent')
    sim.graph.until(
        lambda: node.count('the controller failed (ArithmeticError: a joint that is tired)'),
        'the error',
    )
    sim.advance_to(begin + 2.8)
    wait_until_in_control(sim)
    sim.advance_to(begin + 4.5)
    wanted = np.tile([0.2, 0.0], 10)
    assert np.array(sim.commanded[-1].position) == pytest.approx(wanted, abs=1e-9)
    assert np.array(sim.joint_states[-1].position) == pytest.approx(wanted, abs=0.1)
    # A cubic blend of 1 s has rates up to 1.5 times the way, from where a gait starts to 0.3 rad.
    blended = [m for m in sim.commanded if 1e-9 * nanoseconds(m) < begin + 1.5]
    angles = np.array([message.position for message in blended])
    times = np.diff([1e-9 * nanoseconds(message) for message in blended])
    way = 0.3 + load_scene('lateral_undulation').gait.yaw.amplitude
    assert np.abs(angles[-1] - angles[0]).max() > 0.02  # its begin may come before it is heard
    assert (np.abs(np.diff(angles, axis=0)) <= 1.5 * way * times[:, None] + 1e-6).all()
    # Where joint_states are some hundredths of a second apart, as on a busy machine, what puts the
    # robot back looks like a motion.
    for _ in range(10):
        sim.reset()
        sim.graph.spin(1.0)
        if node.count('since the robot was put back'):
            return
    pytest.fail(f'no reset was noticed: {node.lines}')


def test_controller_feels_contacts_and_inertial_units(sim, tmp_path):
    """A robot at rest bends where the ground carries its weight, and every IMU measures g."""
    (tmp_path / 'feeling.py').write_text(FEELING)
    sim.control(f'controller.name:={tmp_path / "feeling.py"}:Feeling')
    sim.graph.until(
        lambda: sim.commanded and min(sim.commanded[-1].position[::2]) > 0.29, 'the bend'
    )
    wait_until_in_control(sim)


def place_of(poses):
    """Return the mean place of the links in a message, (2,) [m]."""
    return np.mean([(each.position.x, each.position.y) for each in poses.poses], axis=0)


@pytest.mark.parametrize('name', ['compliance', 'obstacle_aided'])
def test_controllers_between_obstacles_move_the_robot(sim, name):
    _, begin = sim.control(f'controller.name:={name}')
    start = place_of(sim.link_poses[-1])
    for later in (4.0, 8.0, 16.0):  # on a loaded machine commands come late
        sim.advance_to(begin + later)
        if np.hypot(*(place_of(sim.link_poses[-1]) - start)) > 0.1:
            break
    assert np.hypot(*(place_of(sim.link_poses[-1]) - start)) > 0.1
    wait_until_in_control(sim)


def test_network_of_the_page_reaches_its_goal(sim, monkeypatch):
    """The command on the page on learning, with a goal that is reached in about 5 s."""
    pytest.importorskip('gymnasium')
    page = (ROOT / 'docs' / 'learning.md').read_text(encoding='utf-8')
    (given,) = re.findall(r'^./run control --ros-args (.*goal_policy.*)$', page, re.MULTILINE)
    name, goal = (word for word in shlex.split(given) if word.startswith('controller'))
    assert goal == 'controller.goal:=[1.5, 1.0]'
    monkeypatch.chdir(ROOT)
    _, begin = sim.control(name, 'controller.goal:=[0.8, 0.5]')

    while np.hypot(*(place_of(sim.link_poses[-1]) - (0.8, 0.5))) > 0.15:
        assert sim.now < begin + 60.0, 'the goal was not reached'
        sim.advance_to(sim.now + 0.1)
    wait_until_in_control(sim)


def test_robot_follows_a_path_at_50_hertz_with_20_milliseconds_of_delay(sim):
    """The targets of a simulated run hold over messages, within twice its errors."""
    _, begin = sim.control(
        'publish_rate:=50.0', 'follow.center:=[0.0, -1.5]', 'follow.radius:=1.5',
        'follow.period:=0.02',
    )  # fmt: skip
    heard, covered = len(sim.link_poses), 0.0
    path = PlanarPath.of(Following(center=(0.0, -1.5), radius=1.5))
    for end in (10.0, 20.0, 40.0):  # on a loaded machine commands come late
        sim.advance_to(begin + end)
        wait_until_in_control(sim)
        centers = np.array([place_of(message) for message in sim.link_poses[heard:]])
        arcs, errors = path.track(centers[len(centers) // 2 :])
        covered = abs(arcs[-1] - arcs[0])
        if covered > 0.3:
            break
    assert covered > 0.3
    rms = math.sqrt(np.mean(errors**2))
    assert rms < 0.1 * 11 * 0.14  # twice 5 % of the body length
