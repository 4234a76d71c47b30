# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What `import snake_sim_ros` offers: scenes, runs and simulations in Python, without ROS."""

from snake_sim_ros.api.runs import load_scene, read_run, Run, run, table_of
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import Gait, Table, Wave
from snake_sim_ros.scene.parameters import (
    Friction,
    Ground,
    Patches,
    Pegs,
    Push,
    Robot,
    Scene,
    Solver,
    Start,
)
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import State
from snake_sim_ros.studies.study import study

__all__ = [
    'Friction',
    'Gait',
    'Ground',
    'ParameterError',
    'Patches',
    'Pegs',
    'Push',
    'Report',
    'Robot',
    'Run',
    'Scene',
    'Simulation',
    'Solver',
    'Start',
    'State',
    'Table',
    'Wave',
    'load_scene',
    'read_run',
    'run',
    'study',
    'table_of',
]
