# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Joint trajectories as the bytes that the middleware delivers.

rclpy takes 60 ms to make objects of 10 000 points, and a publish period is 5 ms. The numbers are
read from the bytes in less than 1 ms.
"""

from dataclasses import dataclass
import struct

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros.gaits.point_bytes import LISTS, read_points, SHORTEST
from snake_sim_ros.nodes.received_commands import RejectedCommand
from snake_sim_ros.scene.parameters import Array

TOPIC = 'joint_trajectory'
ENCAPSULATION = 4  # bytes before the body, which name its encoding
LITTLE_ENDIAN = b'\x00\x01'  # the encoding that is read here; others are converted


class _Body:
    """The body of a message, read from its begin on."""

    def __init__(self, data: bytes) -> None:
        if data[:2] != LITTLE_ENDIAN:
            data = serialize_message(deserialize_message(data, JointTrajectory))
        self.data, self.place = data[ENCAPSULATION:], 0
        whole = np.zeros(-(-len(self.data) // 8), np.float64)
        whole.view(np.uint8)[: len(self.data)] = np.frombuffer(self.data, np.uint8)
        self.words, self.numbers = whole.view(np.int32), whole

    def word(self, kind: str = 'I') -> int:
        """Return the next whole number."""
        place = -(-self.place // 4) * 4
        self.place = place + 4
        return int(struct.unpack_from(f'<{kind}', self.data, place)[0])

    def text(self) -> str:
        """Return the next text."""
        size = self.word()
        self.place += size
        return self.data[self.place - size : self.place - 1].decode(errors='replace')


@dataclass(frozen=True)
class TrajectoryMessage:
    """
    What the bytes of a message say before its points, and where those begin.

    Attributes
    ----------
    names : list of str
        Names of joints.
    stamp : float
        Stamp of the header [s].
    count : int
        Number of points.

    """

    names: list[str]
    stamp: float
    count: int
    body: _Body

    def points(self) -> tuple[Array, Array, Array | None]:
        """
        Return the points.

        Returns
        -------
        times : ndarray, shape (points,)
            Since the begin of the trajectory [s].
        angle, rate : ndarray, shape (points, joints)
            [rad], [rad/s]. The rate is None if the first point has no velocities.

        Raises
        ------
        RejectedCommand
            If a point does not have as many numbers as there are joints.

        """
        body, joints = self.body, len(self.names)
        # Bytes that end too early do not have room for more points.
        rows = min(self.count, len(body.data) // (SHORTEST + 8 * joints) + 1)
        times, angle, rate = np.empty(rows), np.empty((rows, joints)), np.empty((rows, 0))
        place = -(-body.place // 4) * 4
        read, kind, count = read_points(body.words, body.numbers, place, times, angle, rate)
        if (read, kind) == (0, 1) and count > 0:
            rate = np.empty((rows, joints))
            read, kind, count = read_points(body.words, body.numbers, place, times, angle, rate)
        if count < 0 or read == rows < self.count:
            raise _no_trajectory()
        if read < rows:
            wanted = (joints, rate.shape[1])[kind]
            raise RejectedCommand(
                'length',
                f'{TOPIC}: point {read + 1} must have {wanted} {LISTS[kind]}, got {count} '
                f'(as many as joints; velocities in all points or in none)',
            )
        return times, angle, rate if rate.size else None


def read_message(data: bytes) -> TrajectoryMessage:
    """Return what the bytes of a JointTrajectory say."""
    try:
        body = _Body(data)
        seconds, nanoseconds = body.word('i'), body.word()
        body.text()  # the frame
        names = [body.text() for _ in range(body.word())]
        return TrajectoryMessage(names, seconds + 1e-9 * nanoseconds, body.word(), body)
    except (struct.error, RuntimeError):  # The latter if bytes are in another order.
        raise _no_trajectory() from None


def _no_trajectory() -> RejectedCommand:
    return RejectedCommand(
        'bytes', f'{TOPIC}: the bytes of a message end before its points do; it is damaged'
    )
