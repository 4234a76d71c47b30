"""
The table of contacts: all that belongs to a contact, by name, one row for each.

Components of an impulse P, and of the relative velocity gamma that goes with it, are (normal,
sliding along and across the link, rolling along x and y of I); where there is more than a flat
floor, rolling is along the axes of the contact frame. Contacts are numbered as in eq. (10).
"""

from typing import Any

import numpy as np

from snake_sim_ros.dynamics.compilation import record_array

CONTACT = np.dtype(
    [
        ('point', float, 3),  # contact point from O [m]
        ('heading', float, 2),  # horizontal direction of the link axis: e_x of the contact frame
        ('radius', float),  # of the sphere [m]
        ('gamma', float, 5),  # relative velocities [m/s]
        ('impulse', float, 5),  # impulses P [N s]
        ('gap', float),  # gap g [m]
        ('shift', float),  # velocity that a gap still leaves open, a part of gamma_N [m/s]
        ('approach_velocity', float),  # gamma_N before the contacts act [m/s]
        ('selection_center', float),  # P_N about which the selection rule is compliant [N s]
        ('last_normal_impulse', float),  # P_N of the last step [N s]
        ('link', np.int64),  # index of the link
        ('other_link', np.int64),  # index of the link that it touches, -1 for none
        # The linear laws P = P_0 - S gamma.
        ('P_0', float, 5),
        ('S_N', float),
        ('S_xx', float, 2),  # of SLIDING and ROLLING each
        ('S_xy', float, 2),
        ('S_yy', float, 2),
        ('S_xN', float, 2),
        ('S_yN', float, 2),
        # Newton's method.
        ('trial', float, 5),  # gamma about which the laws are linear
        ('iterate', float, 5),  # impulses that go with it
        ('law_impulse', float, 5),  # impulses of the laws at trial
        ('anchor', float, 5),  # impulses that the proximal point method starts from
        ('saved_trial', float, 5),  # to come back to
        ('saved_iterate', float, 5),
        ('disc_radius', float),  # radius of the friction disc if it is held, else FREE: it is P_N
        ('held_radius', float),  # radius to hold next
        ('radius_step', float),  # how far the one held before was from what it led to
        ('is_closed', np.int64),  # whether the contact is among the closed ones
    ]
)
SLIDING, ROLLING = range(2)  # kinds of friction
FREE = -1.0


def make_table(count: int) -> Any:
    """Return the table of so many contacts: an array of records."""
    return record_array(count, CONTACT)
