# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Controllers among obstacles: laws in closed form, references without jumps, a board of pegs."""

import math
from pathlib import Path

import numpy as np
import pytest

from snake_sim_ros import load_scene, Measured, ObstacleAided, ParameterError, run, ShapeCompliance
from snake_sim_ros.controllers.compliance import weights
from snake_sim_ros.controllers.obstacle_aided import lateral_moves
from snake_sim_ros.scene.gait import reference

PERIOD, JOINTS = 0.05, 10
BOARD = Path(__file__).parents[2] / 'examples' / 'dense_pegs.yaml'
SCENE = load_scene('lateral_undulation')


def measured(torque=0.0, angle=0.0, force=0.0):
    """Return what is measured, by numbers or arrays of the yaw of joints and of the links."""
    columns = np.zeros((2, JOINTS, 2))
    columns[0, :, 0], columns[1, :, 0] = angle, torque
    wrench = np.zeros((JOINTS + 1, 6))
    wrench[:, 1] = force
    angle, torque = columns.reshape(2, -1)
    return Measured(angle, 0.0 * angle, torque, contact_wrench=wrench)


def commanded(made, seconds, seen, begin=0.0):
    """Return times, angles and rates of a controller that sees what a function of time returns."""
    parts = []
    for time in begin + PERIOD * np.arange(round(seconds / PERIOD)):
        times = time + PERIOD * np.linspace(0.0, 1.0, 11)
        parts.append((times, *made.control(seen(time), time)(times)))
    return [np.stack(each) for each in zip(*parts, strict=True)]


@pytest.mark.parametrize('make', [ShapeCompliance, ObstacleAided])
def test_references_are_smooth_whatever_is_measured(make):
    made, random = make(), np.random.default_rng(1)
    made.start(SCENE)
    times, angle, rate = commanded(
        made, 6.0, lambda time: measured(*(8.0 * random.normal(size=(2, JOINTS)) * [[1], [0.1]]))
    )
    assert np.abs(angle[0, 0] - reference(SCENE.gait, 0.0, JOINTS)[0]).max() < 1e-12
    assert np.abs(rate[0, 0]).max() < 1e-12
    assert np.abs(angle[1:, 0] - angle[:-1, -1]).max() < 1e-9
    assert np.abs(angle).max() <= SCENE.robot.joint_limit
    h = times[0, 1] - times[0, 0]
    slope = (angle[:, 2:] - angle[:, :-2]) / (2 * h)
    assert np.abs(slope - rate[:, 1:-1]).max() < 0.02


def test_windows_share_every_phase():
    phase = np.linspace(-9.0, 9.0, 401)
    weight, slope = weights(phase, np.arange(-6, 6))
    assert weight.sum(axis=0) == pytest.approx(1.0, abs=1e-9)
    h = phase[1] - phase[0]
    central = (weight[:, 2:] - weight[:, :-2]) / (2 * h)
    # h^2/6 of a third derivative below m^3/8.
    assert np.abs(central - slope[:, 1:-1]).max() < h * h / 6 * 64
    # In the middle of a bend its own values count: 1 - 2 s(-m pi/2).
    middle, _ = weights(np.array([2.5 * math.pi]), np.array([1, 2, 3]))
    assert middle[1, 0] == pytest.approx(1 - 2 / (1 + math.exp(4 * math.pi)), abs=1e-9)


