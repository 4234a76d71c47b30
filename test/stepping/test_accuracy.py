# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The accuracy that is asked for is reached, and what cannot be reached is refused."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from snake_sim_ros import Friction, ParameterError, Robot, Scene, Simulation
from snake_sim_ros.commands.main import main
from snake_sim_ros.dynamics.joint_control import make_control_loop
from snake_sim_ros.nodes.sim_parameters import as_it_runs, Settings
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.accuracy import longest_step, path_tolerance, with_accuracy
from snake_sim_ros.stepping.methods import make_stepper, method_of
from snake_sim_ros.stepping.simulation import sample

PERIOD = 0.1  # of samples [s]
CYCLE = 4.5  # of the gait [s]
LENGTH = 0.122  # of a link [m]
CASE_A = load_scene('lateral_undulation')
CASE_B = load_scene('lateral_undulation_isotropic')


def path(scene):
    """Return the middle link every PERIOD for a CYCLE, (m, 2) [m], and the report."""
    simulation = Simulation(scene)
    steps, points = round(PERIOD / scene.dt), []
    for _ in range(round(CYCLE / PERIOD)):
        simulation.advance(*simulation.gait_reference(steps))
        points.append(simulation.state.q[scene.robot.middle_link, :2].copy())
    return np.array(points), simulation.report


@cache
def converged(scene):
    """Return the path with steps of 1/8000 s."""
    found, _ = path(replace(scene, method='bdf2', level='spatial', dt=1 / 8000))
    return found


def error(scene, accuracy):
    """Return the largest error of the path, relative to the distance from start to end."""
    found, report = path(with_accuracy(scene, accuracy, PERIOD))
    assert not report.failure and not report.unconverged
    expected = converged(scene)
    start = Simulation(scene).state.q[scene.robot.middle_link, :2]
    apart = np.linalg.norm(found - expected, axis=1).max()
    return apart / np.linalg.norm(expected[-1] - start)


@pytest.mark.parametrize('scene', [CASE_A, CASE_B], ids='AB')
def test_the_usual_accuracy_is_reached_in_a_cycle(scene):
    assert error(scene, 1e-3) < 1e-3


def test_a_smaller_accuracy_makes_a_smaller_error():
    # In space, where the converged path is: without roll the plane's own ends 7e-5 beside it.
    scene = replace(CASE_A, level='spatial')
    errors = [error(scene, accuracy) for accuracy in (1e-2, 1e-3, 1e-4)]
    assert errors[0] < 1e-2 and errors[2] < 1e-4
    assert errors[0] > 3 * errors[1] and errors[1] > 2 * errors[2]


def test_a_robot_that_hardly_moves_keeps_what_was_asked_for_as_well():
    # Its ends are 5 mm apart after a path of 0.1 m, over whose length errors are relative.
    robot = replace(CASE_A.robot, link_count=7)
    wave = replace(
        CASE_A.gait.yaw, amplitude=0.268, angular_frequency=2.127, phase_lag=0.083, phase=5.063
    )
    gait = replace(CASE_A.gait, yaw=wave, soft_start=0.5)
    friction = replace(CASE_A.friction, longitudinal=0.18, transversal=0.18)
    scene = replace(CASE_A, robot=robot, gait=gait, friction=friction)
    expected = converged(scene)
    length = np.linalg.norm(np.diff(expected, axis=0), axis=1).sum()
    for accuracy in (1e-2, 1e-3):
        found, _ = path(with_accuracy(scene, accuracy, PERIOD))
        assert np.linalg.norm(found - expected, axis=1).max() < accuracy * length


def gait_on_ice(links, friction, **gait):
    """Return a scene of Aiko's links on a slippery floor, 2 s long."""
    changed = {f'gait.{name}': value for name, value in gait.items()}
    friction = Friction(longitudinal=friction[0], transversal=friction[1])
    scene = Scene(robot=Robot(link_count=links), friction=friction, duration=2.0)
    return with_settings(scene, changed)


