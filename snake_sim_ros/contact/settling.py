# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
When impulses are as accurate as a step needs them, which small velocities alone do not show.

The residual of the laws is a velocity. Contacts that share a load in several ways answer to a
velocity v that is left with up to ``v/c``, where c is the small compliance of the selection rule:
1e-9 m/s may be some percent of a load. Newton's method leaves nothing of the normal laws. What it
leaves of friction that slides is an impulse, and changes loads by less than itself. What it leaves
of friction that sticks are velocities, which count where links hold each other, that is from a
few contacts on. There the method goes on until its corrections end, or until rounding ends them.
Where rounding does, the residual alone decides whether the step converged.
"""

import math

from snake_sim_ros.contact.laws import grip, rolling_disc, sliding_disc
from snake_sim_ros.dynamics.compilation import compiled, inlined

# Of normal impulses, relative to the largest one of a step. Estimates may be five times off.
LOAD_ACCURACY = 2e-7
USUAL_TOLERANCE = 1e-9  # a larger one of the residual asks for less accurate loads, too [m/s]
# Contacts that stick without holding links against each other. On a flat floor two are as few: no
# friction acts along a normal there, as it does where a link is wedged.
FEW = 1
FEW_ON_FLOOR = 2
REFINES = 0.9  # an iteration that leaves a larger share of the residual does not refine it


@inlined
def largest_load(closed, contacts):
    """Return the largest normal impulse of the closed contacts [N s]."""
    largest = 0.0
    for a in closed:
        largest = max(largest, contacts.impulse[a, 0])
    return largest


@inlined
def small_load(closed, contacts, tolerance):
    """Return what may be wrong of a normal impulse [N s], for a tolerance of the residual."""
    share = LOAD_ACCURACY * max(1.0, tolerance / USUAL_TOLERANCE)
    return share * largest_load(closed, contacts)


@inlined
def largest_correction(closed, contacts):
    """Return by how much the last iteration changed a normal impulse, at most [N s]."""
    largest = 0.0
    for a in closed:
        largest = max(largest, abs(contacts.impulse[a, 0] - contacts.iterate[a, 0]))
    return largest


@compiled
def is_negligible(laws, closed, contacts, residual, tolerance):
    """
    Return whether any velocities up to a residual [m/s] leave the loads accurate.

    `laws`, `closed` and `contacts` are those of a `solver.Problem`. Without the selection rule the
    loads are not unique, and every residual will do.
    """
    if laws.compliance <= 1e-2 * laws.proximal_compliance:
        return True
    return residual <= laws.compliance * small_load(closed, contacts, tolerance)


@compiled
def loads_are_accurate(laws, closed, contacts, residual, tolerance):
    """
    Return whether a residual [m/s] that is left of friction alone leaves the loads accurate.

    Iterates of Newton's method satisfy the normal laws to rounding; other parameters are those of
    `is_negligible`.
    """
    if is_negligible(laws, closed, contacts, residual, tolerance):
        return True
    wrong = small_load(closed, contacts, tolerance)
    return friction_is_accurate(laws, closed, contacts, residual, wrong)


@compiled
def friction_is_accurate(laws, closed, contacts, residual, wrong):
    """Return whether friction leaves the loads accurate to `wrong` [N s]; see the module."""
    still = laws.compliance * wrong
    most = wrong / residual
    sticking = 0
    for a in closed:
        radius = grip(laws.other, contacts, a) * contacts.impulse[a, 0]
        if radius <= 0.0:
            continue
        v = speed(contacts, a, 1)
        if still < v <= residual:
            sticking += 1
        elif v > residual:
            disc = sliding_disc(laws, laws.other, a, contacts.impulse[a, 1])
            if not turns_little(disc, radius, laws.r_T, v, most):
                return False
        if laws.rolling.mu_x > 0.0:
            v = speed(contacts, a, 3)
            if still < v <= residual:
                sticking += 1
            elif v > residual:
                disc = rolling_disc(laws, laws.other, a)
                if not turns_little(disc, radius, laws.r_V, v, most):
                    return False
    return sticking <= (FEW_ON_FLOOR if laws.other is None else FEW)


@inlined
def speed(contacts, a, k):
    """Return the length of the components k and k+1 of the velocity of contact a [m/s]."""
    return math.sqrt(contacts.gamma[a, k] ** 2 + contacts.gamma[a, k + 1] ** 2)


@inlined
def turns_little(disc, radius, r, v, most):
    """
    Return whether a residual leaves little of the impulse of friction that slides at v [m/s].

    A residual e leaves it wrong by ``e (R/v + r)``, R the radius of its disc: its direction is
    that of the velocity. `most` is what may be left of this, over e [kg].
    """
    return max(disc.mu_x, disc.mu_y) * radius + r * v <= most * v


@inlined
def corrections_end(correction, before, wrong):
    """
    Return whether the corrections to come add up to less than `wrong` [N s].

    Those of linear convergence are a geometric series. `correction` is the last one and `before`
    the one before it, infinite if there was none.
    """
    share = min(correction / before, 1.0) if before > 0.0 else 0.0
    return correction <= wrong and share * correction <= (1.0 - share) * wrong


@inlined
def refines(laws, closed, contacts, residual, tolerance, best, before):
    """
    Return whether an iteration of Newton goes on although its residual is within the tolerance.

    Parameters
    ----------
    laws, closed, contacts
        Those of a `solver.Problem`; `iterate` of the contacts has the impulses before.
    residual, tolerance : float
        The last residual, and the tolerance for it [m/s].
    best, before : float
        Smallest residual and correction of the loads so far, as returned; infinite at first.

    Returns
    -------
    best, before : float
    goes_on : bool

    """
    if residual > REFINES * best:
        return best, before, False
    if loads_are_accurate(laws, closed, contacts, residual, tolerance):
        return best, before, False
    correction = largest_correction(closed, contacts)
    wrong = small_load(closed, contacts, tolerance)
    return residual, correction, not corrections_end(correction, before, wrong)
