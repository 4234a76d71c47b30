"""
Model levels: the smallest model that a scene needs, chosen while it runs.

The planar level is exact for a robot that lies flat and is told nothing vertical. `LevelStepper`
takes it as long as that holds, goes over to the spatial level at the first step in which it does
not, and comes back when the robot has been lying flat and still for a while; where rolling was in
the way, which does not show in that, after a PAUSE. Both levels have the same state and the same
history: pose, velocities and impulses are carried over as they are.
"""

from collections.abc import Callable
import time
from typing import Any

import numpy as np

from snake_sim_ros.dynamics.kinematics import FLAT_GAP
from snake_sim_ros.dynamics.kinematics import FLAT_TILT
from snake_sim_ros.dynamics.kinematics import STILL
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.scene.quantities import ParameterError
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import check_arguments
from snake_sim_ros.stepping.base import method_of
from snake_sim_ros.stepping.base import no_history
from snake_sim_ros.stepping.base import PREVIOUS
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.base import SETTLING
from snake_sim_ros.stepping.base import State
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.planar.moreau import SLIP
from snake_sim_ros.stepping.planar.moreau import WAY
from snake_sim_ros.stepping.planar.stepper import forget
from snake_sim_ros.stepping.planar.stepper import KNOWN
from snake_sim_ros.stepping.planar.stepper import PlanarStepper
from snake_sim_ros.stepping.spatial import SpatialStepper

LITTLE = 3e-4  # roll up to which leaving it out is exact enough to be chosen [rad]
LITTLE_SLIP = 2e-3  # share of the way up to which the slip by rolling is, see planar
PAUSE = 10.0  # how long a robot that slips more is left to the spatial level [s]
PATIENCE = 300  # iterations after which a planar step is left to the spatial level
# Where the spatial level is faster. Processor time of both levels in turn, in one process, cases A
# and B: at the default tolerance `bdf2` with 11 links takes 0.6 to 0.85 of the planar time from
# 1/200 s to 1/20 s (5 links: 0.6 to 1.2), 1.1 at 1/500 s, 1.3 and more at 1/1000 s. But with 20
# and 40 links it takes 1.05 to 14 times as long, and with residual_tolerance 1e-5 m/s 1.6 to 1.9
# times at 1/200 s, 0.85 at 1/20 s. `newton` gains a quarter in space at most, and loses from 1/20
# s on.
LARGE_STEP, FEW_LINKS, TIGHT = 1 / 300, 15, 1e-7  # [s], links, [m/s]
STRAIGHT = 1e-9  # pitch references up to this are none [rad], [rad/s]


def what_is_not_planar(scene: Scene) -> str:
    """Return what of a scene has no place in the plane, as a clause; empty if nothing."""
    gx, gy, gz = scene.gravity
    radius = scene.robot.per_link('contact_radius')
    if gx != 0.0 or gy != 0.0 or gz >= 0.0:
        return f'gravity ({gx:g}, {gy:g}, {gz:g}) m/s^2 is not straight down'
    if scene.friction.rolling > 0.0:
        return f'friction.rolling is {scene.friction.rolling:g}, and in the plane nothing rolls'
    if scene.ground.heights:
        return 'ground.heights is given, and the plane is flat'
    if scene.self_contact:
        return 'self_contact is true, and in the plane links do not touch'
    if scene.pegs.x and (method := method_of(scene)) != 'newton':
        return f'method {method} meets pegs at the spatial level only'
    if np.ptp(radius) > 0.0:
        return (
            f'robot.contact_radius differs from link to link, {radius.min():g} to '
            f'{radius.max():g} m, so that the robot does not lie flat'
        )
    if scene.solver.normal_compliance == 0.0:
        return 'solver.normal_compliance is 0, and loads in the plane follow the selection rule'
    if scene.drift_correction == 'none':
        return 'drift_correction is none, and in the plane joints do not drift'
    return ''


def is_faster_in_space(scene: Scene) -> bool:
    """Return whether the spatial level takes less time for a planar scene, see LARGE_STEP."""
    return (
        method_of(scene) == 'bdf2'
        and scene.dt > LARGE_STEP
        and scene.robot.link_count <= FEW_LINKS
        and scene.solver.residual_tolerance < TIGHT
    )


