# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs in time: references, sub-steps, recording, and runs that diverge."""

from dataclasses import replace

import numpy as np
import pytest
from random_states import random_parameters

from snake_sim_ros import ParameterError, Robot, Simulation
from snake_sim_ros.gaits.joint_reference import JointReference, start_posture
from snake_sim_ros.recording.recorded_runs import write_npz
from snake_sim_ros.scene.parameters import load_scene, scene_from_text, steps_in, with_settings
from snake_sim_ros.scene.posture import joint_angles, joint_rates
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.sampling import Hooks, joint_motion, Keep, LEAST_STEPS, Limits
from snake_sim_ros.stepping.simulation import sample, simulate
from snake_sim_ros.stepping.state import initial_state

LIMITS = Robot(link_count=3, joint_limit=0.7).limits


@pytest.fixture
def scene():
    return replace(load_scene('lateral_undulation'), duration=0.05)


def test_reference_is_extrapolated_for_the_horizon_and_then_held():
    # Joint 1: 0.1 rad and 2 rad/s at t = 1 s; joint 2 was told later and stands.
    stamp = np.array([[1.0, 1.0], [1.5, 1.5]])
    angle = np.array([[0.1, 0.0], [-0.2, 0.3]])
    rate = np.array([[2.0, -1.0], [0.0, 0.0]])
    reference = JointReference(stamp, angle, rate)
    times = np.array([1.0, 1.025, 1.05, 1.2])
    angles, rates = reference.sample(times, 0.05, LIMITS)
    # alpha = alpha_0 + rate * min(t - t_0, horizon)
    assert angles[:, 0, 0] == pytest.approx([0.1, 0.15, 0.2, 0.2], abs=1e-12)
    assert angles[:, 0, 1] == pytest.approx([0.0, -0.025, -0.05, -0.05], abs=1e-12)
    assert (angles[:, 1] == angle[1]).all()
    assert (rates[:2, 0] == rate[0]).all()
    assert (rates[3] == 0).all()
    assert (rates[:, 1] == 0).all()


def test_reference_is_extrapolated_up_to_the_joint_limit():
    axes = (2, 2)
    reference = JointReference(np.zeros(axes), np.full(axes, 0.6), np.full(axes, 10.0))
    angles, _ = reference.sample(np.array([0.005, 0.05]), 0.05, LIMITS)
    assert angles[:, 0, 0] == pytest.approx([0.65, 0.7], abs=1e-12)


def test_joint_motion_is_that_of_the_posture():
    rng = np.random.default_rng(5)
    p = random_parameters(rng, 44).reshape(4, 11, 4)
    q = np.concatenate([rng.uniform(-1, 1, (4, 11, 3)), p], axis=-1)
    u = rng.uniform(-1, 1, (4, 11, 6))
    angle, rate = joint_motion(Robot(), q, u)
    # Sums of a few products of numbers up to 1; an angle whose sine and cosine are both small
    # would lose more, and none of these has that.
    assert np.abs(angle - joint_angles(q)).max() < 1e-13
    assert np.abs(rate - joint_rates(q, u)).max() < 1e-14


def test_start_posture_is_the_gait_at_time_zero(scene):
    reference = start_posture(scene, now=3.0)
    # 30 degrees sin((i - 1) (-50 degrees))
    yaw = np.radians(30) * np.sin(np.arange(10) * np.radians(-50))
    assert reference.angle[:, 0] == pytest.approx(yaw, abs=1e-12)
    assert reference.angle[:, 1] == pytest.approx(0, abs=1e-12)
    assert (reference.stamp == 3.0).all()
    assert not reference.rate.any()


def test_steps_in_a_period():
    assert steps_in(1 / 200, 1 / 4000, 'publish period') == 20
    assert steps_in(15.0, 1 / 4000, 'duration') == 60000
    for period, dt in ((0.005, 0.0003), (1e-4, 1 / 4000), (0.00510, 0.00025)):
        with pytest.raises(ParameterError) as error:
            steps_in(period, dt, 'publish period')
        assert str(error.value) == (
            f'dt must divide the publish period: got dt={dt:g} s, period={period:g} s'
        )


