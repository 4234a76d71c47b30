# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The planar level as a stepper; it converts states in space to the plane and back."""

from collections.abc import Callable
import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.records import entry, Loop
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import FLAT, product, rotation_matrices
from snake_sim_ros.stepping.base import Inputs, Report
from snake_sim_ros.stepping.loops import Calls, End, LoopStepper, NO_PITCH, show, StepsInPlace
from snake_sim_ros.stepping.planar.model import (
    forget,
    make_planar_memory,
    make_planar_model,
    make_planar_workspace,
    PlanarMemory,
    PlanarModel,
    PlanarWorkspace,
)
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable
from snake_sim_ros.stepping.samples import Samples
from snake_sim_ros.stepping.state import copied, History, Memory, State
from snake_sim_ros.stepping.steps import make_steps, Record, Steps

ROUNDING = 1e-13  # tilts that differ from FLAT by less are FLAT


@entry
def to_space(
    joints: tuple[Array, Array],
    planar: tuple[Array, Array, Array],
    height: Array,
    links: Array,
    velocities: Array,
) -> None:
    """
    Fill the coordinates and velocities of all links from planar ones.

    Parameters
    ----------
    joints : tuple of ndarray, shape (n,)
        front and rear, as in `model.PlanarModel`.
    planar : tuple of ndarray
        q, u and tilt, as in `model.PlanarMemory`.
    height : ndarray, shape (n,)
        Heights of the link centers [m].
    links, velocities : ndarray, shapes (n, 7) and (n, 6)
        They are filled with q and u of `state.State`.

    """
    (q, u, tilt), (front, rear) = planar, joints
    x, y, reach_x, reach_y = q[0], q[1], 0.0, 0.0
    for i in range(len(u)):
        e0, e1, e2, e3 = tilt[i, 0], tilt[i, 1], tilt[i, 2], tilt[i, 3]
        part, along_x, along_y = 2.0 * (e1 * e3 + e0 * e2), math.cos(q[2 + i]), math.sin(q[2 + i])
        if i > 0:
            reach = rear[i] * part
            x, y = x + (reach_x + reach * along_x), y + (reach_y + reach * along_y)
        reach = front[i] * part
        reach_x, reach_y = reach * along_x, reach * along_y
        links[i, 0], links[i, 1], links[i, 2] = x, y, height[i]
        c, s = math.cos(q[2 + i] / 2), math.sin(q[2 + i] / 2)
        links[i, 3], links[i, 4] = c * e0 - s * e3, c * e1 - s * e2
        links[i, 5], links[i, 6] = c * e2 + s * e1, c * e3 + s * e0
        velocities[i, 0], velocities[i, 1], velocities[i, 2] = u[i, 0], u[i, 1], 0.0
        velocities[i, 3] = u[i, 2] * (2.0 * (e1 * e3 - e0 * e2))
        velocities[i, 4] = u[i, 2] * (2.0 * (e2 * e3 + e0 * e1))
        velocities[i, 5] = u[i, 2] * (e0 * e0 - e1 * e1 - e2 * e2 + e3 * e3)
        if i > 0:
            close_twist(links[i - 1], links[i], velocities[i])


@inlined
def close_twist(before: Array, link: Array, velocity: Array) -> None:
    """
    Roll a link until the axes of its joint with the link before are at right angles.

    Tilted links that keep their tilts while they bend would open the joint by these tilts. Spheres
    and joint points are on the axis of the link and stay where they are. `before` and `link`,
    shape (7,), are coordinates, and `velocity`, shape (6,), is that of the link, as in `to_space`.
    """
    a0, a1, a2, a3 = before[3], before[4], before[5], before[6]
    e0, e1, e2, e3 = link[3], link[4], link[5], link[6]
    y_x, y_y = 2.0 * (a1 * a2 - a0 * a3), a0 * a0 - a1 * a1 + a2 * a2 - a3 * a3
    y_z = 2.0 * (a2 * a3 + a0 * a1)
    x, y = e0 * e0 + e1 * e1 - e2 * e2 - e3 * e3, 2.0 * (e1 * e2 + e0 * e3)
    twist = y_x * x + y_y * y + y_z * (2.0 * (e1 * e3 - e0 * e2))
    if abs(twist) <= ROUNDING:
        return
    x, y = 2.0 * (e1 * e2 - e0 * e3), e0 * e0 - e1 * e1 + e2 * e2 - e3 * e3
    roll = -math.atan2(twist, y_x * x + y_y * y + y_z * (2.0 * (e2 * e3 + e0 * e1)))
    c, s = math.cos(roll / 2), math.sin(roll / 2)
    link[3], link[4] = c * e0 - s * e3, c * e1 + s * e2
    link[5], link[6] = c * e2 - s * e1, c * e3 + s * e0
    c, s = math.cos(roll), math.sin(roll)
    w_x, w_y = velocity[3], velocity[4]
    velocity[3], velocity[4] = c * w_x + s * w_y, c * w_y - s * w_x


