# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What is done to the robot of the node `sim` from outside, besides commands: pushes and placing.

A message on ``~/push`` (geometry_msgs/WrenchStamped) pushes a link for `push_duration`. Its frame
is that of a link, which is pushed, and whose axes the force keeps; or `world`, and the link is
`push_link`. A message on ``~/set_pose`` (geometry_msgs/PoseStamped) puts ``base_link``, as
``odom`` has it, into a pose, with the joint angles that the robot has, at rest.
"""

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseStamped, WrenchStamped
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile

from snake_sim_ros.nodes.refusals import Refusals
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.nodes.state_messages import BASE, ODOM, WORLD
from snake_sim_ros.recording.from_messages import WIRE_AXES
from snake_sim_ros.recording.sensors import link_index
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.quoting import quoted
from snake_sim_ros.scene.rotations import FLAT, product
from snake_sim_ros.stepping.placing import place
from snake_sim_ros.stepping.simulation import Simulation

TURN = np.array([0.0, 0.0, 0.0, 1.0])  # half a turn about z, from the middle link to the base
FASTEST, FASTEST_TURN = 100.0, 50.0  # m/s, rad/s of a link beyond which nothing pushes
FARTHEST = 1e4  # m from the origin where a robot may be put
UNIT_ERROR = 1e-3  # by which the norm of a quaternion may be off 1
LATEST = QoSProfile(depth=1)
SEVERAL = QoSProfile(depth=10)  # pushes on several links at once


class Handling:
    """
    Takes pushes and poses.

    Parameters
    ----------
    node : Node
    simulation : Simulation
    settings : Settings
    refusals : Refusals
    moved : callable
        Called when the robot was put elsewhere.

    Attributes
    ----------
    settings : Settings
        The node replaces them when its parameters change.
    refusals : Refusals

    """

    def __init__(
        self,
        node: Node,
        simulation: Simulation,
        settings: Settings,
        refusals: Refusals,
        moved: Callable[[], Any],
    ) -> None:
        self.settings, self.refusals = settings, refusals
        self._simulation, self._moved = simulation, moved
        settings.pushed_link(simulation.scene.robot)
        node.create_subscription(WrenchStamped, '~/push', self._on_push, SEVERAL)
        node.create_subscription(PoseStamped, '~/set_pose', self._on_pose, LATEST)

    def limit(self) -> None:
        """End the pushes of messages if the robot moves too fast."""
        if not self._simulation.pushes:
            return
        u = self._simulation.state.u
        speed, spin = (float(np.abs(part).max()) for part in np.split(u, 2, axis=1))
        if not (speed <= FASTEST and spin <= FASTEST_TURN):
            self._simulation.pushes.clear()
            self.refusals.add('push', f'ended, since a link moves {too_fast(speed, spin)}')

    def place(self, frame: str, position: Any, orientation: Any) -> None:
        """
        Put the robot where ``base_link`` has a pose.

        Parameters
        ----------
        frame : str
            Name of the frame of the pose.
        position, orientation : Point, Quaternion
            Of geometry_msgs.

        Raises
        ------
        ParameterError
            If the pose is not usable.

        """
        if frame.rpartition('/')[2] not in ('', WORLD, ODOM):
            raise ParameterError(f'the frame must be {WORLD} or {ODOM}, got {quoted(frame)}')
        r = numbers_of(position, 'xyz', 'position')
        if np.abs(r).max() > FARTHEST:
            raise ParameterError(
                f'position must be within {FARTHEST:g} m, got ({", ".join(f"{x:g}" for x in r)}) m'
            )
        x, y, z, w = numbers_of(orientation, 'xyzw', 'orientation')
        norm = float(np.linalg.norm((x, y, z, w)))
        if not abs(norm - 1.0) <= UNIT_ERROR:
            raise ParameterError(
                f'orientation must be a unit quaternion, got a norm of {norm:.4g}'
            )
        place(self._simulation, r, product(product(np.array([w, x, y, z]) / norm, -TURN), FLAT))
        self._moved()

    def _on_pose(self, message: PoseStamped) -> None:
        pose = message.pose
        try:
            self.place(message.header.frame_id, pose.position, pose.orientation)
        except ParameterError as error:
            self.refusals.add('set_pose', error)

    def _on_push(self, message: WrenchStamped) -> None:
        try:
            self._begin(message)
        except ParameterError as error:
            self.refusals.add('push', error)

    def _begin(self, message: WrenchStamped) -> None:
        robot, frame = self._simulation.scene.robot, message.header.frame_id.rpartition('/')[2]
        force = numbers_of(message.wrench.force, 'xyz', 'force')
        torque = numbers_of(message.wrench.torque, 'xyz', 'torque')
        turns = False
        if frame == BASE:
            raise ParameterError(
                f'the frame {BASE} is not that of a link; link_{robot.middle_link + 1} is there'
            )
        if frame in ('', WORLD, ODOM):
            link = self.settings.pushed_link(robot)
        else:
            link, turns = link_index(frame, robot.link_count, 'header.frame_id'), True
            force, torque = force[np.argsort(WIRE_AXES)], torque[np.argsort(WIRE_AXES)]
        self._check(link, force, torque)
        duration = self.settings.push_duration
        self._simulation.pushes.begin(link, force, torque, duration=duration, turns=turns)

    def _check(self, link: int, force: Array, torque: Array) -> None:
        """Raise an error if the link alone would become too fast in a publish period."""
        robot, period = self._simulation.scene.robot, 1.0 / self.settings.publish_rate
        inertia = robot.per_link('inertia_transversal')[link]
        speed = float(np.abs(force).max() / robot.per_link('link_mass')[link]) * period
        spin = float(np.abs(torque).max() / inertia) * period
        if not (speed <= FASTEST and spin <= FASTEST_TURN):
            raise ParameterError(
                f'link {link + 1} alone would, after {period:g} s, move {too_fast(speed, spin)}'
            )


def too_fast(speed: float, spin: float) -> str:
    """Return a clause on a speed [m/s] and a spin [rad/s] with which nothing is pushed."""
    return (
        f'at {speed:.4g} m/s and turn at {spin:.4g} rad/s; at most {FASTEST:g} m/s and '
        f'{FASTEST_TURN:g} rad/s'
    )


def base_of_link(quaternion: Array) -> Array:
    """Return the orientation x y z w of ``base_link`` from that of the middle link."""
    x, y, z, w = quaternion
    return np.roll(product(np.array([w, x, y, z]), TURN), -1)


def numbers_of(message: Any, names: str, what: str) -> Array:
    """Return fields of a message as numbers; raise an error if one is not finite."""
    found = np.array([getattr(message, name) for name in names])
    if not np.isfinite(found).all():
        raise ParameterError(f'{what} must be finite, got ({", ".join(f"{x:g}" for x in found)})')
    return found
