# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Optimization: the values of a scene for which an expression of metrics is largest or least."""
