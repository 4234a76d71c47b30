# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Steering: what a gait must be for a speed and a turning rate, and what the robot makes of it."""

from dataclasses import replace
import math
from pathlib import Path

import numpy as np
import pytest
from random_states import EPS

from snake_sim_ros import Gait, Robot, run, Scene, Simulation, Wave
from snake_sim_ros.gaits import sidewinding_turns as turns
from snake_sim_ros.gaits.blending import Blend, check_limits, largest_frequency
from snake_sim_ros.gaits.steering import SIDEWAYS, Steering, Stride
from snake_sim_ros.scene.files import parse_yaml
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.studies.metrics import turning as turning_of
from snake_sim_ros.studies.study import run_study, study_from

ROBOT = Robot()
STRIDE = 0.5  # m
UNDULATION, SINUS_LIFTING = (
    load_scene(name).gait for name in ('lateral_undulation', 'sinus_lifting')
)


def steered(speed, turning, gait=UNDULATION):
    return Steering(speed, turning).gait(gait, ROBOT, Stride(STRIDE))


def most_cycle(gait):
    """Return the largest yaw frequency that keeps the ratio of both [rad/s]."""
    return min(
        largest_frequency(ROBOT, axis, wave.amplitude) / abs(wave.angular_frequency)
        for axis, wave in (('yaw', gait.yaw), ('pitch', gait.pitch))
        if wave.angular_frequency
    ) * abs(gait.yaw.angular_frequency)


def test_speed_is_stride_times_frequency_and_waves_keep_their_ratio():
    gait, remarks = steered(0.1, 0.0, SINUS_LIFTING)
    assert not remarks
    # 0.2 cycles a second
    assert gait.yaw.angular_frequency == pytest.approx(0.4 * math.pi, rel=4 * EPS)
    assert gait.pitch.angular_frequency == pytest.approx(0.8 * math.pi, rel=4 * EPS)
    back, _ = steered(-0.1, 0.0, SINUS_LIFTING)
    assert back.yaw.angular_frequency == -gait.yaw.angular_frequency
    assert replace(back.pitch, angular_frequency=0.0) == replace(
        SINUS_LIFTING.pitch, angular_frequency=0.0
    )


def test_a_wave_that_runs_to_the_head_is_turned_round():
    # The same robot in a mirror of time: link 1 goes ahead when omega is negative.
    mirrored = Gait(yaw=replace(UNDULATION.yaw, phase_lag=-UNDULATION.yaw.phase_lag))
    gait, _ = steered(0.1, 0.05, mirrored)
    assert gait.yaw.angular_frequency == -steered(0.1, 0.05)[0].yaw.angular_frequency
    assert gait.yaw.offset == steered(0.1, 0.05)[0].yaw.offset


@pytest.mark.parametrize('speed', [0.1, -0.1])
def test_turning_is_speed_times_curvature(speed):
    gait, remarks = steered(speed, 0.2)
    assert not remarks
    # Curvature 2/m times the length of a link, to the left: against the angles of the joints.
    assert gait.yaw.offset == pytest.approx(-math.copysign(2.0 * 0.122, speed), rel=4 * EPS)
    assert gait.yaw.amplitude == UNDULATION.yaw.amplitude
    assert steered(speed, -0.2)[0].yaw.offset == -gait.yaw.offset


def test_stopping_fades_both_waves_out():
    for gait, remarks in (steered(0.0, 0.0, SINUS_LIFTING), steered(-0.0, 0.0, SINUS_LIFTING)):
        assert not remarks
        for wave in (gait.yaw, gait.pitch):
            assert (wave.amplitude, wave.angular_frequency, wave.offset) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ('speed', 'turning', 'gait', 'sentence'),
    [
        (
            *(0.0, 0.3, UNDULATION),
            'cmd_vel: angular.z 0.3 rad/s needs a linear.x that is not 0: a robot that follows '
            'its own path does not turn in place; it stops',
        ),
        (
            *(0.2, 0.0, Gait(yaw=Wave(amplitude=0.3))),
            'cmd_vel: a gait whose frequencies are 0 does not move; it stops',
        ),
        (
            *(2.0, 0.0, UNDULATION),
            'cmd_vel: linear.x 2 m/s is more than 0.6755 m/s, which the stride and the largest '
            'frequency, 8.488 rad/s, make; clamped',
        ),
        (
            *(0.1, -0.5, UNDULATION),
            'cmd_vel: angular.z -0.5 rad/s at linear.x 0.1 m/s needs a yaw offset of 0.61 rad; '
            'clamped to 0.2618 rad, the joint limit less the amplitude',
        ),
    ],
)
def test_what_cannot_be_done_is_said(speed, turning, gait, sentence):
    result, remarks = steered(speed, turning, gait)
    assert list(remarks.values()) == [sentence]
    check_limits(result, ROBOT)


