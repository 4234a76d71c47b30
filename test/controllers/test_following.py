# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Path following: guidance in closed form, and robots that reach their paths and stay there."""

import math
import pickle

import numpy as np
import pytest

from snake_sim_ros import (
    Following,
    Gait,
    load_scene,
    ParameterError,
    PathFollower,
    PlanarPath,
    run,
    Scene,
    Table,
    Wave,
)
from snake_sim_ros.controllers.following import filter_course
from snake_sim_ros.gaits.steering import Stride

LENGTH = 11 * 0.14  # of Aiko, between its first and its last contact [m]
X_AXIS = PlanarPath.line((0.0, 0.0), (1.0, 0.0))


def follower(scene='lateral_undulation', **values):
    found = PathFollower(Following(**values), X_AXIS)
    found.start(load_scene(scene))
    return found


def straight(x, y, heading):
    """Return link centers of a straight robot with its center at a point."""
    along = 0.14 * np.arange(5, -6, -1)
    return np.column_stack(
        [x + along * math.cos(heading), y + along * math.sin(heading), np.zeros(11)]
    )


@pytest.mark.parametrize('offset', [-2.0, 0.0, 0.7])
@pytest.mark.parametrize('heading', [0.0, 0.4, 3.0])
def test_the_robot_turns_toward_the_point_ahead(offset, heading):
    guided = follower(lookahead=0.5, heading_gain=3.0, speed=0.1)
    steering = guided.guidance.steer(straight(0.3, offset, heading))
    error = math.remainder(heading - math.atan2(-offset, 0.5), 2 * math.pi)
    assert steering.speed == 0.1
    assert steering.turning == pytest.approx(-0.1 * 3.0 * error, abs=1e-12)
    assert guided.guidance.place == pytest.approx((0.3, offset, 0.0, 0.0), abs=1e-12)


def test_a_sidewinding_robot_is_guided_by_its_bearing():
    guided = follower('sidewinding', speed=0.1)
    # It moves to the left of its heading: along the path if it points to the right of it.
    assert guided.guidance.steer(straight(0.0, 0.0, -math.pi / 2)).turning == pytest.approx(
        0.0, abs=1e-12
    )


def test_the_curvature_of_the_path_is_fed_forward():
    found = PathFollower(Following(speed=0.1), PlanarPath.circle((0.0, 2.0), 2.0, -math.pi / 2))
    found.start(load_scene('lateral_undulation'))
    assert found.guidance.steer(straight(0.0, 0.0, 0.0)).turning == pytest.approx(
        0.1 / 2.0, rel=1e-2
    )


def test_the_integral_is_that_of_borhaug():
    guided, sigma, reach, total = follower(integral_gain=0.3, speed=0.1), 0.3, 0.5, 0.0
    for _ in range(50):
        off = 0.2 + sigma * total
        steering = guided.guidance.steer(straight(0.0, 0.2, 0.0))
        assert steering.turning == pytest.approx(-0.1 * 2.0 * math.atan(off / reach), rel=1e-12)
        total += 0.1 * reach * 0.2 / (off**2 + reach**2)


def test_a_path_whose_ends_meet_is_followed_from_its_begin():
    path = PlanarPath.circle((0.0, 0.0), 2.0, turn=6.26)
    found = PathFollower(Following(), path)
    found.start(load_scene('lateral_undulation'))
    found.guidance.steer(straight(2.0, -0.05, math.pi / 2))
    assert found.guidance.place.arc < 0.0
    # Elsewhere, and where it is far from the begin, it is followed from where it is nearest.
    found.start(load_scene('lateral_undulation'))
    found.guidance.steer(straight(-2.1, 0.0, math.pi / 2))
    assert found.guidance.place.arc == pytest.approx(2.0 * math.pi, abs=0.02)


def test_gains_may_change_on_the_way():
    guided, expected = follower(heading_filter=1.0).guidance, np.zeros(2)
    for frequency, speed in ((1.0, 0.1), (9.0, 0.2)):
        guided.change(Following(heading_filter=frequency, integral_gain=0.0), speed)
        steering = guided.steer(straight(0.0, 0.5, 0.0))
        filter_course(expected, frequency, -math.pi / 4, 0.1)
        assert guided.guide.filtered == pytest.approx(expected, abs=1e-14)
        assert steering.speed == speed


