# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Runs of MuJoCo on the scenes of this package, step by step or in one call of `mujoco.rollout`.

MuJoCo is an optional dependency and is imported only when a function needs it.
"""

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
import math
import time

import numpy as np

from snake_sim_benchmarks.comparison.mujoco_model import (
    GAINS,
    import_mujoco,
    mjcf,
    MujocoSettings,
    tree_order,
)
from snake_sim_benchmarks.comparison.paths import (
    Course,
    least_seconds,
    portions,
    SAMPLING_PERIOD,
    Start,
    step_count,
)
from snake_sim_benchmarks.comparison.timing import TimedRun, timing_of, trajectory_of_states
from snake_sim_benchmarks.energy import BALANCE_TIME, imbalance
from snake_sim_ros import ParameterError, Report, Scene, State
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import Array, steps_in
from snake_sim_ros.scene.posture import joint_angles, joint_rates
from snake_sim_ros.stepping.trajectory import Trajectory

# ---- recorded like those of our own methods -----------------------------------------------------


START_KEY_FRAME = 0
# Coordinates and velocities of the free middle link, which come before those of the joints.
FREE_COORDINATES, FREE_VELOCITIES = 7, 6
ITERATION_LIMIT = 100  # MuJoCo's own limit of the iterations of its solver


def run_mujoco(scene: Scene, settings: MujocoSettings, limit: float) -> TimedRun:
    """
    Run a scene with MuJoCo, its time step that of the scene.

    The time of a step is that of `mj_step` and of setting the controls, or of computing them for
    the drive `torque`. References, recording and checks are not included. The report counts the
    iterations of MuJoCo's solver. A step is unconverged if it reaches MuJoCo's own limit of
    iterations, but not if it reaches a lower limit of the settings. The penetration is the largest
    at samples, since reading contacts slows the next step down. There is no residual (nan), since
    MuJoCo does not solve the paper's laws, and there are no joint gaps. A warning of MuJoCo counts
    as a failure, since MuJoCo resets the robot to its start then.

    Parameters
    ----------
    scene : Scene
    settings : MujocoSettings
    limit : float
        Wall time of all steps after which the run is stopped [s].

    Raises
    ------
    ParameterError
        If MuJoCo is not installed or cannot run the scene, see `mjcf`, or if dt does not divide
        the sampling period, or the period the duration.

    """
    import_mujoco()
    steps = steps_in(SAMPLING_PERIOD, scene.dt, 'sampling period')
    samples = steps_in(scene.duration, SAMPLING_PERIOD, 'duration')
    robot = MujocoRobot(scene, settings)
    kept = _Kept(robot, robot.state(), round(BALANCE_TIME / scene.dt))
    with collected_warnings() as warnings:
        for k in range(samples):
            kept.sample(robot.reference(k * steps, steps), warnings)
            if kept.failure or kept.seconds > limit:
                break
    report = kept.report()
    return TimedRun(
        trajectory_of_states(scene, kept.states, SAMPLING_PERIOD, report, kept.seconds),
        timing_of(np.array(kept.nanoseconds) / 1e3, robot.build_seconds),
        energy_error=math.nan if kept.failure else _balance_error(robot, kept.balanced),
        late=kept.seconds > limit and len(kept.states) <= samples,
    )


def mujoco_trajectory(
    scene: Scene, settings: MujocoSettings, start: State, steps: int, every: int
) -> Trajectory:
    """
    Return the trajectory of a robot that holds its posture from any state on, by MuJoCo.

    Parameters
    ----------
    scene : Scene
    settings : MujocoSettings
    start : State
        With closed joints.
    steps, every : int
        Number of steps to take, and of those between two samples.

    Returns
    -------
    Trajectory
        The first sample is the start. The last one is before a step with a warning of MuJoCo.

    Raises
    ------
    ParameterError
        If MuJoCo is not installed or cannot run the scene, see `mjcf`.

    """
    robot = MujocoRobot(scene, settings, start)
    kept = _Kept(robot, start, 0)
    angle = joint_angles(start.q).ravel()
    held = np.tile(angle, (every, 1)), np.zeros((every, len(angle)))
    with collected_warnings() as warnings:
        for _ in range(steps // every):
            kept.sample(held, warnings)
            if kept.failure:
                break
    period = every * scene.dt
    return trajectory_of_states(scene, kept.states, period, kept.report(), kept.seconds)


class MujocoRobot:
    """
    The robot of a scene in MuJoCo, from a start with closed joints (default: that of the scene).

    Attributes
    ----------
    model, data : Any
        `MjModel` and `MjData` of the run.
    judge : Any
        `MjData` for quantities that the steps do not need.
    build_seconds : float
        Wall time of building the model [s].

    """

    def __init__(self, scene: Scene, settings: MujocoSettings, start: State | None = None) -> None:
        self.mujoco, self.scene, self.settings = import_mujoco(), scene, settings
        begin = time.perf_counter()
        self.model = self.mujoco.MjModel.from_xml_string(mjcf(scene, settings))
        self.links, self.axes = tree_order(scene.robot.link_count)
        self.build_seconds = time.perf_counter() - begin
        self.data, self.judge = (self.mujoco.MjData(self.model) for _ in range(2))
        if start is None:
            self.mujoco.mj_resetDataKeyframe(self.model, self.data, START_KEY_FRAME)
            return
        # The free joint has the velocities of u: that of the center in I, the angular one in B.
        self.data.qpos[:], self.data.qvel[:] = generalized(start)

    def steps(self, reference: tuple[Array, Array]) -> Iterator[int]:
        """Take a step for each angle and rate, shapes (steps, 2(n-1)); yield its time [ns]."""
        step, clock = self.mujoco.mj_step, time.perf_counter_ns
        model, data, control = self.model, self.data, self.data.ctrl
        angle, rate = data.qpos[FREE_COORDINATES:], data.qvel[FREE_VELOCITIES:]
        K_p, K_d = self.gains()
        reference = reference[0][:, self.axes], reference[1][:, self.axes]
        feed = K_p * reference[0] + K_d * reference[1]
        if self.settings.drive == 'torque':
            for angle_ref, rate_ref in zip(*reference, strict=True):
                begin = clock()
                control[:] = K_p * (angle_ref - angle) + K_d * (rate_ref - rate)
                step(model, data)
                yield clock() - begin
            return
        for fed in feed:
            begin = clock()
            control[:] = fed
            step(model, data)
            yield clock() - begin

    def reference(self, first: int, steps: int, begin: float = 0.0) -> tuple[Array, Array]:
        """
        Return angles and rates of the gait for some steps, shapes (steps, 2(n-1)).

        Parameters
        ----------
        first, steps : int
            Number of the first step, and how many there are.
        begin : float, optional
            Time of the gait at the start of step 0 [s].

        """
        scene, lead = self.scene, 0.5 if self.settings.contact_model.lead == 'mid' else 1.0
        times = begin + (first + lead + np.arange(steps)) * scene.dt
        angle, rate = gait.reference(scene.gait, times, scene.robot.link_count - 1)
        return angle.reshape(steps, angle[0].size), rate.reshape(steps, rate[0].size)

    def gains(self) -> tuple[Array, Array]:
        """Return stiffness [N m/rad] and damping [N m s/rad] of the axes in MuJoCo's order."""
        K_p, K_d = (self.scene.robot.per_joint(name).ravel()[self.axes] for name in GAINS)
        return K_p, K_d

    def state(self) -> State:
        """Return coordinates and velocities of all links."""
        mujoco, judge = self.mujoco, self.judge
        judge.qpos[:], judge.qvel[:] = self.data.qpos, self.data.qvel
        for part in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
            part(self.model, judge)
        # Twists have axes of I, and the velocity of the body at the center of mass of the robot.
        omega, velocity = judge.cvel[1:, :3], judge.cvel[1:, 3:]
        velocity = velocity + np.cross(omega, judge.xpos[1:] - judge.subtree_com[1])
        omega_B = np.einsum('iab,ia->ib', judge.xmat[1:].reshape(-1, 3, 3), omega)
        order = np.argsort(self.links)
        q = np.concatenate([judge.xpos[1:], judge.xquat[1:]], axis=1)
        return State(q[order], np.concatenate([velocity, omega_B], axis=1)[order])

    def energy(self, q: Array, u: Array) -> float:
        """Return kinetic and potential energy of the links, without that of springs [J]."""
        mujoco, model, judge, momentum = self.mujoco, self.model, self.judge, np.zeros(len(u))
        judge.qpos[:] = q
        for part in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_makeM):
            part(model, judge)
        mujoco.mj_mulM(model, judge, momentum, u)
        potential = -model.body_mass[1:] @ (judge.xipos[1:] @ np.array(self.scene.gravity))
        return float(u @ momentum / 2 + potential)


