# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The planar model level: the same steps for a robot that lies flat."""