def test_a_bend_yields_as_its_spring():
    made = ShapeCompliance(stiffness=10.0, damping=0.5, threshold=1.0)
    made.start(SCENE)

    # Torques that hold all bends: beyond the threshold 2 N m sin(phi).
    def seen(time):
        sine = np.sin(made._phase(np.array([time]))[0])
        return measured(np.sign(sine) * (1.0 + 2.0 * np.abs(sine)))

    commanded(made, 8.0, seen)
    phase = made._phase(np.array([8.0]))[0]
    windows = np.arange(math.floor(phase.min() / math.pi), math.ceil(phase.max() / math.pi))
    inner = windows[1]
    within = (phase > inner * math.pi) & (phase < (inner + 1) * math.pi)
    force = 2.0 * (np.sin(phase[within]) ** 2).sum()
    amplitude, shift = made._values[inner]
    # The sum over the joints of a bend varies by a tenth as it moves, and the damper delays.
    assert made.amplitude - amplitude == pytest.approx(force / 10.0, rel=0.3)
    assert abs(shift) < 0.1
    # Torques below the threshold move nothing.
    made.start(SCENE)
    commanded(made, 1.0, lambda time: measured(0.9))
    assert all((value == [made.amplitude, 0.0]).all() for value in made._values.values())


def test_the_wave_widens_until_push_points_push():
    made = ObstacleAided(push=10.0, growth=0.5, press=0.0)
    made.start(SCENE)
    commanded(made, 1.0, lambda time: measured())
    assert made.share == pytest.approx(0.5)
    # Link 1 is turned by 30 degrees from the others, sideways forces of 40 N push it forward.
    angle = np.zeros(JOINTS)
    angle[0] = -math.pi / 6
    force = np.zeros(JOINTS + 1)
    force[0] = 40.0
    direction = np.append(0.0, np.cumsum(angle))
    forward = 40.0 * math.sin(-direction.mean())
    assert forward > 10.0
    commanded(made, 4.0, lambda time: measured(angle=angle, force=force), begin=1.0)
    assert made.share < 0.5
    below = ObstacleAided(threshold=50.0, growth=0.5)
    below.start(SCENE)
    commanded(below, 1.0, lambda time: measured(angle=angle, force=force))
    assert below.share == pytest.approx(0.5)


def test_moves_of_links_are_lateral():
    h, count = 1e-6, JOINTS + 1
    for link, move in enumerate(lateral_moves(count).T):
        direction = np.append(0.0, np.cumsum(h * move))
        y = np.append(0.0, np.cumsum(np.sin(direction)))
        center = (y[1:] + y[:-1]) / 2
        if 2 <= link < count - 2:
            assert center[link] == pytest.approx(h)
            assert np.abs(np.delete(center, [link - 1, link, link + 1])).max() < 1e-12


def test_they_move_where_the_gait_is_jammed():
    # Which friction moves the wrong way by centimeters.
    distance = {
        name: run(BOARD, controller=name, duration=4.0).distance
        for name in ('gait', 'compliance', 'obstacle_aided')
    }
    assert distance['gait'] < 0.15
    assert distance['compliance'] > 0.25
    assert distance['obstacle_aided'] > 0.25


@pytest.mark.parametrize(
    ('name', 'values', 'sentence'),
    [
        ('compliance', {'stiffness': 0}, 'stiffness must be above 0 and finite, got 0'),
        ('compliance', {'threshold': -1.0}, 'threshold must be at least 0 and finite, got -1.0'),
        ('compliance', {'amplitude': 0.9}, 'gait.yaw.amplitude must be within'),
        ('obstacle_aided', {'push': 0.0}, 'push must be above 0 and finite, got 0.0'),
        ('obstacle_aided', {'press': -0.1}, 'press must be at least 0 and finite, got -0.1'),
    ],
)
def test_numbers_that_cannot_be_are_refused(name, values, sentence):
    with pytest.raises(ParameterError) as caught:
        run('lateral_undulation', controller={'name': name, **values}, duration=0.1)
    assert sentence in str(caught.value)


def test_gaits_with_a_table_and_robots_without_sensors_are_refused():
    with pytest.raises(ParameterError, match='shapes a wave, the gait has a table'):
        ShapeCompliance().start(load_scene('concertina'))
    made = ObstacleAided()
    made.start(SCENE)
    with pytest.raises(ParameterError, match='needs the contact forces of the links'):
        made.control(Measured(*np.zeros((3, 20))), 0.0)