class _Kept:
    """
    Samples, times and reports of the steps of MuJoCo.

    Parameters
    ----------
    robot : MujocoRobot
    start : State
        The first sample.
    count : int
        Number of steps from the start for which there is an energy balance.

    """

    def __init__(self, robot: MujocoRobot, start: State, count: int) -> None:
        self.robot, self.count = robot, count
        self.states, self.balanced = [start], [self._forces()]
        self.nanoseconds: list[int] = []  # wall time of every step
        self.iterations: list[int] = []
        self.depth, self.seconds, self.failure = 0.0, 0.0, ''

    def sample(self, reference: tuple[Array, Array], warnings: list[str]) -> None:
        """Take steps, and a sample after the last one unless MuJoCo warns of a step."""
        robot, iterations = self.robot, self.robot.data.solver_niter
        for elapsed in robot.steps(reference):
            if warnings:
                reason, done = warnings[0].partition('.')[0], len(self.nanoseconds)
                self.failure = f't = {done * robot.scene.dt:g} s: MuJoCo: {reason}'
                break
            self.nanoseconds.append(elapsed)
            self.iterations.append(iterations.item(0))  # of the one robot
            if len(self.balanced) <= self.count:
                self.balanced.append(self._forces())
        else:
            self.states.append(robot.state())
            self.depth = max(self.depth, -float(robot.data.contact.dist.min(initial=0.0)))
        self.seconds = 1e-9 * sum(self.nanoseconds)

    def _forces(self) -> tuple[Array, Array, Array]:
        """Return coordinates, velocities and the forces of the contacts in the step before."""
        data = self.robot.data
        return data.qpos.copy(), data.qvel.copy(), data.qfrc_constraint.copy()

    def report(self) -> Report:
        """Return the report of all steps."""
        return Report(
            steps=len(self.nanoseconds),
            iterations=sum(self.iterations),
            iterations_max=max(self.iterations, default=0),
            unconverged=sum(number >= ITERATION_LIMIT for number in self.iterations),
            residual_max=math.nan,
            printed_residual_max=math.nan,
            penetration_max=self.depth,
            contacts=int(self.robot.data.ncon),
            failure=self.failure,
        )


