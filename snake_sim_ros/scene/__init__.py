# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is simulated: robot, friction, gait and obstacles, and their geometry."""

from pathlib import Path

__version__ = '1.0.0'
PACKAGE = Path(__file__).resolve().parent.parent  # folder of the sources
