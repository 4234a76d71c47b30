# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Controllers: what a robot measures, what it is to do next, and the paths that it follows."""
