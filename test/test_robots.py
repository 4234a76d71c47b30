"""
Robots that differ from Aiko and from link to link: gains, agreement of methods, momentum, files.

Where methods take the same step, they are compared with the dense one. In the air all of them
solve the same linear system; on the floor each is stopped by its own tolerance.
"""

from dataclasses import replace

import numpy as np
import pytest
from scenes import course
from scenes import EPS
from scenes import every_method
from scenes import G
from scenes import references
from scenes import run

from snake_sim_ros.parameters import Friction
from snake_sim_ros.parameters import load_scene
from snake_sim_ros.parameters import Scene
from snake_sim_ros.parameters import Solver
from snake_sim_ros.stepping import initial_state
from snake_sim_ros.stepping import make_stepper
from snake_sim_ros.stepping import METHODS
from snake_sim_ros.stepping import no_history

UNEQUAL = """
robot:
  link_count: 5
  link_length: [0.12, 0.09, 0.15, 0.1, 0.13]
  link_mass: [0.7, 0.4, 1.1, 0.5, 0.8]
  contact_offset: [0.04, 0.03, 0.05, 0.03, 0.045]
  contact_radius: [0.05, 0.04, 0.06, 0.045, 0.05]
  inertia: consistent
  yaw_stiffness: [40, 20, 60, 30]
  yaw_damping: [0.2, 0.1, 0.3, 0.15]
  pitch_stiffness: [800, 400, 600, 1000]
  pitch_damping: [0.2, 0.3, 0.1, 0.4]
gait:
  yaw: {amplitude_deg: 30, angular_frequency_deg: 80, phase_lag_deg: -50}
  pitch: {amplitude_deg: 2, angular_frequency_deg: 80, phase_lag_deg: -50, phase_deg: 90}
"""
HEIGHT = 5.0  # m


@pytest.fixture
def unequal(tmp_path):
    """Return the scene of a robot of five unequal links, read from a file."""
    path = tmp_path / 'unequal.yaml'
    path.write_text(UNEQUAL, encoding='utf-8')
    return load_scene(path)


def lifted(scene: Scene):
    """Return the scene's robot at rest in the air."""
    state = initial_state(scene)
    state.q[:, 2] += HEIGHT
    return state
