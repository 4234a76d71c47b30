# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The two-step formula of method `bdf2` for any ratio of steps, and the parts of a step of the scene.

With the ratio ``w = dt/dt_before`` of both steps, what is known of a smooth motion x gives

    x_hat = x + c (x - x_before),  c = w^2/(1 + 2 w),
    x_E = x_hat + h x'_E,          h = dt (1 + w)/(1 + 2 w),

and the predicted end ``x* = x + w (x - x_before)``. A step of the scene, for which there is one
joint reference, is taken in parts of ``TICKS/2^k`` ticks, each at a multiple of its length. If a
push begins or ends in it, so are the times before and after, each of TICKS ticks of its own.
"""

import math
from typing import NamedTuple, Protocol

from snake_sim_ros.contact.problem import ContactHistory
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.pushes import PushTable, STEP, Stretch, whole_step

# Phases: nothing is known of the motion; it starts smoothly here; the state before is known, too.
UNKNOWN, ANEW, SMOOTH = 0.0, 1.0, 2.0
TICKS = 1024  # a step of the scene is divided in at most this many
# A step that starts anew begins with a part of this share of it: after an event, in a given state.
AFTER_EVENT, AT_START = 2, 4
MOST_GROWTH = 2.0  # ratio of parts beyond which differences over the shorter one say too little
LEAST_ITERATIONS = 40  # enough for `newton` to hold the radii once
GROW_SHARE = 0.15  # share of the tolerance of the path below which the next part is longer


class TwoSteps(Protocol):
    """What the method keeps of the last step at each level; for units see `motion.Bdf2Memory`."""

    @property
    def reference_rate(self) -> Array: ...  # noqa: D102

    @property
    def dt(self) -> Array: ...  # noqa: D102

    @property
    def span(self) -> Array: ...  # noqa: D102

    @property
    def phase(self) -> Array: ...  # noqa: D102

    @property
    def ticks(self) -> Array: ...  # noqa: D102


References = tuple[Array, Array]  # of the joints, (n-1, 2): angles [rad] and rates [rad/s]


@inlined
def least_iterations(limit: int) -> int:
    """Return how many iterations a solution has if those before used up the limit of the step."""
    return min(LEAST_ITERATIONS, limit)


@inlined
def coefficients(dt: float, memory: TwoSteps) -> tuple[float, float, float, float]:
    """
    Return w and c of the formula, h, and the time for which rates act on the state before it.

    Without a state before, w and c are 0 and h is dt. If the motion starts smoothly, coordinates
    move by their rates for half of it, and by those of the end for the rest of h.
    """
    phase = memory.phase[0]
    w = dt / memory.dt[0] if phase == SMOOTH else 0.0
    half = 0.5 * dt if phase == ANEW else 0.0
    return w, w * w / (1.0 + 2.0 * w), dt * (1.0 + w) / (1.0 + 2.0 * w), half


@inlined
def first_size(dt: float, path_tolerance: float, memory: TwoSteps) -> int:
    """Return the ticks of the first part of a step of dt [s]."""
    if memory.phase[0] != SMOOTH:
        goes_on = memory.span[0] > 0.0 and memory.ticks[0] > 0.0
        return TICKS // (AFTER_EVENT if goes_on else AT_START)
    chosen = path_tolerance > 0.0 and memory.ticks[0] > 0.0
    size = int(memory.ticks[0]) if chosen else TICKS
    while size > 1 and dt * size > MOST_GROWTH * TICKS * memory.dt[0]:
        size //= 2
    return size


@inlined
def judge_part(path_tolerance: float, error: float, size: int) -> tuple[bool, int]:
    """
    Return whether a part is taken that makes an error in the path [m], and the size of the next.

    If path_tolerance [m] is 0, parts are not chosen: they only become longer.
    """
    if path_tolerance > 0.0:
        if error > path_tolerance and size > 1:
            return False, size // 2
        if not error < GROW_SHARE * path_tolerance:
            return True, size
    return True, min(2 * size, TICKS)


@inlined
def path_error(dt: float, axes: int, u: Array, u_star: Array) -> float:
    """
    Return by how much a part of dt may be off the path [m].

    It is estimated from the velocities at its end and the predicted ones, both with those of the
    link centers in their first `axes` columns.
    """
    square = 0.0
    for i in range(len(u)):
        for k in range(axes):
            difference = u[i, k] - u_star[i, k]
            square += difference * difference
    return 0.25 * dt * math.sqrt(square / len(u))


@inlined
def end_references(
    dt: float, late: float, known: bool, reference: References, memory: TwoSteps, to: References
) -> None:
    """
    Fill the joint references of a part that ends `late` [s] after the middle of a step of dt [s].

    They are extrapolated from angles and rates at this middle, `reference`, with their mean
    acceleration since the step before, if that is known. `to` are filled.
    """
    (angle, rate), (end_angle, end_rate) = reference, to
    for j in range(len(angle)):
        for axis in range(2):
            change = rate[j, axis] - memory.reference_rate[j, axis]
            acceleration = change / dt if known else 0.0
            end_rate[j, axis] = rate[j, axis] + late * acceleration
            mean = rate[j, axis] + 0.5 * late * acceleration
            end_angle[j, axis] = angle[j, axis] + late * mean


@inlined
def keep_references(size: int, rate: Array, memory: TwoSteps) -> None:
    """Keep the ticks of the next part, and the rates of the references of the step that ends."""
    memory.ticks[0] = size
    for j in range(len(rate)):
        for axis in range(2):
            memory.reference_rate[j, axis] = rate[j, axis]


@inlined
def copy_history(history: ContactHistory, to: ContactHistory) -> None:
    """Copy impulses, velocities and changes of the contacts; all are 0 of one without load."""
    for a in range(len(to.impulse)):
        if history.impulse[a, 0] > 0.0 or to.impulse[a, 0] > 0.0:
            for j in range(5):
                to.impulse[a, j] = history.impulse[a, j]
                to.velocity[a, j] = history.velocity[a, j]
                to.change[a, j] = history.change[a, j]


# ---- pushes divide steps ----


class Task(NamedTuple):
    """A part of a step that is to be tried."""

    dt: float  # its length [s]
    stretch: Stretch  # in which it is, and pushes are constant
    most: int  # iterations that the report is to have after it


class Place(NamedTuple):
    """How far a step of the scene is that is taken in parts."""

    stretch: Stretch  # in which the next part is, and pushes are constant
    done: int  # ticks of it that are taken
    size: int  # ticks of the next part
    parts: int  # parts that were taken


@inlined
def first_place(
    dt: float, path_tolerance: float, pushes: PushTable, k: int, memory: TwoSteps
) -> Place:
    """Return the `Place` at the start of step k, of dt [s]."""
    step = whole_step(pushes, k)
    stretch = stretch_from(pushes, step.begin, step.end, memory)
    return Place(stretch, 0, first_size(dt, path_tolerance, memory), 0)


@inlined
def next_place(place: Place, taken: bool, size: int, pushes: PushTable, memory: TwoSteps) -> Place:
    """Return the `Place` after a part that was taken or not, for a next one of `size` ticks."""
    stretch, done, parts = place.stretch, place.done, place.parts
    if taken:
        done, parts = done + place.size, parts + 1
        if done == TICKS and stretch.end < stretch.step_end:
            stretch = stretch_from(pushes, stretch.end, stretch.step_end, memory)
            done, size = 0, TICKS // AFTER_EVENT
    while done % size != 0:  # a part begins at a multiple of its length
        size //= 2
    return Place(stretch, done, size, parts)


@inlined
def stretch_from(pushes: PushTable, begin: int, step_end: int, memory: TwoSteps) -> Stretch:
    """
    Return the `Stretch` of a step from a tick on in which pushes are constant.

    If one begins or ends at that tick, the memory of method `bdf2` is to start anew there.
    """
    end = step_end
    for p in range(len(pushes.link)):
        first, last = pushes.begin[p], pushes.end[p]
        if (first == begin or last == begin) and memory.phase[0] == SMOOTH:
            memory.phase[0] = ANEW
        if begin < first < end:
            end = first
        if begin < last < end:
            end = last
    return Stretch(begin, end, step_end)


@inlined
def part_of(place: Place, dt: float) -> tuple[float, float]:
    """Return the length of the next part of a step of dt, and how late after its middle [s]."""
    stretch, done, size, _ = place
    length = (stretch.end - stretch.begin) / STEP
    late = (stretch.begin - stretch.step_end) / STEP + length * (done + size) / TICKS
    return dt * length * size / TICKS, dt * (late + 0.5)