@pytest.mark.parametrize('periods', [(0.1,) * 40, (1.0, 0.5, 2.5)])
def test_the_reference_filter_is_critically_damped(periods):
    # c'' + 2 w c' + w^2 (c - 1) = 0 from rest at 0: c = 1 - (1 + w t) exp(-w t)
    found, w, t = np.zeros(2), 1.7, 0.0
    for period in periods:
        filter_course(found, w, 1.0, period)
        t += period
        assert found[0] == pytest.approx(1 - (1 + w * t) * math.exp(-w * t), abs=1e-13)
        assert found[1] == pytest.approx(w * w * t * math.exp(-w * t), abs=1e-13)


def test_a_filter_goes_the_short_way_round():
    found = np.array([3.0, 0.0])
    filter_course(found, 2.0, -3.0, 0.1)
    assert 3.0 < found[0] < 2 * math.pi - 3.0


PATHS = {
    'line': {'points': ((0.0, 0.0), (10.0, 0.0))},
    'circle': {'center': (0.0, LENGTH), 'radius': LENGTH},
    'sine': {
        'points': tuple((x, 0.4 * math.sin(0.4 * math.pi * x)) for x in np.arange(0, 9, 0.25))
    },
}


@pytest.mark.parametrize(('name', 'share'), [('line', 1.3), ('circle', 0.7), ('sine', 1.3)])
@pytest.mark.parametrize(
    ('scene', 'seconds', 'most'), [('lateral_undulation', 60.0, 0.05), ('sidewinding', 60.0, 0.1)]
)
def test_a_robot_follows_a_path_from_45_degrees_off(scene, seconds, most, name, share):
    scene = load_scene(scene)
    path = PlanarPath.of(Following(**PATHS[name]))
    begin = path.nearest((0.0, 0.0))
    # Link 1 is at the smaller x at heading 0, so that the robot points to -x.
    travel = begin.direction + math.pi / 4
    heading = math.remainder(
        travel - Stride.of(scene.gait, scene.friction).bearing - math.pi, 2 * math.pi
    )
    friction = {
        key: share * getattr(scene.friction, key) for key in ('longitudinal', 'transversal')
    }
    moved = run(
        scene, follow=PATHS[name], start={'heading': heading}, friction=friction,
        duration=seconds, rate=10.0,
    )  # fmt: skip
    assert not moved.report.failure
    arc, error = begin.arc, []
    for center in moved.position[:, :, :2].mean(axis=1):
        place = path.nearest(center, arc)
        arc = place.arc
        error.append(place.cross_track)
    late = np.array(error[len(error) // 2 :])
    assert math.sqrt((late**2).mean()) < most * LENGTH
    assert arc > 0.4 * seconds * 0.1  # 0.1 m/s, less what the turn takes
    rate = np.abs(moved.joint_velocity).max()
    assert rate < scene.robot.joint_rate_limit


def test_a_follower_runs_from_python_and_starts_anew():
    guided = PathFollower(Following(period=0.2), PlanarPath.line((0.0, 0.0), (-5.0, 1.0)))
    first = run('lateral_undulation', controller=guided, duration=2.0)
    again = run('lateral_undulation', controller=guided, duration=2.0)
    assert (first.position == again.position).all()
    copied = pickle.loads(pickle.dumps(guided))
    assert (
        run('lateral_undulation', controller=copied, duration=2.0).position == again.position
    ).all()
    scene = {'points': [[0, 0], [-5, 1]], 'period': 0.2}
    same = run('lateral_undulation', follow=scene, duration=2.0)
    assert (first.position == same.position).all()
    assert guided.steering.speed == pytest.approx(
        Stride.of(first.scene.gait, first.scene.friction).speed(first.scene.gait)
    )


@pytest.mark.parametrize('rate', [10.0, 100.0])
def test_samples_between_corrections_change_nothing(rate):
    path = {'points': [[0, 0], [-5, 1]], 'period': 0.1}
    values = {'dt': 1e-3, 'method': 'newton', 'duration': 1.0}
    seen, other = (
        run('lateral_undulation', values, follow=path, rate=each) for each in (rate, 50.0)
    )
    assert (seen.position[-1] == other.position[-1]).all()


@pytest.mark.parametrize(
    ('gait', 'message'),
    [
        (Gait(yaw=Wave(amplitude=0.3)), 'its angular frequency is 0'),
        (Gait(table=Table.of([0.0, 1.0], np.zeros((2, 10, 2)))), 'a gait from a table'),
    ],
)
def test_gaits_that_cannot_follow_are_refused(gait, message):
    with pytest.raises(ParameterError, match=message):
        PathFollower(Following(), X_AXIS).start(Scene(gait=gait))


def test_a_period_that_steps_do_not_divide_is_named():
    with pytest.raises(ParameterError, match='dt must divide the period of the controller'):
        run(
            'lateral_undulation', dt=1e-3, follow={**PATHS['line'], 'period': 0.0105}, duration=0.1
        )
