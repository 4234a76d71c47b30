# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact: detection, set-valued laws, their residual, and the solvers of a step."""
