# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Three steps of a short robot; as a program it prints them and where the package is."""

import json
import sys

import numpy as np

import snake_sim_ros
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.state import initial_state, named_arrays

CASES = (('newton', 'spatial'), ('paper', 'spatial'), ('newton', 'auto'))


def short_run(method, level):
    """
    Return state, history and report after 3 steps of 5 links, begun 1e-9 m inside the floor.

    At most 10 contacts and 40 iterations a step: the method `paper` condenses the contact problem
    on the way. At the level `auto` the robot is lifted in the third step.
    """
    settings = {
        'robot.link_count': 5,
        'solver.iteration_limit': 40 if level == 'spatial' else 5000,
    }
    settings |= {'method': method, 'level': level}
    scene = with_settings(load_scene('lateral_undulation'), settings)
    state = initial_state(scene)
    state.q[:, 2] -= 1e-9
    times = (np.arange(3) + 0.5) * scene.dt
    reference = gait.reference(scene.gait, times, scene.robot.link_count - 1)
    reference[0][2, 0, 1] = 0.01 if level == 'auto' else 0.0
    stepper = make_stepper(scene)
    return stepper.advance(state, stepper.empty_history(), *reference)


if __name__ == '__main__':
    sys.modules['rclpy'] = sys.modules['matplotlib'] = None  # type: ignore[assignment]
    found = {}
    for method, level in CASES:
        end, history, _ = short_run(method, level)
        arrays = {name: array.tolist() for name, array in named_arrays(history).items()}
        found[f'{method} {level}'] = end.q.tolist(), end.u.tolist(), arrays
    print(json.dumps([snake_sim_ros.__file__, found]))
