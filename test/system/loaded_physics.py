# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What processes that are forked find loaded: whoever imports this is the server of `forks`.

The nodes among them tell their diagnostics five times a second, since tests wait for them, and
know all publishers after a second, see `fast_discovery.xml`, so that a gait waits less for angles.
"""

import gc
import inspect
import sys

from rclpy.impl import rcutils_logger
from rclpy.type_support import check_for_type_support

from snake_sim_ros import Scene, Simulation
from snake_sim_ros.gaits.joint_reference import compile_sampling
from snake_sim_ros.nodes import diagnostics, gait_inputs

# Half of the start of a node is the support of the types it uses, a fifth its first line in a log.
PACKAGES = ('_msgs.msg', '_msgs.srv', '_interfaces.msg', '_interfaces.srv', '_srvs.srv')
for module in [sys.modules[name] for name in sys.modules if name.endswith(PACKAGES)]:
    for kind in vars(module).values():
        if hasattr(type(kind), '__import_type_support__'):
            check_for_type_support(kind)
rcutils_logger._find_caller(inspect.currentframe())
diagnostics.INTERVAL /= 5
gait_inputs.DISCOVERY, gait_inputs.ANGLES_WAIT = 1.0, 0.3

compile_sampling(Scene())
Simulation(Scene()).compile()
gc.freeze()  # Each process that is forked would look through all objects of the compiler.
