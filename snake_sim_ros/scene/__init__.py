# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is simulated: robot, friction, gait and obstacles, and their geometry."""