def test_recording_has_all_samples_and_its_scene(scene, tmp_path):
    trajectory = simulate(scene)
    path = tmp_path / 'run.npz'
    write_npz(trajectory, path)
    with np.load(path) as data:
        shapes = {name: data[name].shape for name in data.files}
        text = str(data['scene'])
        time, quaternion = data['time'], data['orientation']
        joint_torque = data['joint_torque']
    # 0.05 s at 100 samples a second, and the start.
    m, n = 6, 11
    assert shapes == {
        'time': (m,),
        'position': (m, n, 3),
        'orientation': (m, n, 4),
        'joint_angle': (m, 2 * (n - 1)),
        'joint_velocity': (m, 2 * (n - 1)),
        'joint_torque': (m, 2 * (n - 1)),
        # 22 contacts at every sample but the first one.
        'contact_sample': (110,),
        'contact_number': (110,),
        'contact_point': (110, 3),
        'contact_force': (110, 3),
        'level': (m,),
        'format': (),
        'scene': (),
        'report': (),
        'seconds': (),
        'interrupted': (),
    }
    assert time == pytest.approx(np.arange(m) * 0.01, abs=1e-15)
    assert np.abs(np.linalg.norm(quaternion, axis=-1) - 1).max() < 1e-12
    assert scene_from_text(text) == scene
    assert not joint_torque[0].any()
    assert joint_torque[1:].any()


def test_samples_do_not_change_the_run(scene):
    coarse, fine = simulate(scene, rate=20.0), simulate(scene, rate=4000.0)
    assert (len(coarse.time), len(fine.time)) == (2, 201)
    assert (coarse.position[-1] == fine.position[-1]).all()
    assert (coarse.orientation[-1] == fine.orientation[-1]).all()
    assert (coarse.joint_velocity[-1] == fine.joint_velocity[-1]).all()
    assert (coarse.joint_torque[-1] == fine.joint_torque[-1]).all()
    assert coarse.report.iterations == fine.report.iterations


@pytest.mark.parametrize(
    ('rate', 'sentence'),
    [
        (0.0, 'rate must be above 0 Hz, got 0 Hz'),
        (-5.0, 'rate must be above 0 Hz, got -5 Hz'),
        (float('nan'), 'rate must be above 0 Hz, got nan Hz'),
        (float('inf'), 'dt must divide the sampling period: got dt=0.00025 s, period=0 s'),
        (300.0, 'dt must divide the sampling period: got dt=0.00025 s, period=0.00333333 s'),
        (8000.0, 'dt must divide the sampling period: got dt=0.00025 s, period=0.000125 s'),
        (10.0, 'duration must be a multiple of the sampling period, 1/10 s; got 0.05 s'),
    ],
)
def test_unusable_rates_are_refused(scene, rate, sentence):
    with pytest.raises(ParameterError) as error:
        simulate(scene, rate=rate)
    assert str(error.value) == sentence


def test_duration_that_is_no_multiple_of_the_sampling_period_is_refused(scene):
    # 0.055 s at 100 samples a second: half a period would be left out.
    with pytest.raises(ParameterError, match='duration'):
        simulate(replace(scene, duration=0.055))


def test_run_that_diverges_returns_what_was_good(scene):
    # With explicit damping a rate grows by K_d dt/Theta a step; 5 N m s/rad is far too much.
    trajectory = simulate(
        with_settings(scene, {'robot.yaw_damping': 5.0, 'pd_scheme': 'start'}), rate=1000.0
    )
    report = trajectory.report
    assert report.status is Status.DIVERGED
    assert report.failure.startswith(f't = {report.steps * scene.dt:g} s: ')
    assert 1 <= len(trajectory.time) <= 1 + report.steps // 4
    for name in ('position', 'orientation', 'joint_angle', 'joint_velocity', 'joint_torque'):
        values = getattr(trajectory, name)
        assert len(values) == len(trajectory.time)
        assert np.isfinite(values).all()


