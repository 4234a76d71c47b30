# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Positions, velocities and efforts as modes of the joints of a real `sim`, each one alone."""

from array import array
import math

import numpy as np
import pytest
from sensor_msgs.msg import JointState
from sim_client import connected, SimClient

NAMES = [f'joint_{j}_{axis}' for j in range(1, 11) for axis in ('yaw', 'pitch')]
JOINT = 'joint_5_yaw'
INDEX = NAMES.index(JOINT)


@pytest.fixture(scope='module')
def sims(make_graph):
    """Return a sim in lock-step whose joints take efforts, and one that runs and takes none."""
    return connected(
        SimClient(
            make_graph(),
            *('start_paused:=true', 'robot.effort_commands:=true', 'command_timeout:=0.1'),
        ),
        SimClient(make_graph(), 'command_timeout:=0.2'),
    )


@pytest.fixture
def sim(sims):
    sims[0].reset()
    sims[0].start = np.array(sims[0].step()[0].position)
    return sims[0]


def joints(**values):
    """Return a command for all joints, NaN where an interface has no controller."""
    message = JointState(name=NAMES)
    for kind, given in values.items():
        numbers = np.full(20, math.nan) if given is None else np.array(given, dtype=float)
        setattr(message, kind, array('d', numbers.tobytes()))
    return message


def only(value):
    """Return a number for JOINT and none for all others."""
    return [value if k == INDEX else math.nan for k in range(20)]


def steps(sim, count):
    for _ in range(count):
        state = sim.step()[0]
    return state


def test_effort_alone_is_the_torque_of_a_joint_whose_controller_is_off(sim):
    sim.publish(JointState(name=[JOINT], effort=[1.5]))
    state = steps(sim, 20)
    assert state.effort[INDEX] == pytest.approx(1.5, abs=1e-12)
    # Against 40 N m/rad this torque would turn the joint by 0.0375 rad.
    turned = state.position - sim.start
    assert turned[INDEX] > 0.1
    assert np.abs(np.delete(turned, INDEX)).max() < 0.05
    sim.publish(JointState(name=[JOINT], effort=[0.0]))
    assert steps(sim, 2).effort[INDEX] == 0.0


def test_position_takes_a_joint_back_from_where_it_is(sim):
    sim.publish(JointState(name=[JOINT], effort=[1.5]))
    there = steps(sim, 20).position[INDEX]
    assert there - sim.start[INDEX] > 0.1
    sim.publish(JointState(name=[JOINT], position=[there]))
    for _ in range(60):
        state = sim.step()[0]
        # It moves on by what it had, rather than to the reference from before.
        assert state.position[INDEX] == pytest.approx(there, abs=0.05)
    assert state.position[INDEX] == pytest.approx(there, abs=0.02)
    # The torque is that of the spring again, 40 N m/rad, without the one that was commanded.
    spring = 40.0 * (there - state.position[INDEX])
    assert state.effort[INDEX] == pytest.approx(spring, abs=0.05)


def test_velocity_alone_turns_a_joint_at_that_rate(sim):
    rate, angles = -np.sign(sim.start[INDEX]), []
    for _ in range(20):
        sim.publish(JointState(name=[JOINT], velocity=[rate]))
        angles.append(steps(sim, 5).position[INDEX])
    # Once it has left its place, the joint is as late as friction bends its spring.
    assert angles[-1] - angles[-11] == pytest.approx(0.25 * rate, abs=0.02)


def test_interfaces_without_controllers_are_no_commands(sim):
    rejected = sim.values()['rejected_commands']
    sim.publish(joints(position=None, velocity=None, effort=None))
    steps(sim, 2)
    # Two controllers: one commands a position, another the torque of the next joint.
    torque = [math.nan] * 20
    torque[INDEX + 2] = 0.2
    sim.publish(joints(position=only(0.1), velocity=None, effort=torque))
    state = steps(sim, 30)
    assert state.position[INDEX] == pytest.approx(0.1, abs=0.02)
    assert state.effort[INDEX + 2] == pytest.approx(0.2, abs=1e-12)
    assert sim.values()['rejected_commands'] == rejected


def test_reset_turns_controllers_on(sim):
    sim.publish(JointState(name=NAMES, effort=[0.2] * 20))
    steps(sim, 10)
    sim.reset()
    state = steps(sim, 20)
    assert np.abs(state.position - sim.start).max() < 1e-3


def test_first_command_is_confirmed_once(sims):
    sim = sims[1]
    sim.publish(joints(position=None))
    sim.publish(JointState(name=['joint_1_jaw'], position=[0.1]))
    sim.process.wait_for('unknown joint')
    assert not sim.process.count('first command')
    sim.publish(JointState(name=NAMES[:2], position=[0.1, 0.0], velocity=[0.0, 0.0]))
    sim.process.wait_for('first command taken: joint_command moves 2 joints by position and velo')
    sim.publish(JointState(name=NAMES[:2], position=[0.1, 0.0]))
    sim.advance_to(sim.now + 0.5)
    assert sim.process.count('first command') == 1


def test_efforts_of_a_robot_that_takes_none_are_rejected_with_the_reason(sims):
    sims[1].publish(JointState(name=[JOINT], effort=[0.3]))
    sims[1].process.wait_for('efforts alone need a robot that takes them: robot.effort_commands')


def test_stream_that_ends_where_all_joints_have_arrived_is_not_missed(sim):
    """As with the default threshold of a JointStateTopicSystem, which then sends no more."""
    said, off = 'no joint_command any more', 1.0
    for _ in range(300):
        if off > 1e-5:
            sim.publish(joints(position=sim.start))
        off = np.abs(sim.step()[0].position - sim.start).sum()
    assert off < 1e-5
    sim.values()
    assert said not in sim.diagnostics[-1].status[0].message
    for _ in range(3):
        sim.publish(joints(position=1.1 * sim.start))
        steps(sim, 2)
    # The joints are off by what friction holds: a stream would go on.
    assert np.abs(steps(sim, 30).position - 1.1 * sim.start).sum() > 1e-3
    sim.values()
    assert said in sim.diagnostics[-1].status[0].message
