# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A scene as it advances in time, and the sampler that makes every record of a run.

A step that diverges ends a run. The samples before it are kept. `GaitAhead` computes the joint
references of the gait of a scene for a few steps at a time, and `IterationBudget` bounds the
contact iterations of several steps together, for programs that keep a period.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
import time

import numpy as np

from snake_sim_ros.contact.placing import world_geometry
from snake_sim_ros.dynamics.compilation import COMPILES
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.gait import Gait
from snake_sim_ros.scene.parameters import Array, load_scene, samples_of, Scene
from snake_sim_ros.stepping.base import Report, Stepper
from snake_sim_ros.stepping.contact_forces import contact_forces, last_span
from snake_sim_ros.stepping.levels import LevelStepper
from snake_sim_ros.stepping.loops import StepsInPlace
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.pushes import NO_PUSHES, Pushes, PushTable
from snake_sim_ros.stepping.samples import make_samples, Samples
from snake_sim_ros.stepping.sampling import (
    begun_samples,
    command_of_scene,
    Ended,
    Hooks,
    joint_rows,
    JointReader,
    Keep,
    Limits,
    NO_HOOKS,
    NO_LIMITS,
    Portions,
    STATES,
    trajectory_of,
)
from snake_sim_ros.stepping.state import carried, History, initial_state, State
from snake_sim_ros.stepping.trajectory import Trajectory

AHEAD = 64  # steps whose references are computed at once, since one costs as much as all of them
MOST_IN_PLACE = 1000  # steps with samples of a call that others may be like
FLOOR = 40  # iterations of every step; with fewer, `newton` may end before it has held radii once
TOGETHER = 5  # steps that are tried in one call
LEVELS = ('planar', 'spatial')


class GaitAhead:
    """
    The gait of a scene at the middle of its steps, computed for some steps ahead.

    Parameters
    ----------
    scene : Scene

    """

    def __init__(self, scene: Scene) -> None:
        self.scene, self.first = scene, 0
        self.angle, self.rate = np.zeros((2, 0, scene.robot.link_count - 1, 2))
        self.ahead: Array = np.zeros(0)  # steps to the middle of the next ones

    def reference(self, step: int, count: int) -> tuple[Array, Array]:
        """
        Return the references of some steps.

        Parameters
        ----------
        step : int
            Number of the first one, from 0.
        count : int

        Returns
        -------
        angle, rate : ndarray, shape (count, n-1, 2)
            (yaw, pitch) [rad], [rad/s].

        """
        if count > AHEAD:
            return self.computed(step, count)
        if not self.first <= step <= step + count <= self.first + len(self.angle):
            self.first, (self.angle, self.rate) = step, self.computed(step, AHEAD)
        part = slice(step - self.first, step - self.first + count)
        return self.angle[part].copy(), self.rate[part].copy()

    def computed(self, step: int, count: int) -> tuple[Array, Array]:
        """Return the references of some steps, see `gait.reference`."""
        axes = self.scene.robot.link_count - 1
        return gait.reference(self.scene.gait, self.midpoints(step, count), axes)

    def midpoints(self, step: int, count: int) -> Array:
        """Return the times at the middle of some steps, shape (count,) [s]."""
        if len(self.ahead) != count:
            self.ahead = 0.5 + np.arange(count)
        return (step + self.ahead) * self.scene.dt


