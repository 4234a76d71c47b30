# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Time stepping: the methods, the model levels, and a scene that runs."""
