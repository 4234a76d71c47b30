# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Method `bdf2`: a step of second order, in joint coordinates, that restarts at jumps of velocities.

`formula` has the two-step formula and the parts of a step, `motion` the joint coordinates and what
a step leaves to the next, `events` the contacts that close, and `step` the step itself.
"""
