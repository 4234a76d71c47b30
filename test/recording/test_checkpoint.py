# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A simulation that goes on from a file takes the same steps, to the bit."""

from dataclasses import replace
import re
import subprocess
import sys

import numpy as np
import pytest
from scenes import same_bits

from snake_sim_ros import ParameterError, Simulation
from snake_sim_ros.recording import checkpoint
from snake_sim_ros.recording.recorded_runs import write_npz
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.methods import make_stepper, METHODS
from snake_sim_ros.stepping.simulation import simulate

STEPS = 6
LEVELS = ('spatial', 'planar', 'auto')
PROGRAM = """
import sys
from pathlib import Path
from snake_sim_ros.recording import checkpoint
simulation = checkpoint.read(Path(sys.argv[1]))
simulation.advance(*simulation.gait_reference(20))
checkpoint.write(simulation, Path(sys.argv[2]))
"""


def moving(method='newton', level='spatial', **settings):
    """Return a short robot after some steps, which need not converge."""
    few = {'robot.link_count': 3, 'solver.iteration_limit': 100, 'dt': 1 / 2000}
    settings = {**few, 'method': method, 'level': level, **settings}
    simulation = Simulation(with_settings(load_scene('lateral_undulation'), settings))
    simulation.advance(*simulation.gait_reference(STEPS))
    assert simulation.report.steps == STEPS
    return simulation


@pytest.mark.parametrize('level', LEVELS)
@pytest.mark.parametrize('method', METHODS)
def test_it_goes_on_to_the_bit(method, level, tmp_path):
    path, simulation = tmp_path / 'here.npz', moving(method, level)
    checkpoint.write(simulation, path)
    other = checkpoint.read(path)
    assert (other.scene, other.step_count) == (simulation.scene, STEPS)
    assert same_bits(other.history, simulation.history)
    for each in (simulation, other):
        each.advance(*each.gait_reference(STEPS))
    assert (other.state.q == simulation.state.q).all()
    assert (other.state.u == simulation.state.u).all()
    assert same_bits(other.history, simulation.history)
    assert other.report.iterations == simulation.report.iterations
    assert other.report.steps == simulation.report.steps > STEPS


def test_it_goes_on_in_another_process(tmp_path):
    # A method with a memory, at a level with one, in the middle of a change of levels.
    simulation = moving('bdf2', 'auto')
    angle, rate = simulation.gait_reference(3)
    angle[:, 0, 1] = 0.01
    simulation.advance(angle, rate)
    assert simulation.report.left and simulation.history.settling[0] > 0
    here, there = tmp_path / 'here.npz', tmp_path / 'there.npz'
    checkpoint.write(simulation, here)
    command = [sys.executable, '-c', PROGRAM, str(here), str(there)]
    subprocess.run(command, check=True, timeout=100)
    other = checkpoint.read(there)
    simulation.advance(*simulation.gait_reference(20))
    assert (other.state.q == simulation.state.q).all()
    assert (other.state.u == simulation.state.u).all()
    assert same_bits(other.history, simulation.history)


@pytest.fixture(scope='module')
def stored(tmp_path_factory):
    path = tmp_path_factory.mktemp('checkpoints') / 'here.npz'
    checkpoint.write(moving('bdf2'), path)
    with np.load(path) as file:
        return {name: file[name] for name in file.files}


@pytest.mark.parametrize(
    ('changes', 'sentence'),
    [
        ({'checkpoint': None}, 'is not a checkpoint'),
        ({'checkpoint': 2}, 'is a checkpoint in format 2, of another version .*; this one reads'),
        ({'checkpoint': 'x'}, 'is a checkpoint in format 0'),
        ({'state.u': None}, "is not a whole checkpoint: it has no 'state.u'"),
        ({'history.memory.span': None}, "has no 'history.memory.span'"),
        ({'state.q': np.zeros((2, 7))}, r'state.q must be an array of shape \(3, 7\)'),
        ({'history.impulse': np.full((6, 5), np.nan)}, 'history.impulse must be finite, got nan'),
        (
            {'history.memory.reference_rate': np.zeros(2)},
            r'history.memory.reference_rate must be an array of shape',
        ),
        ({'history.memory.ticks': np.array([0.5])}, 'history.memory.ticks cannot be 0.5'),
        ({'history.memory.phase': np.array([7.0])}, 'history.memory.phase cannot be 7'),
        ({'history.memory.dt': np.array([0.0])}, 'history.memory.dt must be above 0 s'),
        ({'history.settling': np.array([-1.0])}, 'history.settling cannot be -1'),
        ({'report': '{"joint_torque": [[0.0, 0.0]]}'}, r'joint_torque .* shape \(2, 2\), got'),
        ({'step_count': -1}, 'step_count must be a whole number, at least 0, got -1'),
        ({'step_count': 1.5}, 'step_count must be a whole number, at least 0, got 1.5'),
        ({'scene': 'frictoin: {}'}, "scene: unknown key 'frictoin'"),
        ({'scene': 7}, 'is not a whole checkpoint'),
        ({'report': '{"stepz": 1}'}, 'is not a whole checkpoint'),
    ],
)
def test_what_is_no_checkpoint_gets_a_sentence(stored, tmp_path, changes, sentence):
    path, data = tmp_path / 'other.npz', stored | changes
    np.savez(path, **{name: value for name, value in data.items() if value is not None})
    with pytest.raises(ParameterError, match=sentence) as caught:
        checkpoint.read(path)
    assert str(path) in str(caught.value)


def test_a_place_in_a_queue_is_in_the_queue(tmp_path):
    path = tmp_path / 'here.npz'
    checkpoint.write(moving(**{'robot.command_delay': 0.01}), path)
    with np.load(path) as file:
        data = dict(file)
    assert checkpoint.read(path).history.control.next[0] == data['history.control.next'][0] > 0
    for place in (21.0, -1.0, 1.5, 1e9):
        np.savez(path, **{**data, 'history.control.next': np.array([place])})
        with pytest.raises(
            ParameterError, match=re.escape(f'history.control.next cannot be {place:g}')
        ):
            checkpoint.read(path)


def test_files_of_others_get_a_sentence(stored, tmp_path):
    with pytest.raises(ParameterError, match='no file'):
        checkpoint.read(tmp_path / 'none.npz')
    path = tmp_path / 'half.npz'
    np.savez(path, **stored)
    path.write_bytes(path.read_bytes()[:500])
    with pytest.raises(ParameterError, match=r'is not a whole npz file; checkpoint\.write writes'):
        checkpoint.read(path)
    write_npz(simulate(replace(load_scene('lateral_undulation'), duration=0.01)), path)
    with pytest.raises(ParameterError, match='is not a checkpoint'):
        checkpoint.read(path)


def test_a_stepper_of_the_caller_is_refused(tmp_path):
    scene = replace(load_scene('lateral_undulation'), level='spatial')
    with pytest.raises(ParameterError, match='has a SpatialStepper made by the caller'):
        checkpoint.write(Simulation(scene, make_stepper(scene)), tmp_path / 'here.npz')