def largest_error(scene, settings, rate):
    """Return the largest distance of two paths over the length of one, with 1/rate s, or L."""
    exact = with_settings(
        scene, {'method': 'bdf2', 'level': 'spatial', 'dt': 1 / rate, **settings}
    )
    asked = with_accuracy(scene, scene.accuracy, 0.02)
    found, expected = (
        sample(Simulation(each), round(0.02 / each.dt), 100).path
        for each in (asked, replace(exact, accuracy=0.0))
    )
    length = np.linalg.norm(np.diff(expected, axis=0), axis=1).sum()
    return np.linalg.norm(found - expected, axis=1).max() / max(length, LENGTH)


def test_contacts_that_land_keep_what_was_asked_for():
    # A landed contact that kept a micrometer would take load from the others: 1.9e-3.
    yaw = {'amplitude': 0.513, 'angular_frequency': 2.164, 'phase_lag': 0.947, 'phase': 5.289}
    pitch = {'amplitude': 0.188, 'angular_frequency': 4.328, 'phase_lag': 0.192, 'phase': 2.662}
    waves = {f'{kind}.{name}': value for kind, wave in (('yaw', yaw), ('pitch', pitch))
             for name, value in wave.items()}  # fmt: skip
    scene = gait_on_ice(3, (0.0232, 0.091), soft_start=1.0, **waves)
    exact = {'solver.activation_tolerance': 1e-9, 'solver.residual_tolerance': 1e-12}
    assert largest_error(replace(scene, accuracy=1e-3), exact, 16000) < 1e-3


def test_the_planar_level_is_left_where_it_is_not_accurate_enough():
    # Without roll the plane's own path ends 3.8e-4 beside that in space.
    yaw = {'amplitude': 0.4934, 'angular_frequency': 2.327, 'phase_lag': -0.6647, 'phase': 3.595}
    scene = gait_on_ice(
        6, (0.0707, 0.1758), soft_start=0.5, **{f'yaw.{name}': yaw[name] for name in yaw}
    )
    assert 1e-4 < largest_error(replace(scene, accuracy=1e-2), {}, 8000) < 1e-2
    assert largest_error(replace(scene, accuracy=1e-4), {}, 8000) < 1e-4


def test_one_call_and_many_are_the_same_bit_for_bit():
    scene = with_accuracy(load_scene('sidewinding'), 1e-3, PERIOD)
    whole, single = Simulation(scene), Simulation(scene)
    whole.step_count = single.step_count = round(5.0 / scene.dt)
    whole.advance(*whole.gait_reference(20))
    for _ in range(20):
        single.advance(*single.gait_reference(1))
    np.testing.assert_array_equal(whole.state.q, single.state.q)
    np.testing.assert_array_equal(whole.state.u, single.state.u)


def test_steps_are_the_longest_that_divide_the_period_and_suit_the_gait():
    assert with_accuracy(Scene(), 1e-2, 0.1).dt == pytest.approx(1 / 20)
    for period in (1.0, 0.1, 1 / 30):
        assert with_accuracy(CASE_A, 1e-2, period).dt == pytest.approx(1 / 30)
    # A gait that is twice as fast needs references twice as often.
    assert longest_step(load_scene('sinus_lifting'), 1e-3) < 0.6 * longest_step(CASE_A, 1e-3)
    # So do better accuracies.
    assert longest_step(CASE_A, 1e-5) < longest_step(CASE_A, 1e-4) < longest_step(CASE_A, 1e-3)
    # A robot that holds still.
    assert longest_step(Scene(), 1e-6) == pytest.approx(1 / 20)


@pytest.mark.parametrize(
    ('loop', 'dt'),
    [
        ({'control_rate': 150.0}, 1 / 300),
        ({'reference_rate': 30.0}, 1 / 300),
        ({'command_delay': 0.013}, 1 / 1000),
        ({'control_rate': 250.0, 'command_delay': 0.003}, 1 / 1000),
        ({'control_rate': 50.0, 'command_delay': 0.02}, 1 / 100),
    ],
)
def test_steps_divide_the_periods_of_the_controllers_too(loop, dt):
    scene = with_accuracy(replace(CASE_A, robot=Robot(**loop)), 1e-3, 1 / 100)
    assert scene.dt == pytest.approx(dt, rel=1e-12)
    make_control_loop(scene)  # it raises if they do not


