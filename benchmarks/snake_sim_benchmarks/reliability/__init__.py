# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How the program is attacked: random files, messages and physics, faults, and very long runs."""