def is_vertical(angle: Array, rate: Array) -> Array:
    """Return whether any pitch joint is told to move, shape (...) for references (..., n-1, 2)."""
    pitch = angle[..., 1], rate[..., 1]
    if not (pitch[0].any() or pitch[1].any()):
        return np.zeros(angle.shape[:-2], dtype=bool)
    return np.asarray(np.abs(pitch).max(axis=(0, -1), initial=0.0) > STRAIGHT)


def what_does_not_lie(planar: PlanarStepper, scene: Scene, state: State, history: Array) -> str:
    """Return what of a state keeps a robot from lying flat and still, as a clause, or nothing."""
    if planar.goes_on(state, history):
        return ''
    n = scene.robot.link_count
    gap = gaps(scene.robot, state.q)
    R = rotation_matrices(state.q[:, 3:])
    omega = np.einsum('ijk,ik->ij', R, state.u[:, 3:])
    radius = scene.robot.per_link('contact_radius')[:, None]
    speed = np.abs(np.column_stack([state.u[:, 2], (radius * omega)[:, :2]])).max(axis=1)
    if not (np.abs(gap) <= FLAT_GAP).all():
        a = int(np.abs(gap).argmax())
        return f'link {a % n + 1} has a gap of {gap[a]:.3g} m to the floor'
    if not (np.abs(R[:, 2, 0]) <= FLAT_TILT).all():
        i = int(np.abs(R[:, 2, 0]).argmax())
        return f'link {i + 1} is rolled by {np.arcsin(R[i, 2, 0]):.3g} rad'
    if not (speed <= STILL).all():
        return f'link {int(speed.argmax()) + 1} moves vertically at {speed.max():.3g} m/s'
    return ''


class LevelStepper:
    """
    The planar level while it is exact, else the spatial one; see `base.Stepper`.

    Parameters
    ----------
    scene : Scene
    planar : PlanarStepper
    spatial : SpatialStepper

    """

    def __init__(self, scene: Scene, planar: PlanarStepper, spatial: SpatialStepper) -> None:
        self.scene, self.planar, self.spatial = scene, planar, spatial
        limit = min(scene.solver.iteration_limit, PATIENCE)
        planar.model = planar.model._replace(
            most_lean=LITTLE, most_slip=LITTLE_SLIP, patient=False, iteration_limit=limit
        )
        self.level = planar.level
        self.settle_steps = max(1, round(scene.settling_time / scene.dt))
        self.pause_steps = round(PAUSE / scene.dt)  # in history besides settle_steps
        self.ticks: list[Array] = []  # time stamps of the parts of the last call
        self.reason = ''  # why the last spatial steps were not planar
        self.used: list[Any] = []  # levels that are compiled
        self.compile_seconds = 0.0

    def advance(
        self, state: State, history: Array, angle: Array, rate: Array
    ) -> tuple[State, Array, Report]:
        """Return state, history and report after as many steps as there are references."""
        counts = self.scene.robot.link_count, len(self.planar.work.contact)
        check_arguments(*counts, state, history, angle, rate)
        history, report = history.copy(), Report(level=self.level)
        vertical = is_vertical(angle, rate)
        start, self.ticks = 0, []
        while start < len(vertical) and not report.failure:
            changes = vertical[start:] != vertical[start]
            part = slice(start, start + int(changes.argmax()) if changes.any() else None)
            reason = ''
            if vertical[start]:
                reason = what_is_told(angle[start], rate[start])
            elif history[SETTLING] <= 0:
                reason = what_does_not_lie(self.planar, self.scene, state, history)
            if reason:
                history[SETTLING] = max(history[SETTLING], self.settle_steps)
                self.reason = reason
            stepper = self.planar if history[SETTLING] <= 0 else self.spatial
            pause = max(0, int(history[SETTLING]) - self.settle_steps)
            if stepper is self.spatial:
                if history[PREVIOUS:].reshape(-1)[KNOWN]:
                    forget(history)
                stepper.watch(0 if vertical[start] or pause else self.settle_steps)
                if pause:
                    part = slice(start, min(start + pause, part.stop or len(vertical)))
            if stepper not in self.used:
                self.compile(stepper, state, history, angle, rate)
            state, history, news = stepper.advance(state, history, angle[part], rate[part])
            history[SETTLING] -= min(pause, news.steps)
            if news.left:
                if not np.isfinite(history).all():  # of a step that was not taken
                    history = no_history(self.scene)
                history[SETTLING], self.reason = self.settle_steps, news.left
                self.note_leaving(history)
            news.left = self.reason if stepper is self.spatial else ''
            self.ticks.append(stepper.cycles[: news.steps + 1])
            report = report + news if report.steps else news
            start += news.steps
        self.level = report.level
        return state, history, report

    @property
    def cycles(self) -> Array:
        """Time stamps between the steps of the last call, from 0 on, without what is between."""
        return np.cumsum(np.concatenate([[0], *map(np.diff, self.ticks)]))

    def note_leaving(self, history: Array) -> None:
        """
        Leave a robot that slips too far by rolling to the spatial level for a while.

        What it slipped is then done with. One that leaves the plane because it leans or lifts off
        will roll, by what is too much and back, and slip as far; among pegs, which hold it, that
        is nothing.
        """
        memory = history[PREVIOUS:].reshape(-1)
        if self.planar.rolls:
            history[SETTLING] += self.pause_steps
            memory[[SLIP, WAY]] = 0.0
        elif self.planar.leans and not self.scene.pegs.x:
            memory[SLIP] += 2.0 * self.planar.model.radius * LITTLE

    def compile(
        self, stepper: Any, state: State, history: Array, angle: Array, rate: Array
    ) -> None:
        """Compile a level at its first use, by a call without steps; note the time it takes."""
        begin = time.perf_counter()
        stepper.advance(state, history, angle[:0], rate[:0])
        self.compile_seconds += time.perf_counter() - begin
        self.used.append(stepper)