def test_periods_without_a_common_divisor_are_named():
    scene = replace(CASE_A, robot=Robot(command_delay=0.0123456))
    with pytest.raises(ParameterError) as caught:
        with_accuracy(scene, 1e-3, 1 / 100)
    assert str(caught.value) == (
        'periods must have a common divisor of at least 2.5e-05 s, or dt must be given, '
        'got sampling period 0.01 s, robot.command_delay 0.0123456 s'
    )
    assert with_accuracy(scene, 1e-3, 1 / 100, given=('dt',)).dt == scene.dt


def test_values_that_were_given_stay():
    scene = replace(CASE_A, dt=1 / 1000, level='planar')
    found = with_accuracy(scene, 1e-3, PERIOD, given=('dt',))
    assert (found.dt, found.level, found.method) == (scene.dt, 'planar', 'bdf2')
    assert found.solver.residual_tolerance > scene.solver.residual_tolerance


def test_sim_takes_the_steps_of_the_paper_unless_it_is_given_an_accuracy():
    settings = Settings(publish_rate=200)
    stops = {'robot.joint_stop': True, 'robot.rate_stop': True}
    assert as_it_runs(settings, CASE_A, {}) == with_settings(CASE_A, stops)
    assert as_it_runs(settings, CASE_A, stops) == CASE_A  # whose values were given
    scene = replace(CASE_A, accuracy=1e-3)
    found = as_it_runs(settings, scene, {'accuracy'})
    assert (found.dt, found.method, found.accuracy) == (pytest.approx(1 / 200), 'bdf2', 1e-3)
    found = as_it_runs(settings, scene, {'accuracy', 'dt', 'method'})
    assert (found.dt, found.method) == (scene.dt, scene.method)


def test_tolerance_follows_the_accuracy_and_the_size_of_the_robot():
    assert path_tolerance(CASE_A) == 0.0
    usual = path_tolerance(replace(CASE_A, accuracy=1e-3))
    assert path_tolerance(replace(CASE_A, accuracy=1e-2)) == pytest.approx(10**1.5 * usual)
    large = replace(CASE_A, robot=replace(CASE_A.robot, link_length=0.244, contact_offset=0.08))
    assert path_tolerance(replace(large, accuracy=1e-3)) == pytest.approx(2 * usual)


def test_auto_takes_the_method_that_divides_steps():
    scene = replace(CASE_A, method='auto')
    assert method_of(scene) == 'newton'
    assert method_of(replace(scene, accuracy=1e-3)) == 'bdf2'


@pytest.mark.parametrize('method', ['newton', 'paper'])
def test_methods_that_do_not_divide_steps_are_refused(method):
    with pytest.raises(ParameterError) as caught:
        make_stepper(replace(CASE_A, method=method, accuracy=1e-3))
    assert str(caught.value) == (
        f'accuracy 0.001 needs method bdf2, which divides steps, or auto; got method {method}'
    )


@pytest.mark.parametrize('pd_scheme', ['start', 'midpoint'])
def test_explicit_joint_control_is_refused(pd_scheme):
    with pytest.raises(ParameterError, match=f'pd_scheme {pd_scheme} is explicit'):
        make_stepper(replace(CASE_A, method='auto', accuracy=1e-3, pd_scheme=pd_scheme))


@pytest.mark.parametrize(
    ('value', 'sentence'),
    [
        (-1e-3, 'accuracy must be at least 0, got -0.001'),
        (float('nan'), 'accuracy must be finite, got nan'),
        (float('inf'), 'accuracy must be finite, got inf'),
        (0.2, 'accuracy must be at most 0.1, got 0.2'),
        ('fine', "accuracy must be a number, got 'fine'"),
    ],
)
def test_unusable_accuracies_are_refused_in_one_sentence(value, sentence, capsys):
    with pytest.raises(ParameterError) as caught:
        Scene(accuracy=value)
    assert str(caught.value) == sentence
    assert main(['run', 'lateral_undulation', '--set', f'accuracy={value}']) == 2
    told = capsys.readouterr().err
    assert told.count('\n') == 1 and 'accuracy must be' in told
