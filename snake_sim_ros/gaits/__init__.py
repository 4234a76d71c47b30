# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""References of the joints over time: blending of gaits, steering, commands, trajectories."""
