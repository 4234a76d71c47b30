# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the commands topic, param and service do, in the words of the `ros2` command line."""
