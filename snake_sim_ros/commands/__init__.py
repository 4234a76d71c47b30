# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The command line `snake-sim`: groups of commands, each with its arguments and what it does.

A module is imported when one of its commands runs, because the compiler, SciPy and matplotlib take
up to two seconds to import and ``snake-sim --help`` needs none of them. What needs optional
packages is imported where it is used, so that a command can say which package it misses.
"""