@entry
def samples_to_space(
    joints: tuple[Array, Array],
    planar: tuple[Array, Array, Array],
    height: Array,
    count: int,
    links: Array,
    velocities: Array,
) -> None:
    """Fill a number of samples in space from planar ones, with what `to_space` takes."""
    q, u, tilt = planar
    for m in range(count):
        to_space(joints, (q[m], u[m], tilt), height, links[m], velocities[m])


class InPlane(NamedTuple):
    """What `loops.show` takes after steps in the plane; see `to_space`."""

    front: Array  # (n,)
    rear: Array  # (n,)
    q: Array  # (n+2,)
    u: Array  # (n, 3)
    tilt: Array  # (n, 4)
    height: Array  # (n,)
    links: Array  # (n, 7) filled
    velocities: Array  # (n, 6) filled
    sampled_q: Array  # (m, n+2)
    sampled_u: Array  # (m, n, 3)
    sampled_links: Array  # (m, n, 7) filled
    sampled_velocities: Array  # (m, n, 6) filled


@show.register(InPlane)
@compiled
def show_in_plane(shown: InPlane) -> None:
    """Fill coordinates and velocities of the links, now and at each sample."""
    joints, planar = (shown.front, shown.rear), (shown.q, shown.u, shown.tilt)
    to_space(joints, planar, shown.height, shown.links, shown.velocities)
    planar, count = (shown.sampled_q, shown.sampled_u, shown.tilt), len(shown.sampled_q)
    filled = shown.sampled_links, shown.sampled_velocities
    samples_to_space(joints, planar, shown.height, count, *filled)


@entry
def is_recalled(
    joints: tuple[Array, Array],
    memory: PlanarMemory,
    links: Array,
    velocities: Array,
    made_links: Array,
    made_velocities: Array,
) -> bool:
    """Return whether the planar coordinates of a memory give these links, to the bit."""
    q, u, tilt = memory.q, memory.u, memory.tilt
    to_space(joints, (q, u, tilt), links[:, 2], made_links, made_velocities)
    for i in range(len(u)):
        for k in range(7):
            if made_links[i, k] != links[i, k]:
                return False
        for k in range(6):
            if made_velocities[i, k] != velocities[i, k]:
                return False
    return True