def test_a_robot_that_is_too_fast_keeps_its_path():
    slow, _ = steered(0.3, 0.2)
    fast, _ = steered(3.0, 2.0)
    assert fast.yaw.offset == pytest.approx(slow.yaw.offset, rel=4 * EPS)


def test_whatever_is_asked_the_joints_follow_as_far_as_they_can():
    # Frequency and offset are those of the closed forms above, up to the limits of the joints.
    rng = np.random.default_rng(1)
    for _ in range(300):
        speed, turning = rng.choice([-1, 1], 2) * 10 ** rng.uniform(-308, 308, 2)
        speed, turning = float(speed), float(turning)
        for gait in (UNDULATION, SINUS_LIFTING):
            found = steered(speed, turning, gait)[0]
            check_limits(found, ROBOT)
            cycle = min(abs(2 * math.pi * speed / STRIDE), most_cycle(gait))
            cycle = math.copysign(cycle, speed)
            room = ROBOT.joint_limit - gait.yaw.amplitude
            offset = min(max(-0.122 * turning / speed, -room), room)
            assert found.yaw.angular_frequency == pytest.approx(cycle, rel=8 * EPS)
            assert found.yaw.offset == pytest.approx(offset, rel=8 * EPS)


@pytest.mark.parametrize(('speed', 'turning'), [(0.15, 0.0), (0.1, 0.1), (-0.1, 0.1)])
def test_a_simulated_robot_moves_and_turns_as_it_is_steered(speed, turning):
    scene = with_settings(load_scene('lateral_undulation'), {'dt': 1 / 1000})
    gait, _ = Steering(speed, turning).gait(scene.gait, scene.robot, Stride(0.546))
    blend = Blend.of(scene.gait, 10, 1.0).changed(0.0, gait)
    simulation = Simulation(scene)
    cycle = round(2 * math.pi / abs(gait.yaw.angular_frequency) / 0.01)
    states = []
    for _ in range(300 + 2 * cycle):  # 3 s to get going, then two cycles
        assert not simulation.advance(*blend.reference(simulation.midpoints(10))).failure
        states.append(simulation.state.q)
    q = np.array(states)
    backward = rotation_matrices(q[:, :, 3:])[..., 2].mean(axis=1)  # from the head to the tail
    heading = np.unwrap(np.arctan2(-backward[:, 1], -backward[:, 0]))

    def mean(values):  # over a cycle
        return np.convolve(values, np.full(cycle, 1 / cycle), 'valid')[300:]

    heading, (x, y) = mean(heading), (mean(q[:, :, k].mean(axis=1)) for k in (0, 1))
    seconds = 0.01 * (len(heading) - 1)
    ahead = np.diff(x) * np.cos(heading[1:]) + np.diff(y) * np.sin(heading[1:])
    # The contacts slip: in bends by 8 % in speed and 10 % in turning, see the module.
    assert ahead.sum() / seconds == pytest.approx(speed, rel=0.12 if turning else 0.02)
    assert (heading[-1] - heading[0]) / seconds == pytest.approx(turning, rel=0.12, abs=1e-3)


