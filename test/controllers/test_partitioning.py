# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The partitioned gait: what its three sections are, and a robot that goes over a step by it."""

import math

import numpy as np
import pytest

from snake_sim_ros import load_scene, ParameterError, run
from snake_sim_ros.controllers.partitioning import PartitionedGait
from snake_sim_ros.scene.gait import reference
from snake_sim_ros.scene.posture import chain_coordinates
from snake_sim_ros.scene.rotations import rotation_matrices

SCENE = load_scene('large_step')
HEIGHT, LENGTH = 0.462, 0.07  # m, of the step and of a link
TIME = np.linspace(0.0, 4.0, 9)  # s


@pytest.fixture
def controller():
    found = PartitionedGait(height=HEIGHT, face=1.0)
    found.start(SCENE)
    return found


def test_far_from_the_step_it_is_the_gait(controller):
    for foot in (-30.0, 60.0):
        angles = controller.joint_angles(np.full(len(TIME), foot), TIME)
        assert angles == pytest.approx(reference(SCENE.gait, TIME, 19)[0], abs=1e-12)


@pytest.mark.parametrize('foot', [9.0, 11.4, 13.0])
def test_the_upper_section_is_higher_by_the_step_in_a_vertical_plane(controller, foot):
    (angles,) = controller.joint_angles(np.array([foot]), np.array([7.3]))
    q = chain_coordinates(SCENE.robot, angles)  # the first link lies, and all others are below it
    lies = np.abs(rotation_matrices(q[:, 3:])[:, 2, 2]) < 1e-9
    assert lies[0] and lies[-1]
    assert q[0, 2] - q[-1, 2] == pytest.approx(HEIGHT, abs=0.01)
    sides = q[~lies, :2] - q[~lies, :2].mean(axis=0)
    assert np.linalg.svd(sides)[1][1] < 1e-9  # seen from above, the cantilever is a line


def test_the_body_turns_about_the_foot_where_it_is_seen(controller):
    # The face is 1 m ahead: of a straight robot, link 6 is 0.1 m beyond the clearance.
    position = np.zeros((20, 3))
    position[:, 0] = -1.0 + 0.12 - 0.1 + LENGTH * np.arange(-6, 14)
    foot = controller._measured_foot(controller.face - position[:, :2] @ controller.ahead)
    assert foot == pytest.approx(6.0 + 0.1 / LENGTH)


def test_a_robot_goes_over_a_low_step():
    box = {'center': (-3.0, 0.0, 0.14), 'size': (4.0, 4.0, 0.28)}
    values = {
        'world.boxes': (box,),
        'controller.height': 0.28,
        'gait.angular_frequency_deg': 360.0,
        'method': 'bdf2',
        'dt': 1 / 200,
        'duration': 20.0,
    }
    moved = run('large_step', values, rate=20.0)
    assert moved.report.unconverged == 0
    assert (moved.position[:, :, 2] > 0.28).all(axis=1).any()


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'height': -0.1, 'face': 1.0}, 'height must be above 0 and finite, got -0.1'),
        ({'height': 0.4, 'face': math.inf}, 'face must be finite, got inf'),
        ({'height': 0.4, 'face': 1.0, 'bend': 0.0}, 'bend must be above 0 and finite, got 0.0'),
        ({'height': 0.1, 'face': 1.0}, r'height must be at least 0\.25\d m, got 0.1 m'),
    ],
)
def test_what_cannot_be_is_said_in_a_sentence(values, message):
    with pytest.raises(ParameterError, match=message):
        PartitionedGait(**values).start(SCENE)


@pytest.mark.parametrize('scene', ['linear_progression', 'sidewinding', 'concertina', 'eel_like'])
def test_it_needs_a_wave_and_nothing_else(scene):
    with pytest.raises(ParameterError, match='needs a wave of the yaw joints without offset'):
        PartitionedGait(height=0.6, face=1.0).start(load_scene(scene))
