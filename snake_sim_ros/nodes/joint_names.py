# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The names of the joint axes, as messages carry them."""


def joint_names(link_count: int) -> list[str]:
    """Return the names of all joint axes of a robot, in their fixed order along the robot."""
    return [f'joint_{i}_{axis}' for i in range(1, link_count) for axis in ('yaw', 'pitch')]
