# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The mechanism without contact: kinematics, the chain of links, joint control and energy."""
