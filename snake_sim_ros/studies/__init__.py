# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Studies: many runs of a scene whose values vary, what is measured in each, and the workers."""
