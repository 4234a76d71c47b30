# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A real `sim` under a stand-in for a controller manager of ros2_control.

Its hardware sends what JointStateTopicSystem sends, see `topic_system`; controllers are a line
each. It reads, updates and writes at 100 Hz of simulated time.
"""

import math

import numpy as np
import pytest
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from sim_client import connected, SimClient
from std_msgs.msg import String
from topic_system import JointStateTopicSystem

from snake_sim_ros.scene.urdf_ros2_control import PLUGIN

JOINT = 'joint_3_yaw'
PERIOD = 2  # states of a period of the manager: 100 Hz of 200 Hz
SILENCE = 'any more; the last one is held'


class Manager:
    """Runs a controller, a function that sets commands, at every second state of a sim."""

    def __init__(self, sim):
        self.sim, graph = sim, sim.graph
        if not sim.is_paused():  # A manager that starts anew takes longer than a stream pauses.
            sim.advance_to(sim.now + 0.6)
        descriptions = []
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        graph.node.create_subscription(
            String, f'{sim.namespace}/robot_description', descriptions.append, latched
        )
        graph.until(lambda: descriptions, 'robot_description')
        self.hardware = JointStateTopicSystem(graph.node, descriptions[0].data)
        publisher = self.hardware.publisher
        graph.until(publisher.get_subscription_count, 'a reader of commands')
        self.hardware.take(sim.joint_states[-1])
        self.hardware.read()

    def run(self, periods, control=lambda hardware: None):
        """Read, update and write some times, as time of the sim goes on."""
        states, graph = self.sim.joint_states, self.sim.graph
        for _ in range(periods):
            count = len(states)
            if self.sim.is_paused():
                for _ in range(PERIOD):
                    self.hardware.take(self.sim.step()[0])
            else:
                graph.until(lambda count=count: len(states) >= count + PERIOD, 'states')
            self.hardware.read()
            control(self.hardware)
            self.hardware.write()
            assert self.hardware.publisher.wait_for_all_acked(Duration(seconds=10))

    def state(self, kind, joint=JOINT):
        return self.hardware.state[joint, kind]


def sim_with(make_graph, interfaces, *parameters):
    return SimClient(make_graph(), f'ros2_control:={interfaces}', *parameters)


@pytest.fixture(scope='module')
def sims(make_graph):
    """Return a sim that runs and three in lock-step, whose joints have one interface each."""
    effort = 'robot.effort_commands:=true'
    return connected(
        sim_with(make_graph, 'position'),
        sim_with(make_graph, 'velocity', 'start_paused:=true'),
        sim_with(make_graph, 'effort', effort, 'start_paused:=true'),
        sim_with(make_graph, 'position', 'start_paused:=true'),
    )


def rejected(sim):
    return int(sim.values()['rejected_commands'])


def last_words(sim):
    sim.values()
    return sim.diagnostics[-1].status[0].message


def test_description_names_plugin_topics_and_interfaces(sims):
    hardware = Manager(sims[3]).hardware
    assert hardware.plugin == PLUGIN and hardware.threshold == -1
    assert len(hardware.joints) == 20 and hardware.joints[JOINT] == ['position']
    assert len(hardware.state) == 60


def test_nothing_is_commanded_before_a_controller_is_active(sims):
    manager, sim = Manager(sims[0]), sims[0]
    manager.run(20)
    assert manager.hardware.sent == 20  # NaN is no small difference
    assert rejected(sim) == 0 and not sim.process.count('first command')
    assert math.isfinite(manager.state('position'))


def test_controllers_of_some_joints_move_these(sims):
    manager, sim = Manager(sims[0]), sims[0]
    manager.run(1)
    start = dict(manager.hardware.state)

    def forward(hardware):
        hardware.command[JOINT, 'position'] = start[JOINT, 'position'] + 0.2

    manager.run(60, forward)
    sim.process.wait_for('first command taken: joint_command moves 1 joint by position')
    assert manager.state('position') - start[JOINT, 'position'] == pytest.approx(0.2, abs=0.02)
    assert abs(manager.state('position', 'joint_9_yaw') - start['joint_9_yaw', 'position']) < 0.05
    assert rejected(sim) == 0


def test_trajectory_is_followed_as_by_a_controller_of_trajectories(sims):
    sim = sims[3]
    sim.reset()
    manager, errors = Manager(sim), []
    manager.run(1)
    begin, first = sim.now, {n: manager.state('position', n) for n in manager.hardware.joints}

    def follow(hardware):
        share = min((sim.now - begin) / 0.7, 1.0)
        for name, start in first.items():
            hardware.command[name, 'position'] = (1.0 - share) * start
        errors.append(abs(hardware.state[JOINT, 'position'] - hardware.command[JOINT, 'position']))

    manager.run(90, follow)
    assert max(errors) < 0.1
    angles = [manager.state('position', name) for name in first]
    # Friction of the links bends the springs of yaw joints, by up to 2 N m over 40 N m/rad.
    assert np.abs(angles).max() < 0.05
    assert rejected(sim) == 0


def test_default_threshold_falls_silent_without_a_warning_and_a_dead_manager_with_one(sims):
    sim = sims[3]
    sim.reset()
    manager = Manager(sim)
    hardware = manager.hardware
    hardware.command.update({key: hardware.state[key] for key in hardware.command})
    manager.run(20)
    assert hardware.sent == 20
    hardware.threshold = 1e-5
    manager.run(100)
    assert hardware.sent < 60  # it became silent, for more than 0.5 s
    assert SILENCE not in last_words(sim)
    hardware.command[JOINT, 'position'] += 0.2
    manager.run(3)
    for _ in range(120):
        sim.step()
    assert SILENCE in last_words(sim)


def test_velocity_is_the_mode_of_a_joint_that_has_it_alone(sims):
    manager, sim = Manager(sims[1]), sims[1]
    manager.run(1)
    start = manager.state('position')
    rate = -math.copysign(0.8, start)
    angles = []

    def turn(hardware):
        hardware.command[JOINT, 'velocity'] = rate
        angles.append(hardware.state[JOINT, 'position'])

    manager.run(40, turn)
    assert angles[-1] - angles[-31] == pytest.approx(0.3 * rate, rel=0.1)
    assert rejected(sim) == 0
    manager.run(30, lambda hardware: hardware.command.update({(JOINT, 'velocity'): 0.0}))
    assert abs(manager.state('velocity')) < 0.02


def test_effort_is_the_mode_of_a_joint_that_has_it_alone(sims):
    manager, sim = Manager(sims[2]), sims[2]
    manager.run(1)
    start = manager.state('position')

    def spring(hardware):
        """Hold an angle by a torque, as a controller of one's own would."""
        angle, rate = (hardware.state[JOINT, kind] for kind in ('position', 'velocity'))
        torque = 60.0 * (start + 0.3 - angle) - 1.0 * rate
        hardware.command[JOINT, 'effort'] = max(-4.0, min(4.0, torque))

    manager.run(100, spring)
    # Where it rests, friction of the links takes the torque of the spring.
    assert manager.state('position') == pytest.approx(start + 0.3, abs=0.1)
    manager.run(2, lambda hardware: hardware.command.update({(JOINT, 'effort'): 0.0}))
    manager.run(2)
    assert manager.state('effort') == 0.0
    assert rejected(sim) == 0


def test_command_acts_within_the_period_after_its_state(sims):
    """In lock-step the delay is known: a command that follows a state is in the next one."""
    sim, records = sims[3], []
    manager = Manager(sim)
    for _ in range(2):
        sim.reset()
        manager.hardware.command[JOINT, 'position'] = math.nan
        found = []
        for k in range(20):
            state = sim.step()[0]
            manager.hardware.take(state)
            manager.hardware.read()
            if k >= 5:
                manager.hardware.command[JOINT, 'position'] = 0.05 * k
            manager.hardware.write()
            assert manager.hardware.publisher.wait_for_all_acked(Duration(seconds=10))
            found.append(state)
        records.append(found)
    angles = np.array([state.position[4] for state in records[0]])
    still = np.abs(np.diff(angles)) < 1e-4
    assert still[:5].all() and not still[5:].any()  # command 5 follows state 5, and is in state 6
    # All bits of both runs are the same, but for the time, which goes on after a reset.
    for first, second in zip(*records, strict=True):
        second.header.stamp = first.header.stamp
        assert serialize_message(first) == serialize_message(second)
