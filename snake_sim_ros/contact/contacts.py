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

from typing import Annotated, Any

from snake_sim_ros.dynamics.compilation import inlined, record_array, Table
from snake_sim_ros.scene.parameters import Array

Number = Annotated[Array, float]  # columns, with one entry for each contact
Index = Annotated[Array, int]
Point = Annotated[Array, float, 3]
Components = Annotated[Array, float, 5]
MIXED = 8  # moves of held radii that are kept
OfFriction = Annotated[Array, float, 2]  # one for SLIDING, one for ROLLING


class Geometry:
    """What touches where."""

    point: Point  # contact point, from O in axes of I [m]
    other_point: Point  # the same point as one of the other link, see `directions` [m]
    heading: Annotated[Array, float, 2]  # direction of the link axis: e_x of the frame, in I [1]
    radius: Number  # radius of the contact sphere [m]
    grip: Number  # factor of friction where there is more than a flat floor; `laws.grip` [1]
    gap: Number  # gap g [m]
    start_gap: Number  # depth at the start, as a gap, if any contact was deep; else 0 [m]
    link: Index  # index of the link
    other_link: Index  # index of the link that it touches, -1 if it is no link


class Solution:
    """Velocities, impulses and gaps of the step."""

    gamma: Components  # relative velocities [m/s]
    impulse: Components  # impulses P [N s]
    shift: Number  # gap over the time it may close in; added to gamma_N [m/s]
    approach_velocity: Number  # gamma_N before the contacts act [m/s]
    selection_center: Number  # P_N about which the selection rule is compliant [N s]
    last_normal_impulse: Number  # P_N of the last step [N s]
    end_gap: Number  # gap at the end of the step [m]
    is_loaded: Index  # 1 if it carries load at the end of the step


class NewtonScratch:
    """
    Linear laws and iterates of Newton's method.

    Other solvers and the closing of gaps use parts of it as scratch.
    """

    row: Index  # its first row in the Delassus operator
    # Linear laws P = P_0 - S gamma [N s], [kg].
    P_0: Components
    S_N: Number
    S_xx: OfFriction
    S_xy: OfFriction
    S_yy: OfFriction
    S_xN: OfFriction
    S_yN: OfFriction
    trial: Components  # gamma about which the laws are linear [m/s]
    iterate: Components  # impulses that belong to trial [N s]
    law_impulse: Components  # impulses that the laws give at trial [N s]
    anchor: Components  # prox center of the proximal point method [N s]
    saved_trial: Components  # trial and iterate at the end of a round [m/s], [N s]
    saved_iterate: Components
    disc_radius: Number  # radius of the friction disc if held; FREE, CLOSE: it is P_N [N s]
    held_radius: Number  # disc radius that the next round holds [N s]
    radius_step: Number  # resulting P_N less the radius that was held [N s]
    step_change: Number  # change of radius_step since the round before [N s]
    radius_move: Number  # by which held_radius was moved last [N s]
    # Earlier moves, and the changes of radius_step that they cause; see `radii.mix`.
    moves: Annotated[Array, float, MIXED]
    changes: Annotated[Array, float, MIXED]
    best_impulse: Components  # impulses that left least of the laws so far [N s]
    is_closed: Index  # 1 while `closed` is being compared with all contacts


class PathScratch:
    """A point of `central_path` and the steps from it; x and y are scaled by friction."""

    mu: Annotated[Array, float, 2]  # friction along and across the link [1]
    x: Point  # impulse [N s]
    y: Point  # velocity with the friction that slides [m/s]
    gamma: Point  # velocity [m/s]
    w: Point  # scaling of x and y to their middle: W^2 = eta^2 (2 w w^T - J) [1]
    eta: Number  # [kg^1/2]
    middle: Point  # W y = W^-1 x where a step begins [(N s m/s)^1/2]
    follow: Annotated[Array, float, 2]  # change of the friction that slides with its velocity [1]
    stiffness: Annotated[Array, float, 3, 3]  # K of dP = P' - K dgamma [kg]
    right: Point  # right side of a linear problem, in x [N s]
    rest: Point  # by which y is to change besides with gamma and x [m/s]
    # Steps of x, y and gamma by their kinds, see `central_path.BACK`.
    step_x: Annotated[Array, float, 4, 3]
    step_y: Annotated[Array, float, 4, 3]
    step_gamma: Annotated[Array, float, 4, 3]
    kept: Annotated[Array, float, 3, 3]  # x, y and gamma of the last point


class Contacts(Table[Any]):
    """The table of contacts: a record for each of them, which has all four."""

    geometry: Geometry
    solution: Solution
    newton: NewtonScratch
    path: PathScratch


SLIDING, ROLLING = range(2)  # kinds of friction
FREE, CLOSE = -1.0, -2.0  # values of disc_radius; see `linear_problem.close_law`


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
    contacts: Contacts = record_array(len(links), Contacts)
    geometry = contacts['geometry']
    geometry['grip'][:] = 1.0
    geometry['link'][:], geometry['other_link'][:] = links.T
    return contacts
