# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The offline twin of a sim node: the same steps without ROS, one publish period at a time."""

from dataclasses import dataclass

import numpy as np

from snake_sim_ros import Scene, Simulation
from snake_sim_ros.gaits.joint_reference import JointReference, LimitedReference, start_posture
from snake_sim_ros.nodes.sim_parameters import as_it_runs, Settings
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.stepping.sampling import joint_motion

STEPS = 20  # of 1/4000 s in a period of 1/200 s
PERIOD = 5_000_000  # ns
NAMES = [f'joint_{i}_{axis}' for i in range(1, 11) for axis in ('yaw', 'pitch')]
HORIZON = 0.05  # s, the default of command_horizon


@dataclass
class Sample:
    """The values that the state messages of one stamp must have."""

    nanoseconds: int
    angle: Array
    rate: Array
    torque: Array
    position: Array
    velocity: Array  # of the centers and angular, both in the world, shape (n, 6)
    axes: Array  # rotation matrices of the link frames on the wire, shape (n, 3, 3)


class Offline:
    """A simulated scene that holds its start posture until a command; its joints have stops."""

    def __init__(self, scene: Scene) -> None:
        scene = as_it_runs(Settings(), scene, ())
        self.simulation = Simulation(scene)
        self.reference = start_posture(scene)
        self.limiter = LimitedReference(self.reference.angle)

    def sample(self) -> Sample:
        """Return the present state."""
        simulation = self.simulation
        q, u = simulation.state.q, simulation.state.u
        angle, rate = joint_motion(simulation.scene.robot, q[None], u[None])
        # The axes x, y, z on the wire are e_z, e_x, e_y of frame B.
        R = rotation_matrices(q[:, 3:])
        axes = R[:, :, [2, 0, 1]]
        return Sample(
            nanoseconds=simulation.step_count * PERIOD // STEPS,
            angle=angle.ravel(),
            rate=rate.ravel(),
            torque=simulation.last.joint_torque.ravel().copy(),
            position=q[:, :3].copy(),
            velocity=np.hstack([u[:, :3], np.einsum('kij,kj->ki', R, u[:, 3:])]),
            axes=axes,
        )

    def command(self, angles: dict[str, float], rates: dict[str, float] | None = None) -> None:
        """Take a command with the present stamp; joints without a name keep their reference."""
        last = self.reference
        reference = JointReference(last.stamp.copy(), last.angle.copy(), last.rate.copy())
        for name, angle in angles.items():
            k = NAMES.index(name)
            reference.stamp.flat[k] = self.simulation.time
            reference.angle.flat[k] = angle
            reference.rate.flat[k] = (rates or {}).get(name, 0.0)
        self.reference = reference

    def advance(self) -> Sample:
        """Advance by one period and return the state."""
        simulation = self.simulation
        robot = simulation.scene.robot
        times = simulation.midpoints(STEPS)
        told = self.reference.sample(times, HORIZON, robot.limits)
        period, limit = 1e-9 * PERIOD, robot.joint_rate_limit
        report = simulation.advance(
            *self.limiter.limited(times, *told, period=period, limit=limit)
        )
        assert not report.failure
        return self.sample()


def held_then_commanded(scene: Scene, angles: dict[str, float], messages: list) -> list[Sample]:
    """
    Return the run of a sim node that hears one command, up to the last of its joint_states.

    The command comes after the last message of a robot that holds its posture and before the first
    that differs: usually one period apart, more only if a slow reader missed some messages.
    """
    periods = max(nanoseconds(item) for item in messages) // PERIOD
    told = {nanoseconds(item) // PERIOD: np.array(item.position) for item in messages}
    holding, agreed = Offline(scene), 0
    for first in range(1, periods + 1):
        angle = holding.advance().angle
        if first in told and np.abs(told[first] - angle).max() > 1e-9:
            break
        agreed = first if first in told else agreed
    else:
        raise AssertionError('no message differs from a robot that holds its posture')
    for begin in range(agreed, first):
        twin = Offline(scene)
        samples = [twin.sample(), *(twin.advance() for _ in range(begin))]
        twin.command(angles)
        samples += [twin.advance() for _ in range(begin, periods)]
        if np.abs(told[first] - samples[first].angle).max() < 1e-9:
            return samples
    raise AssertionError(f'no command between periods {agreed} and {first} explains the movement')


def nanoseconds(message) -> int:
    """Return the stamp of a message with a header, or of a Clock [ns]."""
    stamp = message.clock if hasattr(message, 'clock') else message.header.stamp
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def wire_axes(orientation) -> Array:
    """Return the rotation matrix of a quaternion message."""
    o = orientation
    return rotation_matrices(np.array([o.w, o.x, o.y, o.z]))


def largest_difference(joint_states, link_poses, sample: Sample) -> float:
    """Return the largest difference of two state messages from a sample, SI."""
    return max(
        np.abs(np.array(joint_states.position) - sample.angle).max(),
        np.abs(np.array(joint_states.velocity) - sample.rate).max(),
        np.abs(np.array(joint_states.effort) - sample.torque).max(),
        np.abs(positions(link_poses) - sample.position).max(),
        max(
            np.abs(wire_axes(pose.orientation) - axes).max()
            for pose, axes in zip(link_poses.poses, sample.axes, strict=True)
        ),
    )


def positions(link_poses) -> Array:
    """Return the link centers [m], shape (n, 3)."""
    return np.array([(p.position.x, p.position.y, p.position.z) for p in link_poses.poses])


def bits(message) -> bytes:
    """Return positions, velocities and efforts of a joint_states message as bytes."""
    return b''.join(bytes(part) for part in (message.position, message.velocity, message.effort))
