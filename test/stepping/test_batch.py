# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches of simulations: each has the bits that it has alone, whatever the others do."""

from dataclasses import astuple, replace

import numpy as np
import pytest
from scenes import references, same_bits

from snake_sim_ros import ParameterError, Simulation
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.batch import Batch

CASE_A, CASE_C = load_scene('lateral_undulation'), load_scene('sidewinding')


def are_same(one, other):
    """Check that two simulations are in the same state, and have had the same steps."""
    assert (one.state.q == other.state.q).all() and (one.state.u == other.state.u).all()
    assert same_bits(one.history, other.history)
    assert one.step_count == other.step_count
    for found in ((one.report, other.report), (one.last, other.last)):
        assert all(map(np.array_equal, *(astuple(replace(each, left='')) for each in found)))


def taken(scenes, angle, rate, count, threads=1):
    """Return a batch, and single simulations, after the same calls of some steps."""
    batch = Batch([Simulation(scene) for scene in scenes], threads)
    alone = [Simulation(scene) for scene in scenes]
    in_place = 0
    for k in range(0, angle.shape[1], count):
        part = angle[:, k : k + count], rate[:, k : k + count]
        batch.advance(*part)
        in_place += (batch._values == 1).sum()
        for i, simulation in enumerate(alone):
            simulation.advance(part[0][i], part[1][i])
            assert (batch.q[i] == simulation.state.q).all()
            assert (batch.u[i] == simulation.state.u).all()
            assert (batch.torque[i] == simulation.last.joint_torque).all()
            assert batch.unconverged[i] == simulation.report.unconverged
            assert batch.failed[i] == bool(simulation.report.failure)
    for i, simulation in enumerate(alone):
        are_same(batch.simulation(i), simulation)
    return batch, in_place / len(scenes) / (angle.shape[1] // count)


def scaled(scene, steps, factors):
    """Return references of the gait times factors, one for each simulation."""
    return (np.multiply.outer(factors, each) for each in references(scene, steps))


@pytest.mark.parametrize('threads', [1, 2])
@pytest.mark.parametrize(('method', 'dt', 'count'), [('newton', 1e-3, 10), ('bdf2', 0.02, 2)])
@pytest.mark.parametrize('scene', [CASE_A, CASE_C], ids=['A', 'C'])
def test_each_is_as_if_alone(scene, method, dt, count, threads):
    settings = {'method': method, 'dt': dt}
    icy = {**settings, 'friction.transversal': 0.1}
    scenes = [with_settings(scene, each) for each in (settings, icy, settings)]
    _, share = taken(scenes, *scaled(scenes[0], 20 * count, [1.0, 1.0, 0.5]), count, threads)
    assert share > 0.8


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_levels_change_one_by_one(method):
    scene = with_settings(CASE_A, {'method': method, 'dt': 1e-3, 'settling_time': 0.03})
    angle, rate = scaled(scene, 240, np.ones(3))
    angle[0, 40:43, 4, 1] = angle[2, 96:120, 4, 1] = 0.003
    _, share = taken([scene] * 3, angle, rate, 4)
    assert share > 0.7


def test_one_that_diverges_stops_alone():
    scene = with_settings(CASE_A, {'dt': 1e-3})
    angle, rate = scaled(scene, 40, np.ones(3))
    rate[1, 22] = 1e9
    batch, _ = taken([scene] * 3, angle, rate, 4)
    assert batch.failed.tolist() == [False, True, False]
    simulation = batch.simulation(1)
    simulation.reset()
    batch.put(1, simulation)
    assert not batch.failed.any()


def test_some_take_steps_and_others_wait():
    scene = with_settings(CASE_A, {'dt': 1e-3})
    batch, alone = Batch([Simulation(scene) for _ in range(3)]), Simulation(scene)
    angle, rate = scaled(scene, 40, np.ones(3))
    for k in range(0, 40, 4):
        part = angle[:, k : k + 4], rate[:, k : k + 4]
        batch.advance(*part, np.array([2, 0]))
        alone.advance(part[0][0], part[1][0])
    are_same(batch.simulation(0), alone)
    are_same(batch.simulation(2), alone)
    are_same(batch.simulation(1), Simulation(scene))


def test_calls_of_other_lengths_and_what_is_done_to_one():
    scene = with_settings(CASE_C, {'dt': 1e-3})
    batch, alone = Batch([Simulation(scene) for _ in range(2)]), Simulation(scene)
    angle, rate = scaled(scene, 40, np.ones(2))
    for first, last in ((0, 4), (4, 8), (8, 12), (12, 20), (20, 28), (28, 29), (29, 30), (30, 40)):
        part = angle[:, first:last], rate[:, first:last]
        if first == 20:
            batch.simulation(1).push(3, (0.0, 0.0, 0.1))
            alone.push(3, (0.0, 0.0, 0.1))
        batch.advance(*part)
        alone.advance(part[0][1], part[1][1])
    are_same(batch.simulation(1), alone)
    assert (batch.q[0] != batch.q[1]).any()


def test_pushes_act_in_their_steps():
    scene = with_settings(CASE_A, {'dt': 1e-3})
    batch, alone = Batch([Simulation(scene)]), Simulation(scene)
    angle, rate = scaled(scene, 80, np.ones(1))
    for k in range(0, 80, 4):
        if k == 20:
            for simulation in (batch.simulation(0), alone):
                simulation.pushes.begin(3, (0.0, 2.0, 0.0), duration=0.03)
        batch.advance(angle[:, k : k + 4], rate[:, k : k + 4])
        alone.advance(angle[0, k : k + 4], rate[0, k : k + 4])
    are_same(batch.simulation(0), alone)


def test_robots_of_other_lengths_are_refused():
    short = with_settings(CASE_A, {'robot.link_count': 5})
    with pytest.raises(ParameterError, match=r'the same number of links, got \[5, 11\]'):
        Batch([Simulation(CASE_A), Simulation(short)])
