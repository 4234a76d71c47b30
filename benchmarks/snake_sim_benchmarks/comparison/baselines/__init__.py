# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What our methods are compared with: regularized contact, the friction pyramid, and dense solvers.

The dense solvers `newton_dense` and `gauss_seidel` take the steps of `newton`. Importing this
package adds them to the methods that a scene may name.
"""

from snake_sim_benchmarks.comparison.baselines import dense_newton, gauss_seidel

__all__ = ['dense_newton', 'gauss_seidel']