def test_diverged_simulation_waits_for_reset(scene):
    simulation = Simulation(with_settings(scene, {'robot.yaw_damping': 5.0, 'pd_scheme': 'start'}))
    angle = np.tile(start_posture(scene).angle + 0.1, (200, 1, 1))
    report = simulation.advance(angle, np.zeros_like(angle))
    assert report.failure
    state, count = simulation.state, simulation.step_count
    assert count == report.steps < 200
    assert np.isfinite(state.q).all()
    assert np.isfinite(state.u).all()
    simulation.advance(angle, np.zeros_like(angle))
    assert (simulation.step_count, simulation.state) == (count, state)
    simulation.reset()
    assert simulation.step_count == count
    assert simulation.report.status is Status.CONVERGED
    assert (simulation.state.q == initial_state(scene).q).all()
    assert not simulation.state.u.any()


def test_interruption_returns_what_was_recorded(scene):
    times = []

    def observe(simulation):
        times.append(simulation.time)
        if len(times) == 4:
            raise KeyboardInterrupt

    trajectory = simulate(scene, observe=observe)
    assert len(trajectory.time) == 4
    assert times == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert len(trajectory.position) == len(trajectory.joint_torque) == 4


def test_an_interruption_is_raised_where_nobody_waits_for_a_part(scene):
    def observe(simulation):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sample(Simulation(scene), 40, 5, hooks=Hooks(observe=observe))


def test_a_sampler_keeps_what_it_is_asked_for(scene):
    simulation = Simulation(scene)
    kept = sample(simulation, 1, 40, keep=Keep(contacts=True, impulses=True))
    assert kept.velocity.shape == (41, 11, 6)
    assert kept.impulse.shape == (41, 22, 5)
    assert not kept.impulse[0].any()  # no step has been
    assert np.array_equal(kept.impulse[-1], simulation.history.impulse)
    sampled, numbers = np.nonzero(kept.impulse[:, :, 0] > 0.0)
    assert np.array_equal(kept.contact_sample, sampled)
    assert np.array_equal(kept.contact_number, numbers)
    states = sample(Simulation(scene), 40, 1)
    assert np.array_equal(states.coordinates, kept.coordinates[::40])
    assert not states.impulse.size
    assert not states.contact_sample.size


def test_every_second_sample_is_a_record_of_its_own(scene):
    whole = sample(Simulation(scene), 20, 5, keep=Keep(contacts=True, impulses=True))
    half = whole.every(2)
    half.check()
    assert half.time == pytest.approx([0.0, 0.01, 0.02])
    for name in ('position', 'joint_torque', 'velocity', 'impulse', 'level'):
        assert np.array_equal(getattr(half, name), getattr(whole, name)[::2])
    for k in range(3):
        for ours, theirs in zip(half.contacts(k), whole.contacts(2 * k), strict=True):
            assert np.array_equal(ours, theirs)


def test_a_run_ends_at_a_limit(scene):
    # One iteration is too few for nearly every step, and a call takes 25 of them. Wrong impulses
    # lift the robot, and a step without contact forces converges.
    scene = with_settings(scene, {'level': 'spatial', 'solver.iteration_limit': 1})
    scene = replace(scene, method='paper')
    cut = sample(Simulation(scene), 20, 50, limits=Limits(unconverged=30))
    assert (len(cut.time), cut.report.steps) == (3, 50)
    assert 30 <= cut.report.unconverged <= 50
    late = sample(Simulation(scene), 20, 50, limits=Limits(seconds=1e-9))
    assert (len(late.time), late.report.steps) == (1, LEAST_STEPS)  # of one call
    assert late.seconds > 1e-9


def test_a_gait_that_changes_while_it_is_sampled_is_followed(scene):
    # References are computed for many steps at once.
    faster = with_settings(scene, {'gait.yaw.angular_frequency': 5.0})

    def observe(simulation):
        if simulation.step_count == 40:
            simulation.change(faster)

    found = sample(Simulation(scene), 40, 3, hooks=Hooks(observe=observe))
    expected = Simulation(scene)
    expected.advance(*expected.gait_reference(40))
    expected.change(faster)
    expected.advance(*expected.gait_reference(80))
    assert np.array_equal(found.coordinates[-1], expected.state.q)
