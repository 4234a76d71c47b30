# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The contacts of a scene: a table with a record for each of them, of three parts.

The five components of an impulse P, and of the relative velocity gamma that belongs to it, are
normal, sliding along and across the link, and rolling along x and y of I. In a scene with more
than a flat floor, rolling is along the axes of the contact frame. Contacts are numbered as in
eq. (10), and `scene.obstacles` continues the numbering.

Compiled functions take the table as `contacts`, and the numbers of the closed contacts, shape
(k,), as `closed`. They read and fill fields by name: ``contacts.solution.gamma[a, 0]``. Points
are relative to O, the center of the middle link, in axes of I.
"""

import numpy as np

from snake_sim_ros.dynamics.compilation import inlined, record_array, Table
from snake_sim_ros.scene.parameters import Array

# What touches where.
GEOMETRY = np.dtype(
    [
        ('point', float, 3),  # contact point, from O in axes of I [m]
        ('other_point', float, 3),  # the same point as one of the other link, see `directions`
        ('heading', float, 2),  # horizontal direction of the link axis: e_x of the contact frame
        ('radius', float),  # radius of the contact sphere [m]
        ('grip', float),  # factor of friction where there is more than a flat floor; `laws.grip`
        ('gap', float),  # gap g [m]
        ('start_gap', float),  # depth at the start, as a gap, if any contact was deep; else 0 [m]
        ('takes_part', np.int64),  # 1 if it takes part in the step whatever its gap
        ('link', np.int64),  # index of the link
        ('other_link', np.int64),  # index of the link that it touches, -1 if it is no link
    ]
)
# Velocities, impulses and gaps of the step.
SOLUTION = np.dtype(
    [
        ('gamma', float, 5),  # relative velocities [m/s]
        ('impulse', float, 5),  # impulses P [N s]
        ('shift', float),  # gap over the time it may close in; added to gamma_N [m/s]
        ('approach_velocity', float),  # gamma_N before the contacts act [m/s]
        ('selection_center', float),  # P_N about which the selection rule is compliant [N s]
        ('last_normal_impulse', float),  # P_N of the last step [N s]
        ('end_gap', float),  # gap at the end of the step [m]
        ('is_loaded', np.int64),  # 1 if it carries load at the end of the step
    ]
)
# Linear laws and iterates of Newton's method; other solvers and the closing of gaps use parts of
# it as scratch.
NEWTON = np.dtype(
    [
        ('row', np.int64),  # its first row in the Delassus operator
        # Linear laws P = P_0 - S gamma [N s], [kg].
        ('P_0', float, 5),
        ('S_N', float),
        ('S_xx', float, 2),  # one for SLIDING, one for ROLLING
        ('S_xy', float, 2),
        ('S_yy', float, 2),
        ('S_xN', float, 2),
        ('S_yN', float, 2),
        # Velocities [m/s], impulses and radii [N s].
        ('trial', float, 5),  # gamma about which the laws are linear
        ('iterate', float, 5),  # impulses that belong to trial
        ('law_impulse', float, 5),  # impulses that the laws give at trial
        ('anchor', float, 5),  # prox center of the proximal point method
        ('saved_trial', float, 5),  # trial and iterate at the end of a round
        ('saved_iterate', float, 5),
        ('disc_radius', float),  # radius of the friction disc if held; FREE: it is P_N
        ('held_radius', float),  # disc radius that the next round holds
        ('radius_step', float),  # resulting P_N less the radius that was held
        ('is_closed', np.int64),  # 1 while `closed` is being compared with all contacts
    ]
)
SLIDING, ROLLING = range(2)  # kinds of friction
FREE = -1.0  # value of disc_radius


# The table of contacts: a record for each of them, which has all three.
CONTACT = np.dtype([('geometry', GEOMETRY), ('solution', SOLUTION), ('newton', NEWTON)])
Contacts = Table


@inlined
def stiffness(contacts: Contacts, a: int, kind: int) -> tuple[float, float, float, float, float]:
    """Return S_xx, S_xy, S_yy, S_xN and S_yN of one kind of friction at contact a [kg]."""
    newton = contacts.newton
    return (
        newton.S_xx[a, kind], newton.S_xy[a, kind], newton.S_yy[a, kind], newton.S_xN[a, kind],
        newton.S_yN[a, kind],
    )  # fmt: skip


def make_contacts(links: Array) -> Contacts:
    """
    Return a table of contacts, filled with zeros; every grip is 1.

    `links`, shape (contacts, 2), are the link of every contact and the one it touches, or -1.
    """
    contacts = record_array(len(links), CONTACT)
    geometry = contacts['geometry']
    geometry['grip'][:] = 1.0
    geometry['link'][:], geometry['other_link'][:] = links.T
    return contacts
