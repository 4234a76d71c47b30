# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is at rest stays at rest, what slides does not lift, and joints stay closed."""

from dataclasses import replace

from dense_step import EPS
import numpy as np
import pytest

from snake_sim_ros import Friction, Robot, Scene, State
from snake_sim_ros.contact.laws import PRESS_SPEED
from snake_sim_ros.dynamics.force_directions import joint_gaps
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import gaps, joint_angles
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.bdf2.events import FLAT_GAP
from snake_sim_ros.stepping.methods import empty_history, make_stepper
from snake_sim_ros.stepping.state import initial_state

DT = 1 / 1000
TILT = np.radians(10.0)
HELD = Friction(longitudinal=0.5, transversal=0.5)  # tan(10 deg) = 0.18
each_direction = pytest.mark.parametrize('direction', [0.0, 1.0, np.pi / 2])


class OnSlope:
    """The robot of case A in its curved posture, held by its controller on a floor that tilts."""

    def __init__(self, method, direction, compliance):
        down = np.array([np.cos(direction), np.sin(direction)])
        gravity = 9.81 * np.append(np.sin(TILT) * down, -np.cos(TILT))
        scene = replace(load_scene('lateral_undulation'), friction=HELD, gravity=tuple(gravity))
        settings = {'method': method, 'dt': DT, 'solver.normal_compliance': compliance}
        self.scene = with_settings(scene, settings)
        self.stepper = make_stepper(self.scene)
        self.state, self.history = initial_state(self.scene), empty_history(self.scene)
        self.angle = joint_angles(self.state.q)

    def rest(self, seconds):
        """Hold the posture for a time; return the report."""
        steps = round(seconds / DT)
        angle = np.tile(self.angle, (steps, 1, 1))
        self.state, self.history, report = self.stepper.advance(
            self.state, self.history, angle, np.zeros(angle.shape)
        )
        assert report.status is Status.CONVERGED
        assert report.steps == steps
        return report


def test_the_selection_rule_is_on_by_default():
    for scene in (Scene(), load_scene('lateral_undulation')):
        assert scene.solver.normal_compliance == 1e-4


@each_direction
@pytest.mark.parametrize('compliance', [1e-4, 0.0])
@pytest.mark.parametrize(('method', 'seconds'), [('newton', 60), ('bdf2', 10)])
def test_nothing_sinks_or_creeps_on_a_slope(method, seconds, compliance, direction):
    robot = OnSlope(method, direction, compliance)
    robot.rest(2.0)
    start = robot.state.q
    height = gaps(robot.scene.robot, start)
    report = robot.rest(seconds)
    # The impulses of the last step solve this one: every residual is rounding, of G P = 2e-3 m/s
    # or less, 22 contacts: 1e-17 m/s, and half a unit in the last place of |q| <= 1 m when a step
    # is added, 60 000 times 1e-16 m if all had the same sign. A residual of 1e-9 m/s that had the
    # same sign would make 6e-8 m, PRESS_SPEED 3e-5 m.
    bound = 1e-11
    assert np.abs(robot.state.q - start).max() <= bound
    assert np.abs(gaps(robot.scene.robot, robot.state.q) - height).max() <= bound
    # The ten joints pass on rounding; all contacts stick.
    assert np.abs(robot.history.velocity).max() <= 1e-15
    assert report.iterations_max <= 1


def test_a_robot_that_comes_to_rest_is_held_from_then_on():
    # Without a time to settle: all motion that is ever left comes from the first steps.
    robot = OnSlope('newton', 1.0, compliance=1e-4)
    robot.rest(0.1)
    start = robot.state.q
    robot.rest(1.0)
    assert np.abs(robot.state.q - start)[:, 2].max() <= 0.1 * PRESS_SPEED


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
@pytest.mark.parametrize('velocity', [(6.0, 0.0), (0.0, 6.0)])
def test_t13_a_sliding_link_does_not_lift(velocity, method):
    scene = Scene(robot=Robot(link_count=1), friction=HELD, method=method, level='spatial')
    stepper, history = make_stepper(scene), empty_history(scene)
    state = initial_state(scene)
    state.q[:, 2] -= 1e-12  # closed, whatever rounding makes of zero
    state.u[0, :2] = velocity
    none = np.zeros((1, 0, 2))
    highest = -np.inf
    for _ in range(1000):
        state, history, report = stepper.advance(state, history, none, none)
        assert report.contacts == 2
        highest = max(highest, gaps(scene.robot, state.q).max())
    # A gap is the difference of two lengths below 0.1 m; one rounding of each is left. Of a move
    # that closes a gap, `bdf2` goes on by a third in the next step, and of that by a third.
    most = (FLAT_GAP + PRESS_SPEED * scene.dt) / 2 if method == 'bdf2' else 0.0
    assert highest <= most + 4 * 0.1 * EPS
    lost = 0.5 * 9.81 * 1000 * scene.dt
    if velocity[1] == 0.0:  # it still slides at the end: v0 - mu g t, friction of all the weight
        # Less what the residual leaves open of each normal impulse: mu r_N 1e-9 m/s over m.
        slack = 1000 * 2 * 0.5 * 0.1 * 1e-9 / (7.5 / 11)
        assert state.u[0, 0] == pytest.approx(6.0 - lost, abs=slack + 2 * PRESS_SPEED)


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
@pytest.mark.parametrize('rule', ['paper', 'center_of_mass'])
def test_joints_are_closed_after_every_step(rule, method):
    settings = {'method': method, 'dt': DT, 'level': 'spatial', 'drift_correction': rule}
    scene = with_settings(load_scene('lateral_undulation'), settings)
    stepper, history = make_stepper(scene), empty_history(scene)
    start = initial_state(scene)
    spin = np.zeros((11, 6))
    spin[:, 4], spin[:, 0], spin[:, 1] = 3.0, -3.0 * start.q[:, 1], 3.0 * start.q[:, 0]
    state = State(start.q, spin)  # fast, so that a step opens the joints
    angle = np.zeros((1, 10, 2))
    drift = 0.0
    for _ in range(80):
        state, history, report = stepper.advance(state, history, angle, angle)
        drift = max(drift, report.joint_gap_max)
        # Centers are sums of lengths up to n L = 1.3 m, 11 roundings: 3e-15; angles alike.
        assert np.abs(joint_gaps(scene.robot, state.q)).max() <= 1e-12
    # There was something to close, but for `bdf2`, whose coordinates are joint angles.
    assert drift <= 1e-12 if method == 'bdf2' else drift > 1e-9