class IterationBudget:
    """
    Iterations that the steps of a call share, whichever of them need more than `FLOOR`.

    A few steps are tried together, each with an equal part of what is left as its limit. If one of
    them does not converge, they are taken again, one after the other, each with all that is left
    as its limit. Iterations of both count. Steps that converge have the bits that they have
    without a budget, as long as no step before them was cut. Planar steps at the level `auto` have
    their own low limit.

    Attributes
    ----------
    share : float
        Iterations a step in the mean; 0 is no budget.
    cut : int
        How many steps ended before they converged, since the budget was used up.
    cycles : ndarray, shape (steps+1,)
        Time stamps of the steps of the last call, as `base.Stepper` has them.

    """

    def __init__(self) -> None:
        self.share, self.cut, self.cycles = 0.0, 0, np.zeros(1, np.int64)

    def spend(
        self, stepper: Stepper, most: int, state: State, history: History,
        reference: tuple[Array, Array], pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """
        Return state, history and report after as many steps as there are references.

        Parameters
        ----------
        stepper : Stepper
            Of a compiled method.
        most : int
            The limit of a step without a budget. The stepper has it again afterwards.
        state, history, pushes
            As in `base.Stepper.advance`.
        reference : tuple of ndarray
            angle and rate, as there.

        """
        angle, rate = reference
        report, ticks = Report(level=stepper.level), [np.zeros(1, np.int64)]
        left, single = int(self.share * len(angle)), 0
        try:
            while report.steps < len(angle) and not report.failure:
                count = 1 if single else min(TOGETHER, len(angle) - report.steps)
                limit = min(most, max(FLOOR, left // count))
                stepper.limit_iterations(limit)
                part = slice(report.steps, report.steps + count)
                acting = pushes.after(report.steps)
                end = stepper.advance(state, history, angle[part], rate[part], None, acting)
                left -= end[2].iterations
                if end[2].unconverged and count > 1 and limit < most:
                    single = count
                    continue
                single = max(0, single - 1)
                self.cut += end[2].unconverged if limit < most else 0
                ticks.append(np.diff(stepper.cycles[: end[2].steps + 1]))
                state, history, report = *end[:2], report + end[2] if report.steps else end[2]
        finally:
            stepper.limit_iterations(most)
        self.cycles = np.cumsum(np.concatenate(ticks))
        return state, history, report


class Simulation:
    """
    The state of a scene as it advances, at first the robot at rest where the scene starts.

    Parameters
    ----------
    scene : Scene, str or Path
        A scene, a YAML file, or the name of a scene that comes with the package. Its steps are
        those it says, 1/4000 s by default.
    stepper : Stepper, optional
        A stepper for this scene that is not of `methods.METHODS`. Default: that of the scene.

    Attributes
    ----------
    step_count : int
        Number of steps since the simulation was made; a reset does not change it.
    budget : IterationBudget
        What the steps of a call without samples share, if anything.
    pushes : Pushes
        Forces and torques on links for some time.

    """

    def __init__(self, scene: Scene | str | Path, stepper: Stepper | None = None) -> None:
        scene = scene if isinstance(scene, Scene) else load_scene(scene)
        self.scene, self.given = scene, stepper is not None
        self.stepper = stepper or make_stepper(scene)
        self.step_count, self.gait, self.pushes = 0, GaitAhead(scene), Pushes(scene)
        self.budget = IterationBudget()
        self._in_place: StepsInPlace | None = None
        self._joints: JointReader | None = None
        self._samples: Samples | None = None  # of the last call
        self.reset()

    def reset(self) -> None:
        """Return the robot to the start of the scene; time continues."""
        self._go_on_from(initial_state(self.scene), self.stepper.empty_history())
        axes = (self.scene.robot.link_count - 1, 2)
        self._report = self._last = Report(joint_torque=np.zeros(axes))

    def compile(self, wave: Gait | None = None, levels: Sequence[str] = LEVELS) -> float:
        """
        Compile what steps and records need, by steps that leave the state; return the time [s].

        Parameters
        ----------
        wave : Gait, optional
            If given, only the level for its first step is compiled, whatever `levels` are.
        levels : sequence of str, optional
            Those that are compiled, if the scene may have them.

        """
        begin = time.perf_counter()
        # First what is around the loop: another process may compile a part of that meanwhile.
        self.joint_motion()
        if not self.given:
            contact_forces(self.scene, self.state, self.history)
            if self.scene.world:
                world_geometry(self.scene, self.state.q)
        if isinstance(self.stepper, LevelStepper) and not wave:
            for level in levels:
                self.stepper.prepare(level, self.state)
        else:
            count = self.scene.robot.link_count - 1
            reference = gait.reference(wave or self.scene.gait, self.midpoints(1), count)
            kept = make_samples(self.scene, 1, 1)
            result = self.stepper.advance(self.state, self.history, *reference, kept)
            if steps := self.stepper.in_place(1, *result[:2], NO_PUSHES):
                steps.prepare()
        return time.perf_counter() - begin

    def change(self, scene: Scene) -> None:
        """
        Continue with another scene, such as one with another gravity, other obstacles or method.

        Pose and velocities stay, and so do the impulses of contacts that both scenes have; see
        `state.carried`.

        Raises
        ------
        ParameterError
            If the scene has another number of links or another time step, if its method or level
            cannot run it, or if the caller made the stepper. Nothing has changed then.

        """
        if self.given:
            raise ParameterError(
                f'a scene cannot change under a {type(self.stepper).__name__} made by the caller; '
                f'make another Simulation'
            )
        for name, old, new in (
            ('robot.link_count', self.scene.robot.link_count, scene.robot.link_count),
            ('dt', self.scene.dt, scene.dt),
        ):
            if old != new:
                raise ParameterError(f'{name} cannot change while a scene runs: {old} to {new}')
        stepper = make_stepper(scene)
        if scene != self.scene:
            scale = self.scene.dt / last_span(self.scene, self.history)
            empty = stepper.empty_history()
            self.history = carried(self.history, self.scene, scene, scale, empty)
        self.stepper, self.scene, self.gait = stepper, scene, GaitAhead(scene)
        self.pushes.change(scene)

    def push(self, link: int, impulse: Sequence[float]) -> None:
        """
        Give a link an impulse at its center; for forces that last see `pushes`.

        Joints and contacts distribute the momentum in the next step.

        Parameters
        ----------
        link : int
            Index of the link, from 0.
        impulse : sequence of float, shape (3,)
            [N s, frame I]

        Raises
        ------
        ParameterError
            If there is no such link, or the impulse is not three finite numbers.

        """
        n, P = self.scene.robot.link_count, np.asarray(impulse, dtype=float)
        if not 0 <= link < n:
            raise ParameterError(f'link must be 0 to {n - 1}, got {link}')
        if P.shape != (3,) or not np.isfinite(P).all():
            raise ParameterError(f'impulse must be 3 finite numbers in N s, got {impulse}')
        u = self.state.u.copy()
        u[link, :3] += P / self.scene.robot.per_link('link_mass')[link]
        self.state = State(self.state.q, u)

    @property
    def compile_seconds(self) -> float:
        """Wall time of compiling levels at their first use [s]."""
        return float(getattr(self.stepper, 'compile_seconds', 0.0))

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.step_count * self.scene.dt

    @property
    def joint_angle(self) -> Array:
        """Angles of the joint axes, in the order of `scene.robot.axis_names`, (axes,) [rad]."""
        return self.joint_motion()[0]

    @property
    def joint_velocity(self) -> Array:
        """Rates of the joint axes, shape (axes,) [rad/s]."""
        return self.joint_motion()[1]

    @property
    def joint_torque(self) -> Array:
        """Torques of the joint axes in the last step, shape (axes,) [N m]."""
        torque = self._in_place.shared.torque if self._in_place else self._last.joint_torque
        return self.scene.robot.by_axis(torque).copy()

    def joint_motion(self) -> tuple[Array, Array]:
        """Return `joint_angle` and `joint_velocity` for the work of one of them."""
        robot, state = self.scene.robot, self.present_state
        if not self._joints or self._joints.robot is not robot:
            self._joints = JointReader(robot)
        angle, rate = self._joints.read(state.q, state.u)
        return robot.by_axis(angle), robot.by_axis(rate)

    def midpoints(self, steps: int) -> Array:
        """Return the times at the middle of the next steps, shape (steps,) [s]."""
        return self.gait.midpoints(self.step_count, steps)

    def gait_reference(self, steps: int) -> tuple[Array, Array]:
        """Return angles [rad] and rates [rad/s] of the gait at `midpoints`, (steps, n-1, 2)."""
        return self.gait.reference(self.step_count, steps)

    def advance(
        self, angle: Array, rate: Array | None = None, samples: Samples | None = None,
        begun: int = 0,
    ) -> Report:  # fmt: skip
        """
        Take as many steps as there are references, but none between a divergence and `reset`.

        Parameters
        ----------
        angle, rate : ndarray of float, shape (steps, n-1, 2)
            Joint references (yaw, pitch) at `midpoints` [rad], [rad/s]. Default: rates of 0.
        samples : Samples, optional
            Filled with the samples that the steps reach.
        begun : int, optional
            Steps that were taken since these samples began.

        Returns
        -------
        Report
            What happened in these steps; `failure` says so if one diverged.

        Raises
        ------
        ParameterError
            If an array has another shape or type. No step is taken then.

        """
        if self.has_failed:
            return self.report
        self.take(angle, rate, samples, begun)
        return self.last

    def take(
        self, angle: Array, rate: Array | None = None, samples: Samples | None = None,
        begun: int = 0,
    ) -> None:  # fmt: skip
        """Take steps as `advance` does; their report is `last`, for those who need it."""
        if self.has_failed:
            return
        rate = np.zeros(np.shape(angle)) if rate is None else rate
        pushes, place = self.pushes.at(self.step_count), self._in_place
        if place and not self.budget.share and place.take(angle, rate, pushes, samples, begun):
            self.step_count += len(angle)
            return
        before = 0 if place or samples is not self._samples else self._last.steps
        self._samples = samples
        rest = samples.after(begun) if samples and begun else samples
        last, count = self._taken(angle, rate, rest, pushes), len(angle)
        # Long calls with samples are few.
        is_short = not samples or (samples.first == samples.every and count <= MOST_IN_PLACE)
        if before == last.steps == count > 0 and is_short and not self.budget.share:
            self.go_on_in_place(count, samples)

    def go_on_in_place(self, count: int, samples: Samples | None = None) -> StepsInPlace | None:
        """
        Let calls of so many steps continue the last one in place; return them if they can.

        They fill samples, if any are given, whose distance must divide `count`.
        """
        every = samples.every if samples else 0
        divides = not every or count % every == 0
        if COMPILES and divides and not (self._in_place or self.given or self._last.failure):
            now = self._state, self._history, self.pushes.at(self.step_count)
            self._in_place = self.stepper.in_place(count, *now, every)
            if self._in_place:
                self._in_place.shared.torque[...] = self._last.joint_torque
                self._in_place.bind(samples=samples)
        return self._in_place

    def _taken(
        self, angle: Array, rate: Array, samples: Samples | None, pushes: PushTable
    ) -> Report:
        """Take steps of the stepper."""
        now = self.state, self.history
        if samples is None and self.budget.share:
            most = self.scene.iteration_limit
            last = self.budget.spend(self.stepper, most, *now, (angle, rate), pushes)
        else:
            last = self.stepper.advance(*now, angle, rate, samples, pushes)
        self._go_on_from(*last[:2])
        self.step_count += last[2].steps
        if last[2].failure:
            last[2].failure = f't = {self.time:g} s: {last[2].failure}'
        self._last = last[2]
        self._report += last[2]
        return last[2]

    @property
    def last(self) -> Report:
        """Report of the last call of `advance`."""
        self._note()
        return self._last

    @property
    def report(self) -> Report:
        """Report of all steps since the start or the last reset; who sets it sets `last`, too."""
        self._note()
        return self._report

    @report.setter
    def report(self, report: Report) -> None:
        self._note()
        self._report = self._last = report

    @property
    def has_failed(self) -> bool:
        """Whether a step diverged since the start or the last reset."""
        return bool(self._report.failure)  # no step in place does

    def _note(self) -> None:
        """Add the steps that were taken in place to the reports."""
        if self._in_place and self._in_place.has_moved:
            self._last, both = self._in_place.noted()
            self._report += both

    @property
    def state(self) -> State:
        """The last good state."""
        return self._in_place.state if self._in_place else self._state

    @state.setter
    def state(self, state: State) -> None:
        self._go_on_from(state, self.history)

    @property
    def history(self) -> History:
        """What the next step takes from the last one, besides the state."""
        return self._in_place.history if self._in_place else self._history

    @history.setter
    def history(self, history: History) -> None:
        self._go_on_from(self.state, history)

    @property
    def present_state(self) -> State:
        """The last good state, to be read until the next step changes it in place."""
        return self._in_place.present if self._in_place else self._state

    @property
    def present_history(self) -> History:
        """The impulses of the history, to be read until the next step changes them in place."""
        return self._in_place.steps.history if self._in_place else self._history

    def _go_on_from(self, state: State, history: History) -> None:
        """Continue from a state and its history."""
        self._note()
        self._state, self._history, self._in_place = state, history, None


def sample(
    simulation: Simulation, steps: int, samples: int, *, keep: Keep = STATES,
    limits: Limits = NO_LIMITS, hooks: Hooks = NO_HOOKS,
) -> Trajectory:  # fmt: skip
    """
    Advance a simulation as its scene says, or a command, and return samples of its motion.

    Parameters
    ----------
    simulation : Simulation
        Its present state is the first sample; it is left in that after the last step.
    steps : int
        Number of steps between two samples.
    samples : int
        Number of samples after the first one; fewer if a step diverges or a limit is reached.
    keep : Keep, optional
        Default: states, joint torques and levels only.
    limits : Limits, optional
    hooks : Hooks, optional

    """
    hooks = hooks._replace(command=hooks.command or command_of_scene(simulation.scene))
    found = begun_samples(simulation, steps, samples)
    advance = Portions(simulation, found.after(0), keep, limits, hooks)
    interrupted = False
    try:
        if hooks.observe:
            hooks.observe(simulation)
        while advance.done < steps * samples and not advance.over():
            count = steps * samples - advance.done
            advance(steps - advance.done % steps if hooks.observe else count)
            if hooks.observe and advance.done % steps == 0 and not advance.over():
                hooks.observe(simulation)
            if hooks.progress:
                hooks.progress(advance.done * simulation.scene.dt)
    except KeyboardInterrupt:
        if not limits.keyboard:
            raise
        interrupted = True
    joint_steps = None
    if keep.joints:
        rows = [joint_rows(simulation.scene.robot, found.until(0)), *advance.joint_steps]
        joint_steps = np.concatenate(rows, axis=1)[:, : advance.in_time + 1]
    ended = Ended(simulation.report, advance.seconds, interrupted)
    return trajectory_of(simulation.scene, found.until(advance.in_time), keep, ended, joint_steps)


def simulate(
    scene: Scene, *, rate: float = 100.0, observe: Callable[[Simulation], object] | None = None,
    progress: Callable[[float], object] | None = None,
) -> Trajectory:  # fmt: skip
    """
    Run a scene with its gait, along its path if it has one, and return the record of its motion.

    Parameters
    ----------
    scene : Scene
    rate : float, optional
        Samples a second [Hz].
    observe : callable, optional
        Called at every sample, also the first. Ctrl-C ends the run with the samples so far.
    progress : callable, optional
        Called with the simulated time that has passed [s], some times a second.

    Raises
    ------
    ParameterError
        If dt does not divide the sampling period, or the sampling period the duration.

    """
    steps, samples = samples_of(scene, rate)
    simulation = Simulation(scene)
    simulation.compile(scene.gait)
    begin, compiled = time.perf_counter(), simulation.compile_seconds
    trajectory = sample(
        simulation, steps, samples, keep=Keep(contacts=True), limits=Limits(keyboard=True),
        hooks=Hooks(observe=observe, progress=progress),
    )  # fmt: skip
    compiled = simulation.compile_seconds - compiled
    return replace(trajectory, seconds=time.perf_counter() - begin - compiled)
