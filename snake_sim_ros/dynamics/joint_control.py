# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
PD control of the axes of cardan joints, and the control loop of a real robot around it.

Assumption: the paper prints the gains of the controller, but not its formula. Here the derivative
term acts on the difference to the reference rate.

Without a control loop the controller of a joint knows angles, rates and references at any time.
The loop of a real robot has sampled angles, late commands, encoders, and torques as commands:

- With a rate of references it takes one reference once a period and goes to that angle, as a servo
  on a bus does.
- With a rate of control it also reads the encoders once a period and holds what it read, so that
  its spring pulls with a constant torque until the next period. A sampled spring is stable for
  periods up to about 2 K_d/K_p, as an explicit one.
- The damper acts all the time, as the back-EMF of a motor does, and takes its reference rate once
  a period: that of the middle of the step.

Assumption: the paper has no such loop.
"""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.compilation import compiled, inlined
from snake_sim_ros.dynamics.spatial_vectors import Three
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array, PD_SCHEMES, Robot, Scene, steps_in

START, MIDPOINT, AVERAGE, END = range(len(PD_SCHEMES))


@compiled
def pd_law(
    scheme: int,
    dt: float,
    start: tuple[float, float],
    mid: tuple[float, float],
    reference: tuple[float, float],
    gains: tuple[float, float],
) -> tuple[float, float]:
    """
    Return torque and damping of the law ``torque - damping * rate_end`` that acts in a step.

    The scheme determines at which angle, rate and time the controller looks:

    - START: all at the start of the step, explicit; stable only for ``dt < 2 K_d/K_p``.
    - MIDPOINT: angle and time at the middle, rate at the start, explicit.
    - AVERAGE: mean angle and mean rate of the step, linearly implicit, of second order:
      ``angle_mean = angle_mid + dt/4 (rate_end - rate_start)``.
    - END: all at the end, linearly implicit: ``angle_end = angle_mid + dt/2 rate_end``.

    Parameters
    ----------
    scheme : int
        START, MIDPOINT, AVERAGE or END.
    dt : float
        Time step [s].
    start, mid : tuple of float
        Joint angle [rad] and rate [rad/s] in the configurations at start and middle of the step,
        both rates with the velocities of the start.
    reference : tuple of float
        Reference angle [rad] and rate [rad/s] at the middle of the step.
    gains : tuple of float
        Stiffness and damping [N m/rad], [N m s/rad].

    Returns
    -------
    torque : float
        [N m]
    damping : float
        Coefficient of the joint rate at the end of the step [N m s/rad]; 0 in explicit schemes.

    """
    (angle, rate), (stiffness, damping) = reference, gains
    if scheme == START:
        angle -= dt / 2 * rate
        return stiffness * (angle - start[0]) + damping * (rate - start[1]), 0.0
    if scheme == MIDPOINT:
        return stiffness * (angle - mid[0]) + damping * (rate - mid[1]), 0.0
    if scheme == AVERAGE:
        angle += dt / 4 * mid[1]
        torque = stiffness * (angle - mid[0]) + damping * (rate - mid[1] / 2)
        return torque, damping / 2 + stiffness * dt / 4
    angle += dt / 2 * rate
    return stiffness * (angle - mid[0]) + damping * rate, damping + stiffness * dt / 2


@compiled
def implicit_pd_law(
    h: float, angle: float, reference: tuple[float, float], gains: tuple[float, float], held: float
) -> tuple[float, float]:
    """
    Return torque and damping as `pd_law` does, with all at the end, of which a part is known.

    The angle [rad] is that of the end without what the rate there adds in a time h [s]. The
    references are those of the end; gains are as in `pd_law`, and `held` acts besides [N m].
    """
    stiffness, damping = gains
    torque = held + stiffness * (reference[0] - angle)
    return torque + damping * reference[1], damping + stiffness * h


class ControlLoop(NamedTuple):
    """The numbers of the loop of a scene."""

    present: bool  # whether controllers have sampled or late inputs, or take torques as commands
    period: int  # steps from one reading of the encoders to the next; 0: they are read always
    hold: int  # steps from one reference that is taken to the next; 0: all are taken
    delay: int  # steps after which a reference takes effect
    resolution: float  # of the encoders [rad]; 0: they are exact


MOST_LATE = 100_000  # steps for which references wait: 300 MB for 200 links


class ControlMemory(NamedTuple):
    """What the loop keeps from step to step, of axes (yaw, pitch); empty without a loop."""

    effort: Array  # (n-1, 2) torques that are commanded, besides that of the controller [N m]
    error: Array  # (n-1, 2) held difference of reference and measured angle [rad]
    rate: Array  # (n-1, 2) held reference rate [rad/s]
    wait: Array  # (2,) steps to the next reading of the encoders, and of the references
    next: Array  # (1,) the oldest place in the queue, from 1; 0 before the first step
    # (delay, 2, n-1, 2) references (angle, rate) that are not in effect yet [rad], [rad/s]
    queue: Array
    late: Array  # (2, n-1, 2) references in effect in this step [rad], [rad/s]
    held_reference: Array  # (2, n-1, 2) those that are held, with rates 0 [rad], [rad/s]


def control_periods(robot: Robot) -> dict[str, float]:
    """Return name -> period or delay of the controllers, of which steps divide each [s]."""
    rates = {'control period': robot.control_rate, 'reference period': robot.reference_rate}
    periods = {name: 1.0 / rate for name, rate in rates.items() if rate > 0.0}
    delay = {'robot.command_delay': robot.command_delay} if robot.command_delay > 0.0 else {}
    return periods | delay


def make_control_loop(scene: Scene) -> ControlLoop:
    """
    Return the loop of a scene.

    Raises
    ------
    ParameterError
        If the period or the delay is no multiple of the time step.

    """
    robot, dt = scene.robot, scene.dt
    steps = {name: steps_in(time, dt, name) for name, time in control_periods(robot).items()}
    period, hold = steps.get('control period', 0), steps.get('reference period', 0)
    late = steps.get('robot.command_delay', 0)
    if late > MOST_LATE:
        raise ParameterError(
            f'robot.command_delay must be at most {MOST_LATE} steps, got {late} of {dt:g} s'
        )
    present = period + hold + late > 0 or robot.effort_commands
    return ControlLoop(present, period, hold, late, robot.encoder_resolution)


def make_control_memory(scene: Scene) -> ControlMemory:
    """Return the memory before the first step."""
    loop = make_control_loop(scene)
    axes = (scene.robot.link_count - 1 if loop.present else 0, 2)
    return ControlMemory(
        effort=np.zeros(axes),
        error=np.zeros(axes),
        rate=np.zeros(axes),
        wait=np.zeros(2),
        next=np.zeros(1),
        queue=np.zeros((loop.delay, 2, *axes)),
        late=np.zeros((2, *axes)),
        held_reference=np.zeros((2, *axes)),
    )


@compiled
def references_that_count(
    loop: ControlLoop, memory: ControlMemory, dt: float, angle: Array, rate: Array
) -> tuple[Array, Array]:
    """
    Return the references in effect in a step of dt [s], (n-1, 2); those given are the newest.

    Before the first step the robot held the angles with which that step begins.
    """
    if loop.delay == 0:
        return angle, rate
    queue, late = memory.queue, memory.late
    if memory.next[0] == 0.0:
        for i in range(loop.delay):
            for j in range(len(angle)):
                for k in range(2):
                    queue[i, 0, j, k] = angle[j, k] - 0.5 * dt * rate[j, k]
                    queue[i, 1, j, k] = 0.0
        memory.next[0] = 1.0
    oldest = int(memory.next[0]) - 1
    for j in range(len(angle)):
        for k in range(2):
            late[0, j, k], late[1, j, k] = queue[oldest, 0, j, k], queue[oldest, 1, j, k]
            queue[oldest, 0, j, k], queue[oldest, 1, j, k] = angle[j, k], rate[j, k]
    memory.next[0] = 1 + (oldest + 1) % loop.delay
    return late[0], late[1]


@compiled
def references_that_are_held(
    loop: ControlLoop, memory: ControlMemory, dt: float, angle: Array, rate: Array
) -> tuple[Array, Array]:
    """Return the references of a step as held by a loop that takes one once a period."""
    if loop.hold == 0:
        return angle, rate
    if memory.wait[1] == 0.0:
        memory.wait[1] = loop.hold
        for j in range(len(angle)):
            for k in range(2):
                memory.held_reference[0, j, k] = angle[j, k] - 0.5 * dt * rate[j, k]
    memory.wait[1] -= 1.0
    return memory.held_reference[0], memory.held_reference[1]


@inlined
def read_by_controllers(
    loop: ControlLoop,
    memory: ControlMemory,
    dt: float,
    start: tuple[Array, Array, float],
    angle: Array,
    rate: Array,
) -> tuple[Array, Array]:
    """
    Return the references (n-1, 2) in effect in a step, after what the loop reads at its start.

    `start` are joint angles and rates, shapes (n-1, 2), and how long after the start of the step
    they were so [rad], [rad/s], [s]. `angle` and `rate`, shape (n-1, 2), are the references at the
    middle of the step of dt [s].
    """
    if not loop.present:
        return angle, rate
    angle, rate = references_that_count(loop, memory, dt, angle, rate)
    angle, rate = references_that_are_held(loop, memory, dt, angle, rate)
    if loop.period > 0:
        if memory.wait[0] == 0.0:
            memory.wait[0] = loop.period
            for j in range(len(angle)):
                for k in range(2):
                    read = start[0][j, k] - start[2] * start[1][j, k]
                    if loop.resolution > 0.0:
                        read = loop.resolution * math.floor(read / loop.resolution + 0.5)
                    memory.error[j, k] = angle[j, k] - 0.5 * dt * rate[j, k] - read
                    memory.rate[j, k] = rate[j, k]
        memory.wait[0] -= 1.0
    return angle, rate


@inlined
def torques_jump(loop: ControlLoop, memory: ControlMemory) -> bool:
    """Return whether what is held changed as `read_by_controllers` began the step."""
    reads = loop.period > 0 and memory.wait[0] == loop.period - 1
    return reads or (loop.hold > 0 and memory.wait[1] == loop.hold - 1)


@compiled
def held_torque(
    loop: ControlLoop, memory: ControlMemory, j: int, k: int, stiffness: float, rate: float
) -> Three:
    """
    Return what is held on axis k of joint j, and what its controller knows at any time.

    From the stiffness [N m/rad] of the controller and the reference rate in effect [rad/s]: the
    torque that is constant until the next sample or command [N m], and stiffness and rate of the
    spring and of the damper that act all the time.
    """
    torque = memory.effort[j, k] if len(memory.effort) > 0 else 0.0
    if loop.period > 0:
        return torque + stiffness * memory.error[j, k], 0.0, memory.rate[j, k]
    return torque, stiffness, rate
