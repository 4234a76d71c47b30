# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Model levels: the smallest model that a scene needs, chosen while it runs.

The planar level is exact for a robot that lies flat and whose pitch references are zero.
`LevelStepper` uses it as long as that holds. It changes to the spatial level at the first step in
which it does not hold, and changes back once the robot has been lying flat and still for a while.
This does not reveal rolling, so that it changes back SLIP_PAUSE after rolling. Both levels have
the same state and the same contacts: pose, velocities and impulses are carried over unchanged.
"""

import time
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.dynamics.joint_control import make_control_loop
from snake_sim_ros.dynamics.kinematics import FLAT_GAP, FLAT_TILT, STILL_SPEED
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, Robot, Scene
from snake_sim_ros.scene.posture import chain_coordinates, gaps
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import Inputs, Method, Report, Stepper
from snake_sim_ros.stepping.loops import LoopStepper, NO_PITCH, PITCH, PITCH_ROUNDING, StepsInPlace
from snake_sim_ros.stepping.planar.model import forget, PlanarMemory
from snake_sim_ros.stepping.planar.stepper import PlanarStepper
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable
from snake_sim_ros.stepping.samples import checked, Samples
from snake_sim_ros.stepping.spatial import SpatialStepper
from snake_sim_ros.stepping.state import copied, History, is_finite, Memory, Returned, State
from snake_sim_ros.stepping.steps import Steps

AUTO_ROLL = 3e-4  # largest roll that `auto` neglects [rad]
AUTO_SLIP_SHARE = 2e-3  # largest slip by rolling that `auto` neglects, as a share of the way
SLIP_PAUSE = 10.0  # time at the spatial level after a larger slip, or with MOST_EFFORT [s]
# Iterations of a planar step, in the mean, up to which it takes less time than one in space: of
# robots given link by link, most of whose links are rigid against each other out of the plane.
MOST_EFFORT = 4.0
# Directions and places of links given one by one that differ by less are the same: the rounding of
# numbers in files.
SAME_DIRECTION = 1e-5  # [1]
SAME_PLACE = 1e-6  # [m]
CHAIN_ITERATIONS = 40  # most of a single step of these
PLANAR_ITERATIONS = 300  # most iterations of a planar step, before the spatial level takes it


def what_is_not_planar(scene: Scene, name: str, method: Method) -> str:
    """
    Return the first reason why a scene is not planar, as a clause; empty if it is.

    Parameters
    ----------
    scene : Scene
    name : str
        Name of the method, for the clause.
    method : Method

    """
    if method.planar is None:
        return f'method {name} has no planar level'
    if reason := what_is_not_flat(scene) or what_is_not_in_plane(scene):
        return reason
    if scene.friction.rolling > 0.0:
        return f'friction.rolling is {scene.friction.rolling:g}, and in the plane nothing rolls'
    if scene.self_contact:
        return 'self_contact is true, and in the plane links do not touch'
    if scene.pegs.x and not method.planar_pegs:
        return f'method {name} meets pegs at the spatial level only'
    if scene.solver.normal_compliance == 0.0:
        return 'solver.normal_compliance is 0, and loads in the plane follow the selection rule'
    if scene.robot.per_joint('friction').any():
        return 'robot.joint_friction may hold pitch joints, and in the plane only springs do'
    if make_control_loop(scene).present:
        return 'the robot has a control loop of its own, and in the plane pitch joints are rigid'
    if scene.drift_correction == 'none':
        return 'drift_correction is none, and in the plane joints do not drift'
    return ''


def what_is_not_flat(scene: Scene) -> str:
    """Return why a straight robot does not lie flat in a scene, as a clause; empty if it does."""
    gx, gy, gz = scene.gravity
    if gx != 0.0 or gy != 0.0 or gz >= 0.0:
        return f'gravity ({gx:g}, {gy:g}, {gz:g}) m/s^2 is not straight down'
    if scene.ground.heights:
        return 'ground.heights is given, and the plane is flat'
    if scene.world:
        return 'world has solids, and the plane is flat'
    if scene.robot.links:
        return what_does_not_lie_straight(scene.robot)
    radius = scene.robot.per_link('contact_radius')
    if radius.min() < radius.max():
        return (
            f'robot.contact_radius differs from link to link, {radius.min():g} to '
            f'{radius.max():g} m, so that the robot does not lie flat'
        )
    return ''


def what_does_not_lie_straight(robot: Robot) -> str:
    """
    Return why links given one by one do not lie flat on a floor, as a clause; empty if they do.

    Their joints then turn about upright axes or axes across the links, are in one line when all
    joints are at 0, and all spheres touch the floor.
    """
    places, spheres, names = robot.chain.places, robot.chain.spheres, robot.link_names
    turned = np.abs(np.stack([places.inner, places.outer]) - np.eye(3)).max(axis=(0, 2, 3))
    if turned.max(initial=0.0) > SAME_DIRECTION:
        j = int(turned.argmax())
        axis = robot.joints[j].name or f'joint {j + 1}'
        return f'{axis} turns about an axis that is neither upright nor across the links beside it'
    gap = gaps(robot, chain_coordinates(robot, np.zeros((robot.link_count - 1, 2))))
    if np.ptp(gap) > SAME_PLACE:
        a = int(gap.argmax())
        return (
            f'a sphere of link {names[spheres.link[a]]} is {np.ptp(gap):.3g} m above the floor '
            'when all joints are at 0'
        )
    return ''


def what_is_not_in_plane(scene: Scene) -> str:
    """Return why the planar level has not the links of a robot, as a clause; empty if it has."""
    robot = scene.robot
    if not robot.links:
        return ''
    chain, names = robot.chain, robot.link_names
    places, spheres, capsules = chain.places, chain.spheres, chain.capsules
    if not robot.joints:
        return f'link {names[0]} has no joint, which would hold it flat'
    count = np.diff(spheres.begin)
    if not np.isin(count, (1, 2)).all():
        i = int(np.isin(count, (1, 2)).argmin())
        return f'link {names[i]} has {count[i]} spheres, and in the plane links have one or two'
    apart = np.abs(np.concatenate([places.distal[:-1], places.proximal[1:]])[:, :2]).max(axis=1)
    links = np.concatenate([np.arange(len(names) - 1), np.arange(1, len(names)), spheres.link])
    apart = np.concatenate([apart, np.abs(spheres.place[:, 0])])
    if apart.max() > SAME_PLACE:
        i = links[apart.argmax()]
        return (
            f'the center of mass of link {names[i]} is {apart.max():.3g} m beside the line of its '
            'joints and spheres'
        )
    products = np.abs(chain.inertia[:, 1, [0, 2]]).max(axis=1) / chain.inertia[:, 1, 1]
    if products.max() > SAME_DIRECTION:
        name = names[int(products.argmax())]
        return f'link {name} has products of inertia with the upright axis'
    high = np.maximum(np.abs(capsules.center[:, :2]).max(axis=1), np.abs(capsules.axis[:, 1]))
    if scene.pegs.x and high.max() > SAME_PLACE:
        i = capsules.link[high.argmax()]
        return f'shapes of link {names[i]} do not touch pegs at the height of its joints'
    return ''


def is_vertical(angle: Array, rate: Array) -> Array:
    """Return whether a pitch reference is not zero, shape (...) for references (..., n-1, 2)."""
    pitch = angle[..., 1], rate[..., 1]
    if not (pitch[0].any() or pitch[1].any()):
        return np.zeros(angle.shape[:-2], dtype=bool)
    return np.asarray(np.abs(pitch).max(axis=(0, -1), initial=0.0) > PITCH_ROUNDING)


def what_does_not_lie(scene: Scene, state: State) -> str:
    """Return why a robot does not lie flat and still in a state, as a clause; empty if it does."""
    gap = gaps(scene.robot, state.q)
    R = rotation_matrices(state.q[:, 3:])
    omega = np.einsum('ijk,ik->ij', R, state.u[:, 3:])
    radius = scene.robot.per_link('contact_radius')[:, None]
    speed = np.abs(np.column_stack([state.u[:, 2], (radius * omega)[:, :2]])).max(axis=1)
    if not (np.abs(gap) <= FLAT_GAP).all():
        a = int(np.abs(gap).argmax())
        link = scene.robot.chain.spheres.link[a] + 1
        return f'link {link} has a gap of {gap[a]:.3g} m to the floor'
    if not (np.abs(R[:, 2, 0]) <= FLAT_TILT).all():
        i = int(np.abs(R[:, 2, 0]).argmax())
        return f'link {i + 1} is rolled by {np.arcsin(R[i, 2, 0]):.3g} rad'
    if scene.robot.links and not (np.abs(R[:, 2, 2]) <= FLAT_TILT).all():
        i = int(np.abs(R[:, 2, 2]).argmax())
        return f'link {i + 1} is pitched by {-np.arcsin(R[i, 2, 2]):.3g} rad'
    if not (speed <= STILL_SPEED).all():
        return f'link {int(speed.argmax()) + 1} moves vertically at {speed.max():.3g} m/s'
    return ''


class LevelMemory(NamedTuple):
    """The memories of both levels; only that of the level which took the last step is filled."""

    planar: PlanarMemory  # with slip and way, which stay
    spatial: Memory | None  # None: the method keeps nothing

    def last_span(self) -> float:
        """Return the time for which the last impulses acted [s], 0 before the first step."""
        memory: Memory | None = self.planar if self.planar.known[0] else self.spatial
        return memory.last_span() if memory else 0.0


_compiled: set[Any] = set()  # what `LoopStepper.code` returned for levels of this process


class LevelStepper:
    """
    A stepper of the planar level while that is exact, and of the spatial one otherwise.

    In a scene with an accuracy, the planar level may be off by no more than that.

    Parameters
    ----------
    scene : Scene
    planar : PlanarStepper
    spatial : SpatialStepper

    """

    def __init__(self, scene: Scene, planar: PlanarStepper, spatial: SpatialStepper) -> None:
        self.scene, self.planar, self.spatial = scene, planar, spatial
        rigid = bool(scene.robot.links)
        limit = CHAIN_ITERATIONS if rigid else PLANAR_ITERATIONS
        limit = min(scene.iteration_limit, limit)
        slip, share = planar.model.free_slip, AUTO_SLIP_SHARE
        if scene.accuracy > 0.0:
            length = float(scene.robot.per_link('link_length').mean())
            slip, share = min(slip, scene.accuracy * length), min(share, scene.accuracy)
        planar.model = planar.model._replace(
            most_roll=AUTO_ROLL, free_slip=slip, most_slip=share, patient=False,
            iteration_limit=limit, most_effort=MOST_EFFORT if rigid else np.inf,
        )  # fmt: skip
        self.level = planar.level
        self.settle_steps = max(1, round(scene.settling_time / scene.dt))
        self.pause_steps = round(SLIP_PAUSE / scene.dt)  # added to settle_steps in history
        self.ticks: list[Array] = []  # time stamps of the parts of the last call
        self.reason = ''  # why the last spatial steps were not planar
        self.used: set[str] = set()  # levels that took steps, or may
        self.compile_seconds = 0.0
        memory = LevelMemory(planar.empty.memory, spatial.empty.memory)
        self.empty = planar.empty._replace(memory=memory)
        self.returned = Returned(scene.robot.link_count, self.empty)

    def empty_history(self) -> History:
        """Return the history before the first step."""
        return self.returned.empty_history()

    def limit_iterations(self, limit: int) -> None:
        """Let a spatial step take that many iterations at most; planar ones have their own."""
        self.spatial.limit_iterations(limit)

    def advance(
        self, state: State, history: History, angle: Array, rate: Array,
        samples: Samples | None = None, pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """Return state, history and report after as many steps as there are references."""
        self.returned.check(state, history, angle, rate)
        samples = checked(samples, self.spatial.no_samples)
        history, report = copied(history), Report(level=self.level)
        vertical = is_vertical(angle, rate) | pushes.lift(len(angle))
        start, self.ticks = 0, []
        while start < len(vertical) and not report.failure:
            changes = vertical[start:] != vertical[start]
            part = slice(start, start + int(changes.argmax()) if changes.any() else None)
            reason = ''
            if vertical[start]:
                given = angle[start], rate[start]
                reason = what_is_commanded(self.scene.robot, *given, pushes.after(start))
            elif history.settling[0] <= 0:
                reason = self.why_not_flat(state, history.memory.planar)
            if reason:
                history.settling[0] = max(history.settling[0], self.settle_steps)
                self.reason = reason
            is_planar = history.settling[0] <= 0
            stepper: LoopStepper = self.planar if is_planar else self.spatial
            pause = max(0, int(history.settling[0]) - self.settle_steps)
            if not is_planar:
                if history.memory.planar.known[0]:
                    forget(history.memory.planar)
                self.spatial.watch(0 if vertical[start] or pause else self.settle_steps)
                if pause:
                    part = slice(start, min(start + pause, part.stop or len(vertical)))
            self.prepare(stepper.level, state)
            inputs = Inputs(angle[part], rate[part], samples.after(start), pushes.after(start))
            state, history, news = self.take_steps(stepper, state, history, inputs)
            history.settling[0] -= min(pause, news.steps)
            if news.left:
                if not is_finite(history):
                    history = self.empty_history()  # the numbers are of a step that was not taken
                pause = self.pause_steps if self.planar.slips or self.planar.tires else 0
                history.settling[0], self.reason = self.settle_steps + pause, news.left
                self.note_leaving(history.memory.planar)
            news.left = '' if is_planar else self.reason
            self.ticks.append(stepper.cycles[: news.steps + 1])
            report = report + news if report.steps else news
            start += news.steps
        self.level, self.returned.last = report.level, (state, history)
        return state, history, report

    def take_steps(
        self, stepper: LoopStepper, state: State, history: History, inputs: Inputs
    ) -> tuple[State, History, Report]:
        """Advance one level with its own memory, and empty the memory of the other one."""
        memory, level = history.memory, stepper.level
        if level == 'planar' and not memory.planar.known[0]:
            memory = memory._replace(spatial=copied(self.empty.memory.spatial))
        own = history._replace(memory=getattr(memory, level))
        state, history, report = stepper.take_steps(state, own, inputs)
        memory = memory._replace(**{level: history.memory})
        return state, history._replace(memory=memory), report

    def why_not_flat(self, state: State, memory: PlanarMemory) -> str:
        """Return why the planar level does not take a state, as a clause; empty if it does."""
        return '' if self.planar.goes_on(state, memory) else what_does_not_lie(self.scene, state)

    def in_place(
        self, count: int, state: State, history: History, pushes: PushTable, every: int = 0
    ) -> StepsInPlace | None:
        """Return steps that continue the last call; None if the level changed in it."""
        memory, is_planar = history.memory, history.settling[0] <= 0
        level = 'planar' if is_planar else 'spatial'
        if len(self.ticks) > 1 or level != self.level:
            return None
        own = history._replace(memory=getattr(memory, level))
        found: StepsInPlace | None
        if is_planar:
            found = self.planar.in_place(count, state, own, pushes, every)
        else:
            pauses = history.settling[0] > self.settle_steps
            pitch = NO_PITCH if self.spatial.model.settle_steps or pauses else PITCH
            found = self.spatial.in_place(count, state, own, pushes, every, pitch)
            if pauses:
                found.pause_ends = self.settle_steps
        if not found:
            return None
        # What a call notes of its steps stays until the next one.
        found.steps.cycles[:] = self.ticks[0]
        history_of = found.end.history

        def whole(steps: Steps) -> History:
            history = history_of(steps)
            return history._replace(memory=memory._replace(**{level: history.memory}))

        found.end, found.left = found.end._replace(history=whole), '' if is_planar else self.reason
        self.ticks = [found.steps.cycles]
        return found

    @property
    def cycles(self) -> Array:
        """Time stamps of the steps of the last call, from 0, without the time between parts."""
        return np.cumsum(np.concatenate([[0], *map(np.diff, self.ticks)]))

    def note_leaving(self, memory: PlanarMemory) -> None:
        """
        Reset or increase the slip in the memory when the planar level is left.

        A slip that was too far is over after the pause at the spatial level. A robot that leaves
        the plane because it rolls or lifts off will roll by AUTO_ROLL and back, and slip as far,
        except among pegs, which hold it.
        """
        if self.planar.slips:
            memory.slip[0] = memory.way[0] = 0.0
        elif self.planar.rolls_or_lifts and not self.scene.pegs.x:
            memory.slip[0] += 2.0 * self.planar.model.height * AUTO_ROLL

    def prepare(self, level: str, state: State) -> None:
        """Compile a level, by a call without steps and steps in place, if this process did not."""
        if level in self.used:
            return
        stepper: LoopStepper = self.planar if level == 'planar' else self.spatial
        code = stepper.code()
        if code is None or code not in _compiled:
            begin = time.perf_counter()
            none = np.zeros((0, self.scene.robot.link_count - 1, 2))
            if level == 'planar':
                self.planar.prepare(state)
            else:
                own = self.spatial.empty_history()
                self.spatial.in_place(1, state, own, NO_PUSHES).prepare()
            inputs = Inputs(none, none, stepper.no_samples, NO_PUSHES)
            self.take_steps(stepper, state, self.empty_history(), inputs)
            self.compile_seconds += time.perf_counter() - begin
            _compiled.add(code)
        self.used.add(level)


def what_is_commanded(
    robot: Robot, angle: Array, rate: Array, pushes: PushTable = NO_PUSHES
) -> str:
    """Return the largest pitch reference of a step, or the push that lifts, as a clause."""
    if not is_vertical(angle, rate):
        p = pushes.lifting(1)[0]
        return f'link {pushes.link[p] + 1} is pushed out of the plane'
    commanded = np.abs([angle[:, 1], rate[:, 1]])
    kind, j = np.unravel_index(int(commanded.argmax()), commanded.shape)
    value, unit = ((angle, 'rad'), (rate, 'rad/s'))[kind]
    name = dict(zip(robot.axis_places.tolist(), robot.axis_names, strict=True))
    return f'{name.get(2 * j + 1, "pitch")} is commanded to {value[j, 1]:.3g} {unit}'


class FlatStepper:
    """
    A stepper of the planar level alone; see `base.Stepper`.

    A step that is not planar ends the call with a failure that says why. The state is then the
    last good one.
    """

    level = 'planar'

    def __init__(self, scene: Scene, planar: PlanarStepper) -> None:
        self.scene, self.planar, self.cycles = scene, planar, planar.cycles

    def empty_history(self) -> History:
        """Return the history before the first step."""
        return self.planar.empty_history()

    def limit_iterations(self, limit: int) -> None:
        """Let a step take that many iterations at most."""
        self.planar.limit_iterations(limit)

    def advance(
        self, state: State, history: History, angle: Array, rate: Array,
        samples: Samples | None = None, pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """Return state, history and report after as many steps as there are references."""
        self.planar.returned.check(state, history, angle, rate)
        vertical = is_vertical(angle, rate) | pushes.lift(len(angle))
        stop = int(vertical.argmax()) if vertical.any() else len(vertical)
        report = Report(level=self.level)
        goes_on = self.planar.goes_on(state, history.memory)
        reason = '' if goes_on else what_does_not_lie(self.scene, state)
        if not reason:
            given = angle[:stop], rate[:stop]
            state, history, report = self.planar.advance(state, history, *given, samples, pushes)
            self.cycles, reason, report.left = self.planar.cycles, report.left, ''
            if not reason and not report.failure and stop < len(vertical):
                given = angle[stop], rate[stop]
                reason = what_is_commanded(self.scene.robot, *given, pushes.after(stop))
        if reason:
            report.failure = f'level planar: {reason}; choose level spatial or auto'
        return state, history, report

    def in_place(
        self, count: int, state: State, history: History, pushes: PushTable, every: int = 0
    ) -> StepsInPlace | None:
        """Return steps that continue from a state and its history; see `StepsInPlace`."""
        return self.planar.in_place(count, state, history, pushes, every)


def stepper_of_level(scene: Scene, method: Method) -> Stepper:
    """
    Return the stepper of a method for the level of a scene.

    Parameters
    ----------
    scene : Scene
        Its `method` is the name of `method`.
    method : Method
        One of `methods.METHODS`.

    Raises
    ------
    ParameterError
        If its level is planar and it is not.

    """
    reason = what_is_not_planar(scene, scene.method, method)
    if reason and scene.level == 'planar':
        raise ParameterError(f'level planar: {reason}; choose level spatial or auto')
    if method.planar is None or reason or scene.level == 'spatial':
        stepper: Stepper = method.spatial(scene)
        return stepper
    if scene.level == 'planar':
        return FlatStepper(scene, method.planar(scene))
    return LevelStepper(scene, method.planar(scene), method.spatial(scene))
