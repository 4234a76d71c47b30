# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 side: only this package names rclpy or a message package."""
