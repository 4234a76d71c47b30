# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the planar level leaves out, rolling: that it is all, and when it is too much."""

from dataclasses import replace
import math

import numpy as np
from oracle import empty_history, make_stepper, ORACLE
import pytest
from scenes import course, first_steps, references, same_bits

from snake_sim_ros import Friction, Gait, Robot, Scene, Solver, Wave
from snake_sim_ros.dynamics.kinematics import STILL_SPEED
from snake_sim_ros.gaits.joint_reference import start_posture
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.scene.posture import center_of_mass
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping import levels
from snake_sim_ros.stepping.base import Status
from snake_sim_ros.stepping.planar.model import ROLL_LIMIT, SLIP_SHARE
from snake_sim_ros.stepping.state import initial_state

RADIUS = 0.0525
DT = 1 / 2000


def on_ice(link_count, **settings):
    """Return a scene in which friction moves the robot by little more than rolling shifts it."""
    wave = Wave(
        amplitude=math.radians(19),
        angular_frequency=8.0,
        phase_lag=math.radians(104),
        phase=2.22,
        offset=math.radians(6),
    )
    given = {
        'robot': Robot(link_count=link_count),
        'friction': Friction(longitudinal=0.040, transversal=0.045),
        'gait': Gait(yaw=wave),
        'drift_correction': 'center_of_mass',
        'dt': DT,
        'duration': 4.0,
    }
    return Scene(**{**given, **settings})


def path(scene, level, push=0.0, every=0.02):
    """Return centers of mass (m, 3) and the last report; `push` is a speed of link 1 at first."""
    start = initial_state(scene)
    start.u[0, 0] += push
    steps, part = round(scene.duration / scene.dt), round(every / scene.dt)
    states, _, report = course(replace(scene, level=level), start, steps, part)
    return center_of_mass(scene.robot, states.q), report


def length(points):
    """Return the length of a path [m]."""
    return np.linalg.norm(np.diff(points, axis=0), axis=1).sum()


def distance(points, others):
    """Return the largest distance of two paths at any time [m]."""
    return np.linalg.norm(points - others, axis=1).max()


def promised(way):
    """
    Return how far the paths of auto and of the spatial level may be apart [m].

    Before auto leaves the plane, it has left out the slip of a roll of ROLL_LIMIT and
    AUTO_SLIP_SHARE of its way. As far again the robot slips when it then rolls in space.
    """
    return 2.0 * (RADIUS * ROLL_LIMIT + levels.AUTO_SLIP_SHARE * way)


# ---- what is left out ---------------------------------------------------------------------------


def test_the_plane_is_the_limit_of_stiff_pitch_joints():
    # Nothing but rolling is left out: with it the difference falls as the stiffness rises. The
    # compliance falls with the roll, so that joints and floor share loads as before.
    def scene_of(factor):
        robot = Robot(link_count=5, pitch_stiffness=800.0 * factor, pitch_damping=0.2 * factor)
        solver = Solver(normal_compliance=1e-4 / factor)
        return on_ice(5, robot=robot, solver=solver, duration=1.0, dt=1 / 1000)

    flat, report = path(scene_of(64), 'planar')
    assert report.status is Status.CONVERGED
    apart = [distance(path(scene_of(f), 'spatial')[0], flat) / length(flat) for f in (1, 4, 16)]
    # 6.0e-3 and 2.3e-3 were measured for the last two. While joints are soft the roll also swings.
    assert apart[0] > 1e-2
    assert apart[1] < apart[0] / 2
    assert apart[2] < apart[1] / 2


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_the_roll_is_that_of_the_robot_in_space(method):
    # Under way in A, where it changes slowly: in space it lags by what inertia makes, a part in a
    # hundred. `bdf2` finds the loads of two thirds of a step.
    scene = replace(load_scene('lateral_undulation'), method=method, dt=1 / 1000)
    angle, rate = references(scene, 600)
    start = initial_state(scene)
    _, history, _ = first_steps(replace(scene, level='planar'), start, angle, rate)
    state, _, _ = first_steps(replace(scene, level='spatial'), start, angle, rate)
    roll = np.arcsin(rotation_matrices(state.q[:, 3:])[:, 2, 0])
    largest = math.copysign(np.abs(roll).max(), roll[5])
    assert abs(largest) > 2e-5
    assert history.memory.roll[0] == pytest.approx(largest, rel=0.02)


# ---- when it is too much ------------------------------------------------------------------------


def test_slip_and_way_are_summed_up():
    # One link after another: slip is the radius times the change of the roll, way that of the
    # center of mass, both fading; whatever the calls are.
    scene = on_ice(5, level='planar', duration=0.1)
    angle, rate = references(scene, 200)
    stepper, state, history = make_stepper(scene), initial_state(scene), empty_history(scene)
    mass = scene.robot.per_link('link_mass')
    slip = way = roll = 0.0
    for k in range(200):
        state, history, _ = stepper.advance(state, history, angle[k : k + 1], rate[k : k + 1])
        last, memory = roll, history.memory
        roll = memory.roll[0]
        left = 1.0 / (1.0 + scene.dt / 3.0)
        slip = left * slip + RADIUS * abs(roll - last)
        way = left * way + scene.dt * np.linalg.norm(mass @ state.u[:, :2]) / mass.sum()
    assert slip > 1e-6 and way > 1e-4
    assert memory.slip[0] == pytest.approx(slip, rel=1e-12)
    assert memory.way[0] == pytest.approx(way, rel=1e-9)
    _, whole, _ = make_stepper(scene).advance(
        initial_state(scene), empty_history(scene), angle, rate
    )
    assert same_bits(whole, history)


