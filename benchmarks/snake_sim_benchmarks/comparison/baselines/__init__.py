# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Regularized contact and the friction pyramid, with which our methods are compared."""
