"""
Samples of a run while it lasts, and the record that is made of them.

The numbers of a sample are kept in arrays that are allocated before the first step.
"""

from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.contact_forces import contact_forces
from snake_sim_ros.stepping.contact_forces import loaded_contacts
from snake_sim_ros.stepping.state import History
from snake_sim_ros.stepping.state import State
from snake_sim_ros.stepping.trajectory import Trajectory

NO_CONTACTS = np.zeros((0, 3)), np.zeros((0, 3))  # points, forces


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


class Samples:
    """
    The samples of a run, in arrays of fixed size.

    Parameters
    ----------
    scene : Scene
    size : int
        Largest number of samples.
    keep : Keep

    Attributes
    ----------
    count : int
        Number of samples. It is increased last, so that an interrupted sample does not count.

    """

    def __init__(self, scene: Scene, size: int, keep: Keep) -> None:
        n, contacts = scene.robot.link_count, contact_count(scene)
        self.scene, self.keep, self.count = scene, keep, 0
        self.q, self.u = np.empty((size, n, 7)), np.empty((size, n, 6))
        self.torque = np.empty((size, n - 1, 2))
        self.impulse = np.empty((size, contacts, 5) if keep.impulses else 0)
        self.loaded = np.zeros((size, contacts if keep.contacts else 0), dtype=bool)
        self.levels: list[str] = []
        self.contacts: list[tuple[Array, Array]] = []

    def add(self, state: State, history: History, report: Report) -> None:
        """Add a sample: the state, and the report and the history of the step before it."""
        k, impulse, touching = self.count, history.impulse, NO_CONTACTS
        self.q[k], self.u[k], self.torque[k] = state.q, state.u, report.joint_torque
        if self.keep.impulses:
            self.impulse[k] = impulse
        if self.keep.contacts:
            self.loaded[k, loaded_contacts(history)] = True
            touching = contact_forces(self.scene, state, history)
        self.contacts[k:] = [touching]
        self.levels[k:] = [report.level]
        self.count += 1

    def trajectory(
        self, period: tuple[int, float], report: Report, seconds: float, *, interrupted: bool
    ) -> Trajectory:
        """
        Return the record of these samples.

        Parameters
        ----------
        period : tuple of int and float
            Number of steps between two samples, and the time step [s].
        report : Report
        seconds : float
            See `Trajectory`.
        interrupted : bool

        """
        m, (steps, dt) = self.count, period
        q, u = self.q[:m], self.u[:m]
        joint_angle, joint_velocity = joint_motion(q, u)
        samples, numbers = np.nonzero(self.loaded[:m])
        points, forces = zip(*self.contacts[:m], strict=True)
        levels = self.levels[:m]
        return Trajectory(
            scene=self.scene,
            time=np.arange(m) * steps * dt,
            position=q[:, :, :3],
            orientation=q[:, :, 3:],
            joint_angle=joint_angle,
            joint_velocity=joint_velocity,
            joint_torque=self.torque[:m],
            contact_sample=samples,
            contact_number=numbers,
            contact_point=np.concatenate(points),
            contact_force=np.concatenate(forces),
            level=np.array(levels[1:2] + levels[1:]) if m > 1 else np.array([report.level]),
            report=report,
            seconds=seconds,
            interrupted=interrupted,
            velocity=u,
            impulse=self.impulse[:m],
        )
