# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The laboratory of snake_sim_ros: what measures the simulator, compares it and attacks it.

It imports `snake_sim_ros` as anybody could, and nothing imports it.
"""
