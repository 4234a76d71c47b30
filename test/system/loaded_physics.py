# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The physics of most scenes, loaded by whoever imports this: the server of `forks`."""

import gc

from snake_sim_ros import Scene, Simulation
from snake_sim_ros.gaits.joint_reference import compile_sampling

compile_sampling(Scene())
Simulation(Scene()).compile()
gc.freeze()  # Each process that is forked would look through all objects of the compiler.
