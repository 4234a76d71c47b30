# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Speed against accuracy: the bench, its tables and charts, baselines and MuJoCo."""