@pytest.mark.parametrize('method', ['newton', ORACLE])
def test_the_planar_level_says_when_it_slips_too_far(method):
    # The history of a robot that has slipped nearly as far as is left out, or more, and rests.
    scene = on_ice(3, level='planar', method=method)
    angle = start_posture(scene).angle[None]
    history = empty_history(scene)

    def step(slip, way):
        history.memory.slip[0], history.memory.way[0] = slip * RADIUS * ROLL_LIMIT, way
        stepper = make_stepper(scene)
        return stepper.advance(initial_state(scene), history, angle, np.zeros(angle.shape))

    assert step(0.9, 0.0)[2].status is Status.CONVERGED
    end, _, report = step(1.1, 0.0)
    assert report.failure == (
        'level planar: rolling would shift the robot by more than 0.5 % of its way; choose level '
        'spatial or auto'
    )
    assert report.steps == 0
    assert (end.q == initial_state(scene).q).all()
    # Who has come far may slip farther.
    assert step(1.1, 0.2 * RADIUS * ROLL_LIMIT / SLIP_SHARE)[2].status is Status.CONVERGED


@pytest.mark.parametrize('chunk', [1, 7, 400])
def test_auto_comes_back_after_a_pause(chunk, monkeypatch):
    monkeypatch.setattr(levels, 'SLIP_PAUSE', 0.04)
    scene = on_ice(5, settling_time=0.02)
    history = empty_history(scene)
    history.memory.planar.slip[0] = 1.1 * RADIUS * ROLL_LIMIT
    state, stepper = initial_state(scene), make_stepper(scene)
    hold = np.tile(start_posture(scene).angle, (400, 1, 1))
    taken = []
    for k in range(0, 400, chunk):
        told = hold[k : k + chunk]
        state, history, report = stepper.advance(state, history, told, np.zeros(told.shape))
        assert report.status is Status.CONVERGED
        taken.append((report.planar_steps, report.steps, report.left))
    assert taken[0][2] == 'rolling would shift the robot by more than 0.2 % of its way' * (
        chunk < 400
    )
    # It lies flat and still all the time: 80 steps of the pause, and 40 to settle.
    assert sum(planar for planar, _, _ in taken) == 400 - 120
    assert np.abs(state.u).max() < STILL_SPEED
    assert history.settling[0] == 0


# ---- and then it is right -----------------------------------------------------------------------


@pytest.mark.parametrize('link_count', [3, 4, 5, 8])
def test_auto_on_ice_is_where_the_spatial_level_is(link_count):
    # 3, 4, 5 links were 3 % off at the planar level.
    scene = on_ice(link_count)
    space, _ = path(scene, 'spatial')
    auto, report = path(scene, 'auto')
    assert report.status is Status.CONVERGED
    assert 0 < report.planar_steps < report.steps
    assert distance(auto, space) <= promised(length(space))


def slippery(seed):
    """Return a random robot and gait on a slippery floor."""
    rng = np.random.default_rng([seed, 15])
    draw = rng.uniform
    link_count, along = int(rng.integers(2, 12)), draw(0.02, 0.1)
    wave = Wave(
        amplitude=math.radians(draw(8, 32)),
        angular_frequency=draw(2, 9),
        phase_lag=math.radians(draw(-180, 180)),
        phase=draw(0, 2 * math.pi),
        offset=math.radians(draw(-10, 10)),
    )
    friction = Friction(longitudinal=along, transversal=along * draw(1, 3))
    return on_ice(link_count, friction=friction, gait=Gait(yaw=wave), dt=1 / 4000)


# Without 4, which is sensitive: it says nothing of levels.
@pytest.mark.parametrize('seed', [0, 1, 2, 3, 5])
def test_auto_on_random_ice_is_where_the_spatial_level_is(seed):
    scene = slippery(seed)
    space, _ = path(scene, 'spatial')
    way = length(space)
    assert distance(path(scene, 'spatial', push=1e-9)[0], space) <= 1e-6 * way
    auto, report = path(scene, 'auto')
    assert report.status is Status.CONVERGED
    # Each has the error of its steps besides, of first order: twice what halving them changes.
    error = 2.0 * distance(path(replace(scene, dt=scene.dt / 2), 'spatial')[0], space)
    assert distance(auto, space) <= promised(way) + 2.0 * error


# ---- the smaller of two exact levels ------------------------------------------------------------


@pytest.mark.parametrize(
    'settings',
    [
        {'method': 'bdf2', 'dt': 1 / 20},
        {'method': 'auto', 'dt': 1 / 100},
        {'method': 'newton', 'dt': 1 / 100},
        {'method': 'bdf2', 'dt': 1 / 500, 'robot.link_count': 20},
    ],
)
def test_auto_takes_the_plane_whatever_the_step(settings):
    scene = with_settings(load_scene('lateral_undulation'), settings)
    assert make_stepper(scene).level == 'planar'
