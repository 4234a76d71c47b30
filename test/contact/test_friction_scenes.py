# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Whole runs with friction that differs forward and backward and in patches, compiled."""

from dataclasses import replace

from flat_states import crooked
import numpy as np
import pytest
from scenes import course, kinetic_energy

from snake_sim_ros import Friction, Robot, Scene, Simulation
from snake_sim_ros.scene.parameters import load_scene, with_settings


@pytest.mark.parametrize('name', ['scales', 'patches'])
def test_scenes_converge_in_every_step(name):
    scene = replace(load_scene(name), method='newton', dt=1 / 400)
    simulation = Simulation(scene)
    report = simulation.advance(*simulation.gait_reference(800))
    assert not report.failure
    assert not report.unconverged


def test_levels_agree():
    # Case A over patches, with friction that doubles backward, which is where it goes: both levels
    # are one model up to the roll that the planar one neglects, 0.5 % of the way at most.
    scene = with_settings(load_scene('patches'), {'friction.backward': 0.2})
    scene = replace(scene, method='newton', dt=1 / 1000)
    ends = []
    for level in ('planar', 'spatial'):
        simulation = Simulation(replace(scene, level=level))
        start = simulation.state.q[:, :2].mean(axis=0)
        report = simulation.advance(*simulation.gait_reference(4500))
        assert not report.failure
        ends.append(simulation.state.q[:, :2].mean(axis=0) - start)
    assert ends[0][0] < -0.1
    assert np.linalg.norm(ends[0] - ends[1]) < 5e-3 * np.linalg.norm(ends[0])


def test_a_robot_with_scales_loses_energy():
    # Slack joints: nothing but friction works.
    robot = Robot(
        link_count=6, yaw_stiffness=0.0, yaw_damping=0.0, pitch_stiffness=0.0, pitch_damping=0.0
    )
    for level in ('planar', 'spatial'):
        rng = np.random.default_rng(8)
        scene = Scene(
            robot=robot, method='newton', level=level, dt=1 / 1000,
            friction=Friction(longitudinal=0.02, backward=0.06, transversal=0.1),
        )  # fmt: skip
        states, _, report = course(scene, crooked(rng, robot, 0.3), 100)
        if report.failure:  # without torques of pitch joints it rolls over in the plane
            assert level == 'planar'
            continue
        energy = kinetic_energy(robot, states.u).ravel()
        # Velocities of the middle satisfy the joints; those of the end by rounding times dt.
        assert (np.diff(energy) < 1e-3 * energy[0] * scene.dt).all()
        assert energy[-1] < 0.9 * energy[0]