def what_is_told(angle: Array, rate: Array) -> str:
    """Return the largest pitch reference of a step, as a clause."""
    told = np.abs([angle[:, 1], rate[:, 1]])
    kind, j = np.unravel_index(int(told.argmax()), told.shape)
    value, unit = ((angle, 'rad'), (rate, 'rad/s'))[kind]
    return f'joint_{j + 1}_pitch is told {value[j, 1]:.3g} {unit}'


class FlatStepper:
    """
    The planar level alone; see `base.Stepper`.

    What is not planar ends the call with a failure that names it: the state is the last good one.
    """

    level = 'planar'

    def __init__(self, scene: Scene, planar: PlanarStepper) -> None:
        if reason := what_is_not_planar(scene):
            raise ParameterError(f'level planar: {reason}; choose level spatial or auto')
        self.scene, self.planar, self.cycles = scene, planar, planar.cycles

    def advance(
        self, state: State, history: Array, angle: Array, rate: Array
    ) -> tuple[State, Array, Report]:
        """Return state, history and report after as many steps as there are references."""
        counts = self.scene.robot.link_count, len(self.planar.work.contact)
        check_arguments(*counts, state, history, angle, rate)
        vertical = is_vertical(angle, rate)
        stop = int(vertical.argmax()) if vertical.any() else len(vertical)
        report = Report(level=self.level)
        reason = what_does_not_lie(self.planar, self.scene, state, history)
        if not reason:
            state, history, report = self.planar.advance(state, history, angle[:stop], rate[:stop])
            self.cycles, reason, report.left = self.planar.cycles, report.left, ''
            if not reason and not report.failure and stop < len(vertical):
                reason = what_is_told(angle[stop], rate[stop])
        if reason:
            report.failure = f'level planar: {reason}; choose level spatial or auto'
        return state, history, report


def stepper_of_level(scene: Scene, make: Callable[..., Any]) -> Stepper:
    """
    Return the stepper of a scene at the level it asks for.

    Raises
    ------
    ParameterError
        If the scene asks for the planar level and is not planar.

    """
    if scene.level == 'planar':
        return FlatStepper(scene, make(scene, 'planar'))
    # The reference is the paper's step unless it is told otherwise.
    spatial = scene.level == 'spatial' or scene.method == 'reference'
    if spatial or what_is_not_planar(scene) or is_faster_in_space(scene):
        stepper: Stepper = make(scene, 'spatial')
        return stepper
    return LevelStepper(scene, make(scene, 'planar'), make(scene, 'spatial'))
