# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Environments of Gymnasium: snakes that learn to move, to reach goals and to follow paths.

An import registers them, as ``gymnasium.register_envs(snake_sim_ros.learning)`` says in words. A
name with the module, ``snake_sim_ros.learning:snake_sim_ros/Forward-v0``, imports it as well.
"""

from typing import Any

import gymnasium

from snake_sim_ros.learning.environment import SnakeEnv
from snake_sim_ros.learning.policy import PolicyController
from snake_sim_ros.learning.snakes import Randomization
from snake_sim_ros.learning.vector import SnakeVectorEnv

__all__ = ['ENVIRONMENTS', 'PolicyController', 'Randomization', 'SnakeEnv', 'SnakeVectorEnv']

EPISODE = 500  # control periods of an episode: 20 s at 25 Hz
# References of a gait are smooth, so that few large steps are as accurate as many small ones.
GAIT = {'action': 'gait', 'method': 'bdf2', 'dt': 1 / 50}
# Name -> arguments of `SnakeEnv`.
ENVIRONMENTS: dict[str, dict[str, Any]] = {
    'snake_sim_ros/Forward-v0': {'task': 'forward', 'dt': 1 / 125},
    'snake_sim_ros/Goal-v0': {'task': 'goal', **GAIT},
    'snake_sim_ros/Path-v0': {'task': 'path', **GAIT},
    'snake_sim_ros/Pegs-v0': {
        'task': 'forward',
        'scene': 'obstacle_aided',
        'action': 'residual',
        'method': 'bdf2',
        'dt': 1 / 100,
    },
    'snake_sim_ros/Sidewinding-v0': {'task': 'goal', 'scene': 'sidewinding', **GAIT},
    'snake_sim_ros/Stairs-v0': {'task': 'sideways', 'scene': 'stairs', **GAIT, 'dt': 1 / 100},
}

for name, values in ENVIRONMENTS.items():
    gymnasium.register(
        name,
        f'{SnakeEnv.__module__}:SnakeEnv',
        vector_entry_point=f'{SnakeVectorEnv.__module__}:SnakeVectorEnv',
        kwargs=values,
        max_episode_steps=EPISODE,
    )
