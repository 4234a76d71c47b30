# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The experiments of the paper: its cases, figures, tables and printed errors."""
