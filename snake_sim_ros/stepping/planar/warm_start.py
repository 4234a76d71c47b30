# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the contact solvers of Newton start in a step in the plane: as `contact.warm_start`."""

from snake_sim_ros.dynamics.compilation import inlined, merged

# Component of `change` in history for the change of the change of a load: nothing rolls here.
SECOND_CHANGE = 3


@inlined
def predict_sliding(closed, contacts, history):
    """Fill disc radii, trial and anchor: loads and velocities continue to change as they did."""
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        P_N = last[a, 0]
        contacts.disc_radius[a] = max(0.0, P_N + change[a, 0] + change[a, SECOND_CHANGE])
        for k in range(3):
            contacts.anchor[a, k] = last[a, k]
        x, y = velocity[a, 1], velocity[a, 2]
        next_x, next_y = x + change[a, 1], y + change[a, 2]
        ahead = x * next_x + y * next_y > 0.0
        x, y = (next_x, next_y) if ahead else (x, y)
        known = P_N > 0.0
        contacts.trial[a, 0] = 0.0 if known else contacts.gamma[a, 0]
        contacts.trial[a, 1] = x if known else contacts.gamma[a, 1]
        contacts.trial[a, 2] = y if known else contacts.gamma[a, 2]


@merged
def remember_sliding(closed, contacts, history):
    """Fill the history with impulses, velocities and changes, 0 for open contacts."""
    last, velocity, change = history.impulse, history.velocity, history.change
    for a in closed:
        contacts.is_closed[a] = 1
        P_N = contacts.impulse[a, 0]
        before = last[a, 0] > 0.0
        difference = P_N - last[a, 0] if before else 0.0
        change[a, SECOND_CHANGE] = difference - change[a, 0] if before else 0.0
        change[a, 0] = difference
        last[a, 0] = P_N
        for k in range(1, 3):
            gamma = contacts.gamma[a, k]
            change[a, k] = gamma - velocity[a, k] if before else 0.0
            velocity[a, k] = gamma
            last[a, k] = contacts.impulse[a, k]
    for a in range(len(contacts) if len(contacts) > len(closed) else 0):
        if contacts.is_closed[a] == 0 and last[a, 0] > 0.0:
            for j in range(5):
                last[a, j] = velocity[a, j] = change[a, j] = 0.0
        contacts.is_closed[a] = 0