def generalized(state: State) -> tuple[Array, Array]:
    """
    Return coordinates and velocities of MuJoCo for a state with closed joints.

    The free joint has those of the middle link: the velocity of its center in I, the angular one
    in B.
    """
    links, axes = tree_order(len(state.q))
    angle, rate = joint_angles(state.q).ravel(), joint_rates(state.q, state.u).ravel()
    q = np.concatenate([state.q[links[0]], angle[axes]])
    return q, np.concatenate([state.u[links[0]], rate[axes]])


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collect the warnings of MuJoCo, which otherwise go to the screen and to a file."""
    mujoco = import_mujoco()
    before = mujoco.get_mju_user_warning()
    collected: list[str] = []
    mujoco.set_mju_user_warning(collected.append)
    try:
        yield collected
    finally:
        mujoco.set_mju_user_warning(before)


def _balance_error(robot: MujocoRobot, steps: list[tuple[Array, Array, Array]]) -> float:
    """
    Return how much energy steps lost or made, over the work that the joints did either way.

    This is `energy.balance_error` with the mean velocities of steps. It takes the work of the
    contact forces that MuJoCo computed, and that of the joint law with the mean angle and rate of
    a step.
    """
    scene = robot.scene
    q, u, force = map(np.array, zip(*steps, strict=True))
    energy = np.array([robot.energy(*state) for state in zip(q, u, strict=True)])
    angle, rate = (values[:, robot.axes] for values in robot.reference(0, len(steps) - 1))
    mean = (u[1:] + u[:-1]) / 2
    K_p, K_d = robot.gains()
    joint_rate = mean[:, FREE_VELOCITIES:]
    joint_angle = (q[1:, FREE_COORDINATES:] + q[:-1, FREE_COORDINATES:]) / 2
    torque = K_p * (angle - joint_angle) + K_d * (rate - joint_rate)
    joints = scene.dt * (torque * joint_rate).sum(axis=1)
    contacts = scene.dt * (force[1:] * mean).sum(axis=1)
    return imbalance(energy, contacts, joints)


# ---- in one call --------------------------------------------------------------------------------


PLACE = slice(1, 4)  # of the middle link, the root of the tree, in a state of MuJoCo


class Rollouts:
    """
    Robots that MuJoCo runs in one call, each with a model of its own.

    The call writes the state after every step, which takes little of its time.

    Parameters
    ----------
    scenes : sequence of Scene
        With the same robot, time step and duration.
    settings : MujocoSettings
    threads : int, optional
        With one it is the calling thread.
    start : Start, optional
        Of all robots; default: those of the scenes.

    Attributes
    ----------
    first : ndarray, shape (m, k)
        States of the robots at the start.
    states : ndarray, shape (m, steps, k)
        States after every step, once the call is over.

    Raises
    ------
    ParameterError
        If MuJoCo is not installed or cannot run a scene, see `mujoco_model.mjcf`, or if the drive
        is `torque`, which needs the caller before every step.

    """

    def __init__(
        self, scenes: Sequence[Scene], settings: MujocoSettings, threads: int = 1,
        start: Start | None = None,
    ) -> None:  # fmt: skip
        if settings.drive == 'torque':
            raise ParameterError(
                'drive must be spring or position for a run in one call, got torque'
            )
        mujoco, steps = import_mujoco(), step_count(scenes[0])
        from mujoco.rollout import Rollout

        state, begin = start or (None, 0.0)
        self.robots = [MujocoRobot(scene, settings, state) for scene in scenes]
        physics, model = mujoco.mjtState.mjSTATE_FULLPHYSICS, self.robots[0].model
        self.first = np.empty((len(scenes), mujoco.mj_stateSize(model, physics)))
        self.control = np.empty((len(scenes), steps, model.nu))
        for robot, first, control in zip(self.robots, self.first, self.control, strict=True):
            angle, rate = (values[:, robot.axes] for values in robot.reference(0, steps, begin))
            K_p, K_d = robot.gains()
            control[:] = K_p * angle + K_d * rate
            mujoco.mj_getState(robot.model, robot.data, first, physics)
        self.states = np.empty((len(scenes), steps, self.first.shape[1]))
        self.sensors = np.empty((len(scenes), steps, 0))

        self.models = [robot.model for robot in self.robots]
        self.data = [robot.data for robot in self.robots[:threads]]
        self.rollout = Rollout(nthread=0 if threads == 1 else threads)

    def __call__(self) -> None:
        """Run all robots."""
        self.rollout.rollout(
            self.models, self.data, self.first, self.control, nstep=self.control.shape[1],
            state=self.states, sensordata=self.sensors,
        )  # fmt: skip

    def close(self) -> None:
        """End the threads."""
        self.rollout.close()


def rolled_course(scene: Scene, start: Start | None = None, *, settings: MujocoSettings) -> Course:
    """
    Return the course of a scene by MuJoCo, see `courses.Course`.

    A warning of MuJoCo counts as a failure, since MuJoCo resets the robot to its start then.

    Raises
    ------
    ParameterError
        As `Rollouts` raises it.

    """
    with closing(Rollouts([scene], settings, start=start)) as rollouts:
        with collected_warnings() as warnings:
            seconds = least_seconds(rollouts)
    return _course_of(scene, rollouts.first[0], rollouts.states[0], seconds, warnings)


def _course_of(
    scene: Scene, first: Array, states: Array, seconds: float, warnings: list[str]
) -> Course:
    """Return the course in a table of states, whose columns are time, place of the root, ..."""
    last = [last for _, last in portions(scene)]
    path = np.concatenate([first[None, PLACE], states[np.array(last) - 1, PLACE]])
    failure = f'MuJoCo: {warnings[0].partition(".")[0]}' if warnings else ''
    time = scene.dt * np.array([0, *last])
    return Course(time, path, math.nan if failure else seconds, 0, failure)