@pytest.mark.parametrize('tiny', [5e-324, -1e-310, 1e-300, 1e-30])
@pytest.mark.parametrize('speed', [5e-324, 0.1, -0.1, 1e300])
def test_a_wave_with_next_to_no_frequency_stands_still(tiny, speed):
    # The other wave makes the cycle; without one the robot stops.
    cycle = 2 * math.pi * abs(speed) / STRIDE
    for frequencies in ((tiny, 0.0), (tiny, 3.0), (3.0, tiny), (0.0, tiny), (tiny, tiny)):
        waves = (
            replace(wave, angular_frequency=value)
            for wave, value in zip(
                (SINUS_LIFTING.yaw, SINUS_LIFTING.pitch), frequencies, strict=True
            )
        )
        shape = replace(SINUS_LIFTING, **dict(zip(('yaw', 'pitch'), waves, strict=True)))
        for turning in (0.0, 1e300, -5e-324):
            gait, _ = steered(speed, turning, shape)
            check_limits(with_settings(Scene(gait=gait), {}).gait, ROBOT)
            found = gait.yaw.angular_frequency, gait.pitch.angular_frequency
            wanted = [
                math.copysign(min(cycle, largest_frequency(ROBOT, axis, wave.amplitude)), speed)
                * (value == 3.0)
                for (axis, wave), value in zip(
                    (('yaw', shape.yaw), ('pitch', shape.pitch)), frequencies, strict=True
                )
            ]
            assert found == pytest.approx(wanted, rel=8 * EPS, abs=1e-29)
            assert (gait.yaw.amplitude > 0.0) == (3.0 in frequencies)


def turning_rate(speed, turning, friction, side=1.0):
    """Return the turning rate of sidewinding that is steered, over 4 of its cycles [rad/s]."""
    scene = load_scene('sidewinding')
    coefficients = {'friction.longitudinal': friction, 'friction.transversal': friction}
    phase = {'gait.pitch.phase': side * scene.gait.pitch.phase}
    scene = with_settings(scene, coefficients | phase)
    steering = Steering(speed, turning)
    stride = Stride.of(scene.gait, scene.friction)
    gait, remarks = steering.gait(scene.gait, scene.robot, stride)
    assert not remarks
    cycle = 2 * math.pi / abs(gait.yaw.angular_frequency)
    duration = math.ceil(scene.gait.soft_start + 5 * cycle)
    moved = run(replace(scene, gait=gait), duration=float(duration), rate=50)
    return turning_of(moved.between(duration - 4 * cycle, duration))


@pytest.mark.parametrize('seed', range(4))
def test_sidewinding_turns_as_it_is_steered(seed):
    # Speeds, friction and curvatures within the ranges that docs/controllers.md states.
    rng = np.random.default_rng(seed)
    speed, friction = float(rng.uniform(0.05, 0.15)), float(rng.uniform(0.14, 0.26))
    turning = speed * float(rng.choice([-1.0, 1.0]) * rng.uniform(0.35, 0.8))
    side = float(rng.choice([-1.0, 1.0]))
    assert turning_rate(speed, turning, friction, side) == pytest.approx(turning, rel=0.1)


@pytest.mark.parametrize(('speed', 'friction'), [(0.06, 0.25), (0.11, 0.15)])
def test_sidewinding_keeps_its_heading(speed, friction):
    assert abs(turning_rate(speed, 0.0, friction)) < 0.02 * speed / SIDEWAYS


def test_the_map_of_turns_is_that_of_its_study():
    pytest.importorskip('polars')  # of studies
    path = Path(__file__).parents[2] / 'examples' / 'sidewinding_turning.yaml'
    study = parse_yaml(path.read_text(encoding='utf-8'))
    frictions, frequencies, gradients = study['vary'].values()
    assert frictions == turns.FRICTIONS.tolist()
    assert gradients == turns.GRADIENTS.tolist()
    speeds = SIDEWAYS * np.array(frequencies) / (2 * math.pi)
    assert speeds == pytest.approx(turns.SPEEDS, rel=1e-4)
    # One of its rows: friction 0.2, 0.1 m/s, gradient 0.25; rounded to three digits.
    study['vary'] = dict(zip(study['vary'], ([0.2], [frequencies[2]], [0.25]), strict=True))
    frame = run_study(study_from(study))
    turn = frame['turning_rate'][0] * 2 * math.pi / frequencies[2]
    assert turn == pytest.approx(turns.TURNS[2, 2, 6], abs=5e-4 + 1e-6)
