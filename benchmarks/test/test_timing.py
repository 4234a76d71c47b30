# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Times of steps and of start-up."""

import math
import os
import platform
import subprocess

import pytest

from snake_sim_benchmarks.comparison import timing
from snake_sim_ros import Robot, Scene
from snake_sim_ros.dynamics import compilation


@pytest.fixture
def elsewhere(monkeypatch):
    monkeypatch.setattr(timing, 'COUNTS_CYCLES', False)
    monkeypatch.setattr(platform, 'machine', lambda: 'aarch64')


def test_times_of_steps_are_left_out_with_a_sentence(elsewhere):
    assert math.isnan(timing.tick_length(1.0, 0))
    assert timing.note_on_step_times().endswith('this is aarch64')


def test_times_of_steps_need_no_sentence_here():
    assert bool(timing.note_on_step_times()) != compilation.COUNTS_CYCLES
    assert timing.tick_length(1e-6, 1000) == 1e-3


def test_unequal_links_are_repeated_in_a_longer_robot():
    unequal = Robot(
        link_count=5, link_mass=(0.7, 0.4, 1.1, 0.5, 0.8), yaw_stiffness=(40, 20, 60, 30)
    )
    robot = timing.with_links(unequal, 7)
    assert robot.link_mass == (0.7, 0.4, 1.1, 0.5, 0.8, 0.7, 0.4)
    assert robot.yaw_stiffness == (40.0, 20.0, 60.0, 30.0, 40.0, 20.0)


def test_situations_take_turns(monkeypatch):
    # What there is to pay for, not what it cost: the robot that is lifted has no contact.
    monkeypatch.setattr(timing, 'ROUNDS', 1)
    runs = timing.situations(0.01)
    reports = {name: run.trajectory.report for name, run in runs.items()}
    assert list(runs) == list(timing.SITUATIONS)
    assert reports['all contacts'].contacts == 22
    assert reports['flight'].contacts == 0
    assert reports['flight'].iterations == reports['flight'].steps


@pytest.mark.parametrize('cold', [False, True])
def test_bench_tells_the_start_up_of_new_processes(cold, monkeypatch):
    # Without the compiler this tests that a process starts, steps and ends, not how long it takes.
    monkeypatch.setenv('NUMBA_DISABLE_JIT', '1')
    monkeypatch.setenv('NUMBA_CACHE_DIR', 'kept')
    folders, start = [], subprocess.run

    def noted(command, *, env, **options):
        folders.append((env or os.environ)['NUMBA_CACHE_DIR'])
        return start(command, env=env, **options)

    monkeypatch.setattr(timing.subprocess, 'run', noted)
    assert 0.1 < timing.start_up_seconds(Scene(), cold=cold) < 60
    assert (folders != ['kept']) == cold and len(folders) == 1
