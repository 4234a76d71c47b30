# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Many runs of a scene: studies of values that vary, optimizations, and fits to a recording."""
