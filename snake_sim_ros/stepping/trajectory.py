# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of a run: poses, joints and contacts of a robot over time."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.base import Report

KINDS = {'f': 'floats', 'i': 'integers', 'U': 'text'}  # of numbers in arrays


class JointMotion(NamedTuple):
    """The joints over time, rows at k instants; columns as in `Trajectory`."""

    time: Array  # (k,) [s]
    angle: Array  # (k, axes) [rad]
    velocity: Array  # (k, axes) [rad/s]
    torque: Array  # (k, axes) of the step before, 0 at the start [N m]


@dataclass(frozen=True)
class Trajectory:
    """
    The motion of a robot of n links at m instants, computed by any method.

    Attributes
    ----------
    scene : Scene
    time : ndarray, shape (m,)
        [s]
    position : ndarray, shape (m, n, 3)
        Link centers [m, frame I].
    orientation : ndarray, shape (m, n, 4)
        Euler parameters of the link frames B, scalar first.
    joint_angle, joint_velocity, joint_torque : ndarray, shape (m, axes)
        Columns in the order of `scene.robot.axis_names` [rad], [rad/s], [N m]; `Robot.by_joint`
        returns them as (yaw, pitch) of every joint. The torque is that of the step before, 0 at
        the start.
    contact_sample, contact_number : ndarray of int, shape (k,)
        Every contact that carried load in the step before a sample: the index of the sample, and
        the number of the contact as in `scene.obstacles`; -1 if it is not known. The first are
        those of the spheres on the floor, of Aiko the front, then the rear ones.
    contact_point, contact_force : ndarray, shape (k, 3)
        As `contact_forces` returns them [m], [N], frame I.
    level : ndarray of str, shape (m,)
        Model level of the step before; at the start that of the first step.
    report : Report
        Report of all steps, including those after the last sample.
    seconds : float
        Wall time of all steps, without recording and compiling [s]. For `simulation.run` it is
        all that passes from the first step to the record, but for compiling.
    interrupted : bool
        Whether the run was ended from the keyboard.
    velocity : ndarray, shape (m, n, 6)
        Velocities of the links as in `state.State`; empty if they are not known.
    impulse : ndarray, shape (m, contacts, 5)
        Contact impulses of the step before, as in `state.History`, 0 at the start [N s]; empty if
        they were not kept.
    joint_steps : ndarray, shape (3, k, axes)
        `joint_angle`, `joint_velocity` and `joint_torque` at the start and after every step; empty
        if they were not kept.

    """

    scene: Scene
    time: Array
    position: Array
    orientation: Array
    joint_angle: Array
    joint_velocity: Array
    joint_torque: Array
    contact_sample: Array
    contact_number: Array
    contact_point: Array
    contact_force: Array
    level: Array
    report: Report
    seconds: float
    interrupted: bool
    velocity: Array = field(default_factory=lambda: np.zeros(0))
    impulse: Array = field(default_factory=lambda: np.zeros(0))
    joint_steps: Array = field(default_factory=lambda: np.zeros(0))

    @property
    def coordinates(self) -> Array:
        """Coordinates of the links as in `state.State`, shape (m, n, 7)."""
        return np.concatenate([self.position, self.orientation], axis=-1)

    @property
    def joints(self) -> JointMotion:
        """The joints at the start and after every step, or at the samples if only those exist."""
        if not self.joint_steps.size:
            motion = self.joint_angle, self.joint_velocity, self.joint_torque
            return JointMotion(self.time, *motion)
        steps = np.arange(self.joint_steps.shape[1])
        return JointMotion(self.time[0] + steps * self.scene.dt, *self.joint_steps)

    @property
    def axis(self) -> Array:
        """Unit vectors e_z^B along the links, toward link n, shape (m, n, 3) [frame I]."""
        return np.asarray(rotation_matrices(self.orientation)[..., 2])

    @property
    def path(self) -> Array:
        """Center of the middle link, shape (m, 3) [m, frame I]."""
        return np.asarray(self.position[:, self.position.shape[1] // 2])

    def contacts(self, k: int) -> tuple[Array, Array]:
        """Return points and forces of the contacts at a sample, shape (contacts, 3) each."""
        first, last = np.searchsorted(self.contact_sample, [k, k + 1])
        return self.contact_point[first:last], self.contact_force[first:last]

    def every(self, stride: int) -> 'Trajectory':
        """Return a record of every `stride`-th sample, from the first on, with its own arrays."""
        kept = self.contact_sample % stride == 0
        arrays = {name: getattr(self, name)[::stride].copy() for name in OF_SAMPLES}
        arrays |= {name: getattr(self, name)[kept] for name in OF_CONTACTS}
        arrays['contact_sample'] //= stride
        return replace(self, **arrays)

    def between(self, begin: float, end: float) -> 'Trajectory':
        """
        Return the part from one time to another [s], whose times stay.

        Its ends are the samples next to these times, and the joints those of all steps
        between them.
        """
        half = (self.time[1] - self.time[0]) / 2 if len(self.time) > 1 else 0.0
        first, last = np.searchsorted(self.time, [begin - half, end + half])
        inside = (self.contact_sample >= first) & (self.contact_sample < last)
        arrays = {name: getattr(self, name)[first:last] for name in OF_SAMPLES}
        arrays |= {name: getattr(self, name)[inside] for name in OF_CONTACTS}
        arrays['contact_sample'] = arrays['contact_sample'] - first
        if self.joint_steps.size and len(arrays['time']):
            ends = np.rint((arrays['time'][[0, -1]] - self.time[0]) / self.scene.dt).astype(int)
            arrays['joint_steps'] = self.joint_steps[:, ends[0] : ends[1] + 1]
        return replace(self, **arrays)

    def check(self) -> None:
        """
        Check that all arrays belong to one run of the scene.

        Raises
        ------
        ParameterError
            If an array has a shape or values that no run of the scene can have.

        """
        axes = len(self.scene.robot.axis_names)
        n, m, k = self.scene.robot.link_count, np.size(self.time), np.size(self.contact_sample)
        for names, kind, shape in (
            (('time',), 'f', (m,)),
            (('position',), 'f', (m, n, 3)),
            (('orientation',), 'f', (m, n, 4)),
            (('joint_angle', 'joint_velocity', 'joint_torque'), 'f', (m, axes)),
            (('contact_sample', 'contact_number'), 'i', (k,)),
            (('contact_point', 'contact_force'), 'f', (k, 3)),
            (('level',), 'U', (m,)),
            (('velocity',), 'f', (m, n, 6) if self.velocity.size else self.velocity.shape),
            (
                ('joint_steps',),
                'f',
                (3, np.shape(self.joint_steps)[1], axes) if self.joint_steps.ndim == 3 else (0,),
            ),
        ):
            for name in names:
                array = getattr(self, name)
                if array.shape != shape or array.dtype.kind != kind:
                    raise ParameterError(
                        f'{name} must have shape {shape} of {KINDS[kind]}, got {array.shape} of '
                        f'{array.dtype}'
                    )
        if not all(map(str.isprintable, self.level.tolist())):
            raise ParameterError('level must be printable text')
        if not m:
            raise ParameterError('time must have a sample, got none')
        if not (np.isfinite(self.time).all() and (np.diff(self.time) >= 0.0).all()):
            raise ParameterError('time must be finite and never go back')
        count = contact_count(self.scene)
        for name, array, low, high in (
            ('contact_sample', self.contact_sample, 0, m - 1),
            ('contact_number', self.contact_number, -1, count - 1),
        ):
            if k and not low <= array.min() <= array.max() <= high:
                raise ParameterError(
                    f'{name} must be {low} to {high}, got {array.min()} to {array.max()}'
                )
        if (np.diff(self.contact_sample) < 0).any():
            raise ParameterError('contact_sample must be in the order of the samples')


# Arrays of a trajectory with an entry for each sample, and for each contact of each sample.
OF_SAMPLES = (
    *('time', 'position', 'orientation', 'joint_angle', 'joint_velocity', 'joint_torque'),
    *('level', 'velocity', 'impulse'),
)
OF_CONTACTS = ('contact_sample', 'contact_number', 'contact_point', 'contact_force')
