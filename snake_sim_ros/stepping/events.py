"""
Contacts that close in a step, and what impulses say of the velocities of a step.

Deviation: a contact with a gap takes part when it may close in the step, with the law
``gamma_N + (g - h gamma_N*)/h + compliance P_N >= 0``: the step ends with the gap closed, neither
open nor inside the floor. That is where an inelastic impact in the step takes the configuration,
up to dt^2: the impulse moves it as far as the gap asks, whenever in the step it acts. What sticks
as it lands is taken to stick for all of the step: off by dt times the jump across. The velocity
afterwards is that of the impact law, ``gamma_N >= 0``: the contacts that closed are solved once
more without their gaps.
"""

from typing import NamedTuple

from snake_sim_ros.contact.selection import IMPACT_WEIGHTS
from snake_sim_ros.dynamics.compilation import inlined

LANDING_SPEED = 0.3  # a gap takes part if this speed could close it in the step [m/s]
# By its law a contact that carries load has no gap. The gap that it has is the error of
# integration, of third order in dt. Up to RESTING_GAP the contact stays on velocity level, so that
# the error does not become a velocity. Beyond, it is open, and may land.
RESTING_GAP = 1e-4  # [m]


@inlined
def leave_gaps(model, h_q, late, closed, contacts, impulse):
    """
    Fill the velocities that gaps leave open, and add them to the normal velocities.

    Parameters
    ----------
    model : Model
    h_q : float
        Time over which velocities act on coordinates [s].
    late : float
        Time for which coordinates have moved before [s].
    closed : ndarray, shape (k,)
        Contacts that can close in the step.
    contacts : record array
        With gaps and velocities of the predicted end of the step.
    impulse : ndarray, shape (contacts, 5)
        Impulses of the last step [N s].

    """
    for a in closed:
        contacts.approach_velocity[a] = contacts.gamma[a, 0]
        contacts.last_normal_impulse[a] = impulse[a, 0]
        gap = contacts.gap[a] - h_q * contacts.approach_velocity[a]
        rests = impulse[a, 0] > 0.0 and contacts.gap[a] <= RESTING_GAP
        if gap > model.activation_tolerance and not rests:
            contacts.shift[a] = gap / h_q
        elif gap < 0.0 and not rests:  # what the motion before put inside comes out
            contacts.shift[a] = max(gap, late * min(0.0, contacts.approach_velocity[a])) / h_q
        contacts.gamma[a, 0] += contacts.shift[a]


class Events(NamedTuple):
    """What the impulses of a step say of its velocities."""

    jumps: bool  # whether a contact landed that carried no load before, or an impulse is no force
    lands: bool  # whether velocities close gaps in the step: they are not those after the impact
    closed: int  # contacts that are closed, not all that could close


@inlined
def events(model, h, closed, contacts):
    """Return the `Events` of a step in which forces acted for a time h [s]."""
    weight = largest = 0.0
    for m in model.mass:
        weight -= m * h * model.gravity[2]
    for a in closed:
        largest = max(largest, contacts.last_normal_impulse[a])
    jumps, lands, count = False, False, 0
    for a in closed:
        P_N = contacts.impulse[a, 0]
        count += P_N > 0.0 or contacts.shift[a] <= 0.0
        if P_N > 0.0:
            lands = lands or contacts.shift[a] != 0.0
            meets = contacts.last_normal_impulse[a] <= 0.0 and contacts.approach_velocity[a] < 0.0
            jumps = jumps or meets or P_N > IMPACT_WEIGHTS * max(weight, largest)
    return Events(jumps or lands, lands, count)


@inlined
def closed_at_end(h_q, tolerance, closed, contacts):
    """Keep the contacts that are closed after a step in front, at no gap; return their number."""
    count = 0
    for a in closed:
        gap = contacts.gap[a] + h_q * (
            contacts.gamma[a, 0] - contacts.shift[a] - contacts.approach_velocity[a]
        )
        if contacts.impulse[a, 0] > 0.0 or contacts.shift[a] == 0.0 or gap <= tolerance:
            contacts.shift[a] = 0.0
            closed[count] = a
            count += 1
    return count
