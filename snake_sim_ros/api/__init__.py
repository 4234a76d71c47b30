# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Runs of scenes in Python, without ROS; `snake_sim_ros/__init__.pyi` lists what is public."""