class PlanarStepper(LoopStepper):
    """
    A stepper with a loop over steps in the plane.

    Links keep their heights and tilts, which are those of a robot that lies flat up to the
    tolerances of `levels`, but for the rolls that keep joints closed; see `close_twist`. Where
    joints have one axis, no tilts keep them closed as they bend, and links lie flat at once. The
    contact impulses of the first step stop their velocities out of the plane, as in any inelastic
    impact.

    Parameters
    ----------
    scene : Scene
    loop : callable
        As of `LoopStepper`, for the records of the plane. It ends before the first step that is
        not planar, and reports that.
    scheme : NamedTuple of arrays, optional
        The part `scheme` of `model.PlanarMemory` before the first step.

    """

    level = 'planar'
    model: PlanarModel
    work: PlanarWorkspace

    def __init__(
        self, scene: Scene, loop: Callable[..., None], scheme: Memory | None = None
    ) -> None:
        n, places = scene.robot.link_count, scene.robot.chain.places
        memory = make_planar_memory(n, scheme)
        model, work = make_planar_model(scene), make_planar_workspace(scene)
        super().__init__(scene, loop, model, work, memory)
        self.joints = model.front, model.rear
        self.keeps_tilts = places.complete and places.straight
        inertia = scene.robot.chain.inertia
        self.uneven = inertia[:, 0, 0] - inertia[:, 1, 1]  # about the axes e_x and e_y of a link
        self.made = np.empty((n, 7)), np.empty((n, 6))  # see is_recalled

    def take_steps(
        self, state: State, history: History, inputs: Inputs
    ) -> tuple[State, History, Report]:
        """Advance with checked arguments, of which the history is changed in place."""
        angle, rate, kept, pushes = inputs
        goes_on = self.goes_on(state, history.memory)
        q, u, tilt = self.coordinates(state, history.memory, goes_on)
        kept = kept.until(len(angle))
        record = self.record_of(kept)
        steps = make_steps((q, u), history, (angle, rate), record, pushes)
        report = self.run_loop(steps)
        if steps.report['not_planar'][0]:
            report.left = self.reason()
        if report.failure:
            history = self.empty_history()
        if report.steps == 0:
            return state, history, report
        height = self.heights(state)
        end = self.in_space(q, u, tilt, height)
        if len(kept.q):
            reached = kept.reached_by(report.steps)
            planar = record.q, record.u, tilt
            samples_to_space(self.joints, planar, height, reached, kept.q, kept.u)
            kept.is_planar[:reached] = True
        self.remember(history.memory, q, u, tilt)
        return end, history, report

    def record_of(self, kept: Samples) -> Record:
        """Return what the loop keeps for samples, with coordinates in the plane."""
        m, n = kept.q.shape[:2]
        planar = np.empty((m, n + 2)), np.empty((m, n, 3))
        return Record(kept.every, kept.first, *planar, *kept[4:-1])

    def in_space(self, q: Array, u: Array, tilt: Array, height: Array) -> State:
        """Return the state of the links, see `to_space`."""
        end = State(np.empty((len(u), 7)), np.empty((len(u), 6)))
        to_space(self.joints, (q, u, tilt), height, end.q, end.u)
        return end

    def heights(self, state: State) -> Array:
        """Return the heights of the link centers while a robot moves in the plane, (n,) [m]."""
        return state.q[:, 2].copy() if self.keeps_tilts else self.model.heights

    def in_place(
        self, count: int, state: State, history: History, pushes: PushTable, every: int = 0
    ) -> StepsInPlace | None:
        """
        Return steps that continue from a state and its history; see `StepsInPlace`.

        It is None if the step before was not planar, or if the loop is not compiled.
        """
        if not (isinstance(self.loop, Loop) and self.goes_on(state, history.memory)):
            return None
        coordinates = self.coordinates(state, history.memory, True)
        calls = Calls(count, every, pushes, NO_PITCH)
        return self.going_on(calls, state, history, coordinates)

    def going_on(
        self, calls: Calls, state: State, history: History,
        coordinates: tuple[Array, Array, Array],
    ) -> StepsInPlace:  # fmt: skip
        """Return steps that continue from planar coordinates, at the heights of a state."""
        height, (q, u, tilt) = self.heights(state), coordinates

        def remembered(steps: Steps) -> History:
            history = copied(steps.history)
            self.remember(history.memory, steps.q, steps.u, tilt)
            return history

        def shown(steps: Steps, kept: Samples, links: Array, velocities: Array) -> InPlane:
            planar, record = (steps.q, steps.u, tilt), steps.record
            filled = links, velocities, record.q, record.u, kept.q, kept.u
            return InPlane(*self.joints, *planar, height, *filled)

        return StepsInPlace(self, calls, (q, u), history, End(remembered, shown), state)

    def prepare(self, state: State) -> None:
        """Compile steps in place, and what is around the loop."""
        height, history = self.heights(state), self.empty_history()
        memory = history.memory
        q, u, tilt = self.coordinates(state, memory, self.goes_on(state, memory))
        calls = Calls(1, 1, NO_PUSHES, NO_PITCH)
        self.going_on(calls, state, history, (q, u, tilt)).prepare()
        self.in_space(q, u, tilt, height)
        kept = self.no_samples
        record = self.record_of(kept)
        samples_to_space(self.joints, (record.q, record.u, tilt), height, 0, kept.q, kept.u)

    def reason(self) -> str:
        """Return why the next step is not planar, as a clause."""
        model = self.model
        loads: Array = self.work.contacts['solution']['impulse'][: model.floor, 0]
        if (a := int(loads.argmin())) >= 0 and not loads[a] > 0.0:
            i = a if a < len(model.mass) else int(np.flatnonzero(model.second == a)[0])
            in_front = (model.offset[i] >= 0.0) == (a == i)
            end = ('front ' if in_front else 'rear ') if model.spheres_of_link[i] > 1.0 else ''
            return f'the {end}sphere of link {i + 1} would lift off'
        if self.slips:
            return (
                f'rolling would shift the robot by more than {100 * self.model.most_slip:g} % of '
                'its way'
            )
        if self.tires:
            return 'loads and friction take more iterations together than a step in space'
        if self.is_overloaded:
            return 'a pitch joint would need more torque than its limit to hold the robot flat'
        if not self.rolls_or_lifts:
            return 'the contacts in the plane did not converge'
        return 'the robot would roll: its pitch joints do not hold it flat'

    @property
    def slips(self) -> bool:
        """Whether the last step was not planar because contacts slip too far by rolling."""
        return bool(self.work.standing['slips'][0])

    @property
    def tires(self) -> bool:
        """Whether the last steps took more iterations than the plane is worth."""
        return bool(self.work.standing['tires'][0])

    @property
    def is_overloaded(self) -> bool:
        """Whether the last step was not planar because of the torque of a pitch joint."""
        return bool(self.work.standing['overloaded'][0])

    @property
    def rolls_or_lifts(self) -> bool:
        """Whether the last step was not planar because the robot would roll or lift off."""
        standing = self.work.standing[0]
        rolls = not abs(standing['roll']) <= self.model.most_roll
        return bool(not standing['least_load'] > 0.0 or rolls)

    def coordinates(
        self, state: State, memory: PlanarMemory, goes_on: bool
    ) -> tuple[Array, Array, Array]:
        """
        Return q, u and tilt of a state, as in `model.PlanarMemory`.

        The momentum of the state out of the plane is kept for the first step.
        """
        n = len(self.model.mass)
        q, u, tilt = np.empty(n + 2), np.empty((n, 3)), np.empty((n, 4))
        self.work.impact.fill(0.0)
        if goes_on:
            return memory.q.copy(), memory.u.copy(), memory.tilt.copy()
        forget(memory)
        R = rotation_matrices(state.q[:, 3:])
        theta = np.unwrap(np.arctan2(R[:, 1, 2], R[:, 0, 2]))  # joints bend by less than pi
        zero = np.zeros(n)
        back = np.stack([np.cos(theta / 2), zero, zero, -np.sin(theta / 2)], axis=-1)
        tilt = product(back, state.q[:, 3:])
        least = ROUNDING if self.keeps_tilts else math.inf
        tilt[np.abs(tilt - FLAT).max(axis=1) < least] = FLAT
        spin = np.einsum('ijk,ik->ij', R, state.u[:, 3:])
        u[:, :2], u[:, 2] = state.u[:, :2], spin[:, 2]
        q[:2], q[2:] = state.q[0, :2], theta
        self.take_up(state, R, spin)
        roll = np.arcsin(R[:, 2, 0])
        memory.roll[0] = math.copysign(np.abs(roll).max(), roll[n // 2])
        return q, u, tilt

    def goes_on(self, state: State, memory: PlanarMemory) -> bool:
        """Return whether the last step was planar and led to this state, to the bit."""
        same = is_recalled(self.joints, memory, state.q, state.u, *self.made)
        return bool(same and memory.known[0])

    def take_up(self, state: State, R: Array, spin: Array) -> None:
        """Fill work.impact from a state with frames R and angular velocities (n, 3), both in I."""
        center = state.q[:, :2] - state.q[len(R) // 2, :2]
        lift = self.model.mass * state.u[:, 2]
        axial = np.einsum('ij,ij->i', R[:, :, 2], spin)[:, None] * R[:, :, 2]
        across, along = self.model.inertia, self.model.inertia_axial
        turning = across[:, None] * spin + (along - across)[:, None] * axial
        pitching = np.einsum('ij,ij->i', R[:, :, 0], spin)[:, None] * R[:, :, 0]
        turning += self.uneven[:, None] * pitching
        self.work.impact[:, 0] = center[:, 1] * lift + turning[:, 0]
        self.work.impact[:, 1] = -center[:, 0] * lift + turning[:, 1]
        self.work.impact[:, 2] = lift

    def remember(self, memory: PlanarMemory, q: Array, u: Array, tilt: Array) -> None:
        """Fill the memory with q, u and tilt."""
        memory.q[:], memory.u[:], memory.tilt[:] = q, u, tilt
        memory.known[0] = 1.0
