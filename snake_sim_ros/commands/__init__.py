# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The command line `snake-sim`: a module for each command, with its arguments and what it does.

A module imports at its top only what is quick to import. What computes or draws, which brings in
the compiler, SciPy or matplotlib, is imported when its command runs: they take up to two seconds,
and ``snake-sim --help`` needs none of them. What needs optional packages is imported there as
well, so that a command that misses one can say which.
"""
