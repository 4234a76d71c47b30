# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How a step of `bdf2` in dense NumPy is divided in parts, each as in `bdf2_reference`."""

from functools import partial

import numpy as np

from snake_sim_ros.contact.closing import closed_gap
from snake_sim_ros.dynamics.force_directions import scene_gaps
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.bdf2_end import DEEP
from snake_sim_ros.stepping.bdf2_memory import Bdf2Memory
from snake_sim_ros.stepping.bdf2_reference import part, PartEnd
from snake_sim_ros.stepping.bdf2_reference_motion import recognized, same
from snake_sim_ros.stepping.parts import AFTER_EVENT, ANEW, SMOOTH, TICKS, UNKNOWN
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable, STEP, Stretch
from snake_sim_ros.stepping.state import History, State


def remembered(history: History, dt: float, end: PartEnd) -> Bdf2Memory:
    """Return the memory after a part of length dt."""
    memory = history.memory
    unsure = end.jumps or memory.phase[0] == UNKNOWN
    return Bdf2Memory(
        end=end.motion,
        start=memory.end,
        q=end.state.q,
        reference_rate=memory.reference_rate,
        dt=np.array([dt]),
        span=np.array([end.h]),
        phase=np.array([ANEW if unsure else SMOOTH]),
        ticks=memory.ticks,
        depth=memory.depth,
    )


def depth_of(scene: Scene, state: State) -> float:
    """Return how deep the robot is inside of something [m], 0 if it is not."""
    return max(0.0, -float(scene_gaps(scene, state.q).min()))


def references(
    scene: Scene, known: Bdf2Memory, angle: Array, rate: Array, late: float
) -> tuple[Array, Array]:
    """
    Return the joint references a time `late` [s] after the middle of a step, from those there.

    They have the mean acceleration since the step before, if the memory of it is known.
    """
    acceleration = 0.0 * rate
    if known.span[0] > 0.0:
        acceleration = (rate - known.reference_rate) / scene.dt
    return angle + late * (rate + late / 2 * acceleration), rate + late * acceleration


def after_change(history: History, pushes: PushTable, stretch: Stretch) -> History:
    """Return the history to go on with in a stretch, anew if a push begins or ends there."""
    smooth = history.memory.phase[0] == SMOOTH
    if not (smooth and stretch.begin in (*pushes.begin, *pushes.end)):
        return history
    return history._replace(memory=history.memory._replace(phase=np.array([ANEW])))


def step(
    scene: Scene, state: State, history: History, angle: Array, rate: Array, first: int,
    pushes: PushTable = NO_PUSHES,
) -> list[PartEnd]:  # fmt: skip
    """
    Return the ends of the parts of a step of the scene, with references (n-1, 2) of its middle.

    Its first part is ``1/first`` of it. Parts double where they fit. A part with an end inside the
    floor is repeated with the contacts that are deep there and, if all of them took part, with
    half of its length. Where a push begins or ends, the step is divided first.
    """
    memory, ends, done, size = history.memory, [], 0, TICKS // first
    nobody = takes_part = np.zeros(len(history.impulse), dtype=bool)
    known = memory
    if not (memory.phase[0] != UNKNOWN and same(memory, state)):
        history = history._replace(memory=recognized(scene.robot, state, memory))
        inside = np.array([depth_of(scene, state)])
        history = history._replace(memory=history.memory._replace(depth=inside))
    stretches = pushes.stretches()
    history = after_change(history, pushes, stretches[0])
    while done < TICKS:
        while done % size:
            size //= 2
        stretch = stretches[0]
        length = (stretch.end - stretch.begin) / STEP
        late = (stretch.begin - stretch.step_end) / STEP + length * (done + size) / TICKS
        dt, late = scene.dt * length * size / TICKS, scene.dt * (late + 0.5)
        told, pushed = references(scene, known, angle, rate, late), pushes.generalized
        end = part(scene, history, dt, *told, takes_part, partial(pushed, stretch))
        takes_part = takes_part | end.took_part
        depth, before = depth_of(scene, end.state), history.memory.depth[0]
        closed = closed_gap(scene.solver.activation_tolerance, scene.dt)
        deep = depth > (before + closed if before > DEEP else DEEP)
        deep_ones = scene_gaps(scene, end.state.q) <= -DEEP
        if deep and (deep_ones & ~takes_part).any():
            takes_part = takes_part | deep_ones
        elif deep and size > 1:
            size //= 2
        else:
            ends.append(end)
            memory = remembered(history, dt, end)._replace(depth=np.array([depth]))
            history = history._replace(impulse=end.impulse, memory=memory)
            done, size, takes_part = done + size, min(2 * size, TICKS), nobody
            if done == TICKS and len(stretches) > 1:
                del stretches[0]
                history = after_change(history, pushes, stretches[0])
                done, size = 0, TICKS // AFTER_EVENT
    return ends
