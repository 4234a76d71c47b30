# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The values of a scene that explain a recorded motion, and how well it tells them."""
