# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of a run from its samples: joints, contact forces and levels."""

import math
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.contact_forces import last_span, sampled_forces
from snake_sim_ros.stepping.samples import make_samples, Samples
from snake_sim_ros.stepping.state import History, State
from snake_sim_ros.stepping.trajectory import Trajectory

LEVELS = np.array(['spatial', 'planar'])


class Keep(NamedTuple):
    """
    What to keep of every sample besides state, joint torques and level.

    Attributes
    ----------
    contacts : bool
        Points and forces of the contacts that carry load.
    impulses : bool
        Impulses of all contacts, closed or not.

    """

    contacts: bool = False
    impulses: bool = False


class Limits(NamedTuple):
    """Limits that end a run before its last sample, as a step that diverges does."""

    seconds: float = math.inf  # wall time of all steps [s]
    unconverged: float = math.inf  # number of steps that did not converge


NO_LIMITS = Limits()
STATES = Keep()


def begun_samples(
    scene: Scene, state: State, history: History, last: Report, steps: int, samples: int
) -> Samples:
    """
    Return arrays for samples after the present state, which is the first of them.

    Parameters
    ----------
    scene : Scene
    state : State
    history : History
    last : Report
        Of the last steps.
    steps : int
        Number of steps between two samples.
    samples : int
        Number of samples after the first one.

    """
    found = make_samples(scene, steps, samples + 1)._replace(first=0)
    found.add(-1, state, history, last.joint_torque, last_span(scene, history))
    found.is_planar[0] = last.level == 'planar'
    return found


def joint_motion(q: Array, u: Array) -> tuple[Array, Array]:
    """
    Return angles and rates of the joints in some states, computed as in a compiled step.

    Parameters
    ----------
    q : ndarray, shape (m, n, 7)
    u : ndarray, shape (m, n, 6)
        See `state.State`.

    Returns
    -------
    angle, rate : ndarray, shape (m, n-1, 2)
        (yaw, pitch) [rad], [rad/s].

    """
    m, n, _ = q.shape
    coordinate = np.empty((m, n - 1, 2, 2))
    kinematics.joint_motions(q, u, np.empty((n, 3, 3)), np.empty((n, 3)), coordinate)
    return coordinate[..., 0], coordinate[..., 1]


def trajectory_of(
    scene: Scene, samples: Samples, keep: Keep, report: Report, seconds: float, *,
    interrupted: bool,
) -> Trajectory:  # fmt: skip
    """
    Return the record of samples, the first of which is the start.

    Parameters
    ----------
    scene : Scene
    samples : Samples
    keep : Keep
    report : Report
    seconds : float
        See `Trajectory`.
    interrupted : bool

    """
    m, q, u = len(samples.q), samples.q, samples.u
    joint_angle, joint_velocity = joint_motion(q, u)
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
        joint_angle=joint_angle,
        joint_velocity=joint_velocity,
        joint_torque=samples.torque,
        contact_sample=sample,
        contact_number=number,
        contact_point=points,
        contact_force=forces,
        level=level if m > 1 else np.array([report.level]),
        report=report,
        seconds=seconds,
        interrupted=interrupted,
        velocity=u,
        impulse=samples.impulse if keep.impulses else np.zeros((m, 0)),
    )
