# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The record of a run from its samples: joints, contact forces and levels.

`Portions` takes the steps of a run with the gait of its scene, in calls that end some times a
second, so that a program can show its progress.
"""

from collections.abc import Callable
import math
import time
from typing import Any, NamedTuple, TYPE_CHECKING

import numpy as np

from snake_sim_ros.controllers.controller import Controller, Measured, Reference, sees
from snake_sim_ros.controllers.named import controller_of
from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.dynamics.records import Block, BoundCall
from snake_sim_ros.scene.parameters import Array, Robot, Scene, steps_in
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.contact_forces import last_span, sampled_forces
from snake_sim_ros.stepping.exact_sensors import contact_wrenches, imu_readings
from snake_sim_ros.stepping.samples import make_samples, Samples
from snake_sim_ros.stepping.trajectory import Trajectory

if TYPE_CHECKING:
    from snake_sim_ros.stepping.simulation import Simulation

LEVELS = np.array(['spatial', 'planar'])
FIRST_PORTION = 25  # steps of a call if unconverged ones are limited; doubles while all converge
LEAST_STEPS, MOST_STEPS = 100, 20_000  # of a call, whose references are in memory
PORTION_SECONDS = 0.1  # wall time that a call is to take [s]
MOST_KEPT = 1000  # steps of a call whose states are all in memory
SHORTEST = PORTION_SECONDS / 32  # wall time of a call up to which the next one may be so long [s]


class Keep(NamedTuple):
    """
    What to keep of every sample besides state, joint torques and level.

    Attributes
    ----------
    contacts : bool
        Points and forces of the contacts that carry load.
    impulses : bool
        Impulses of all contacts, closed or not.
    joints : bool
        The joints after every step, see `Trajectory.joint_steps`.

    """

    contacts: bool = False
    impulses: bool = False
    joints: bool = False


class Limits(NamedTuple):
    """Limits that end a run before its last sample, as a step that diverges does."""

    seconds: float = math.inf  # wall time of all steps [s]
    unconverged: float = math.inf  # number of steps that did not converge
    keyboard: bool = False  # whether Ctrl-C ends the run with the samples so far, or is raised
    # Whether the wall time of the steps includes the computation of the joint references.
    times_references: bool = False


class Command(NamedTuple):
    """What commands the joints in place of the gait."""

    control: Callable[['Simulation'], Reference]  # called at the begin of every period
    period: int  # steps


class Hooks(NamedTuple):
    """
    What is called between the steps of a run.

    Attributes
    ----------
    command : Command or None
        What commands the joints. Default: the path that the scene follows, or its gait.
    observe : callable or None
        Called with the simulation at every sample, also the first, which costs 0.1 ms a sample.
    progress : callable or None
        Called with the simulated time that has passed [s], some times a second.
    portion : int
        Number of steps in the first call, between two calls of `progress`.

    """

    command: Command | None = None
    observe: Callable[['Simulation'], object] | None = None
    progress: Callable[[float], object] | None = None
    portion: int = LEAST_STEPS


NO_LIMITS = Limits()
NO_HOOKS = Hooks()
STATES = Keep()


def begun_samples(simulation: 'Simulation', steps: int, samples: int) -> Samples:
    """Return arrays for samples after the present state, the first of them; see `sample`."""
    scene, last, history = simulation.scene, simulation.last, simulation.history
    found = make_samples(scene, steps, samples + 1)._replace(first=0)
    found.add(-1, simulation.state, history, last.joint_torque, last_span(scene, history))
    found.is_planar[0] = last.level == 'planar'
    return found


def joint_motion(robot: Robot, q: Array, u: Array) -> tuple[Array, Array]:
    """
    Return angles and rates of the joints in some states, computed as in a compiled step.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (m, n, 7)
    u : ndarray, shape (m, n, 6)
        See `state.State`.

    Returns
    -------
    angle, rate : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [rad], [rad/s].

    """
    arguments = _arguments(robot, q, u)
    kinematics.joint_motions(*arguments)
    return _found(robot, arguments[-1])


class JointReader:
    """Reads the joints of a robot as `joint_motion` does, in one state after the other."""

    def __init__(self, robot: Robot) -> None:
        n, self.robot = robot.link_count, robot
        self._q, self._u = np.empty((1, n, 7)), np.empty((1, n, 6))
        arguments = _arguments(robot, self._q, self._u)
        self._coordinate = arguments[-1]
        self._call = BoundCall(kinematics.joint_motions, *map(Block, arguments))

    def read(self, q: Array, u: Array) -> tuple[Array, Array]:
        """Return angles [rad] and rates [rad/s] of the joints in a state, (n-1, 2)."""
        self._q[0], self._u[0] = q, u
        self._call()
        angle, rate = _found(self.robot, self._coordinate[0])
        return angle.copy(), rate.copy()


def _arguments(robot: Robot, q: Array, u: Array) -> tuple[Any, ...]:
    """Return the arguments of `kinematics.joint_motions`, the last of which is filled."""
    n, places = robot.link_count, robot.chain.places
    R = np.empty((n, 3, 3))
    frames, coordinate = kinematics.make_joint_frames(places, R), np.empty((len(q), n - 1, 2, 2))
    return places, (q, u), R, np.empty((n, 3)), frames, coordinate


def _found(robot: Robot, coordinate: Array) -> tuple[Array, Array]:
    """Return angles and rates, 0 for axes that a joint does not have."""
    if not robot.chain.places.complete:
        coordinate *= robot.chain.places.present[..., None]
    return coordinate[..., 0], coordinate[..., 1]


def joint_rows(robot: Robot, samples: Samples) -> Array:
    """Return the rows of samples in `Trajectory.joint_steps`, shape (3, m, axes)."""
    rows = *joint_motion(robot, samples.q, samples.u), samples.torque
    return np.stack([robot.by_axis(item) for item in rows])


class Ended(NamedTuple):
    """How a run went; see `Trajectory`."""

    report: Report  # of all steps
    seconds: float  # wall time of all steps [s]
    interrupted: bool  # whether it was ended from the keyboard


def trajectory_of(
    scene: Scene, samples: Samples, keep: Keep, ended: Ended, joint_steps: Array | None
) -> Trajectory:
    """Return the record of samples, the first of which is the start; see `Trajectory`."""
    m, q, u = len(samples.q), samples.q, samples.u
    joint_angle, joint_velocity = joint_motion(scene.robot, q, u)
    sample = number = np.zeros(0, dtype=int)
    points = forces = np.zeros((0, 3))
    if keep.contacts:
        sample, number, points, forces = sampled_forces(scene, q, u, samples.impulse, samples.span)
    is_planar = samples.is_planar
    level = LEVELS[np.concatenate([is_planar[1:2], is_planar[1:]]).astype(int)]
    return Trajectory(
        scene=scene,
        time=np.arange(m) * samples.every * scene.dt,
        position=q[:, :, :3],
        orientation=q[:, :, 3:],
        joint_angle=scene.robot.by_axis(joint_angle),
        joint_velocity=scene.robot.by_axis(joint_velocity),
        joint_torque=scene.robot.by_axis(samples.torque),
        contact_sample=sample,
        contact_number=number,
        contact_point=points,
        contact_force=forces,
        level=level if m > 1 else np.array([ended.report.level]),
        report=ended.report,
        seconds=ended.seconds,
        interrupted=ended.interrupted,
        velocity=u,
        impulse=samples.impulse if keep.impulses else np.zeros((m, 0)),
        joint_steps=np.zeros(0) if joint_steps is None else joint_steps,
    )


def command_of(controller: Controller, scene: Scene) -> Command:
    """
    Return the command of a controller, started anew.

    Raises
    ------
    ParameterError
        If the controller cannot do its work in the scene, or dt does not divide its period.

    """
    controller.start(scene)
    poses, contacts, imus = (sees(controller, what) for what in ('poses', 'contacts', 'imus'))
    before: Array | None = None  # velocities at the last call, (n, 3) [m/s]

    def control(simulation: 'Simulation') -> Reference:
        nonlocal before
        state, wrench, read = simulation.present_state, None, None
        if contacts:
            wrench = contact_wrenches(scene, state, simulation.present_history)
        if imus:
            before = state.u[:, :3].copy() if before is None else before
            read = imu_readings(scene.gravity, state.q, state.u, before, controller.period)
            before = state.u[:, :3].copy()
        measured = Measured(
            *simulation.joint_motion(), simulation.joint_torque,
            state.q[:, :3].copy() if poses else None, state.q[:, 3:].copy() if poses else None,
            wrench, read,
        )  # fmt: skip
        return controller.control(measured, simulation.time)

    return Command(control, steps_in(controller.period, scene.dt, 'period of the controller'))


def command_of_scene(scene: Scene) -> Command | None:
    """Return what commands the joints of a scene; None if that is its gait alone."""
    controller = controller_of(scene)
    return command_of(controller, scene) if controller else None


class Portions:
    """
    Calls of `Simulation.advance` with the references of a command or a gait, and their wall time.

    If joints are kept, `joint_steps` are those of every step, in portions.
    """

    def __init__(
        self, simulation: 'Simulation', samples: Samples, keep: Keep, limits: Limits, hooks: Hooks
    ) -> None:
        self.simulation, self.samples, self.limits = simulation, samples, limits
        self.joints, self.joint_steps, self.command = keep.joints, list[Array](), hooks.command
        self.seconds, self.is_cautious = 0.0, not math.isinf(limits.unconverged)
        self.in_time = 0  # steps taken before the limit of the wall time
        self.begin, self.portion = simulation.step_count, max(hooks.portion, samples.every)
        if self.is_cautious:
            self.portion = FIRST_PORTION

    @property
    def done(self) -> int:
        """Number of steps taken."""
        return self.simulation.step_count - self.begin

    def __call__(self, most: int) -> None:
        """Take a portion of steps, at most so many."""
        simulation, count = self.simulation, min(self.portion, most)
        if self.joints:
            count = min(count, MOST_KEPT)
        times_references = self.limits.times_references
        begin = time.perf_counter() if times_references else math.nan
        reference, compiled = self._reference(count), simulation.compile_seconds
        begin = begin if times_references else time.perf_counter()
        if self.joints:
            done, count = self.done, len(reference[0])
            every = make_samples(simulation.scene, 1, count)
            simulation.advance(*reference, every)
            every = every.until(self.done - done)
            self.samples.after(done).take(every)
            self.joint_steps.append(joint_rows(simulation.scene.robot, every))
        elif self.command and not self._is_whole(len(reference[0])):
            simulation.take(*reference)  # in place, up to the next sample at most
            self._add_sample()
        else:
            simulation.take(*reference, self.samples, self.done)
        compiled = simulation.compile_seconds - compiled
        seconds = time.perf_counter() - begin - compiled
        self.seconds += seconds
        if self.seconds <= self.limits.seconds:
            self.in_time = self.done
        if self.is_cautious and simulation.report.unconverged:
            self.portion = FIRST_PORTION
        elif seconds < PORTION_SECONDS:
            growth = 2 if self.is_cautious else PORTION_SECONDS / max(seconds, SHORTEST)
            self.portion = min(int(growth * self.portion), MOST_STEPS)

    def _reference(self, most: int) -> tuple[Array, Array]:
        """Return the references of the next steps, at most so many."""
        simulation = self.simulation
        if not self.command:
            return simulation.gait_reference(most)
        period, every = self.command.period, self.samples.every
        age = self.done % period
        if age == 0:
            self._commanded = self.command.control(simulation)(simulation.midpoints(period))
        count = min(most, period - age)
        if not self._is_whole(count):
            count = min(count, every - self.done % every)
        angle, rate = self._commanded
        return angle[age : age + count], rate[age : age + count]

    def _is_whole(self, count: int) -> bool:
        """Return whether so many steps begin and end at samples."""
        return self.done % self.samples.every == count % self.samples.every == 0

    def _add_sample(self) -> None:
        """Keep the present state if it is a sample."""
        simulation, samples, done = self.simulation, self.samples, self.done
        if done % samples.every or simulation.has_failed:
            return
        last, history = simulation.last, simulation.present_history
        span = last_span(simulation.scene, history)
        samples.add(done - 1, simulation.present_state, history, last.joint_torque, span)
        samples.is_planar[done // samples.every - 1] = last.level == 'planar'

    def over(self) -> bool:
        """Return whether no further step is taken."""
        simulation, limits = self.simulation, self.limits
        if self.seconds > limits.seconds or simulation.has_failed:
            return True
        return self.is_cautious and simulation.report.unconverged >= limits.unconverged
