# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Make of the bag of a run what a laboratory would have recorded, to try a fit on it.

The clock of the poses is 40 ms ahead. The markers are 3 cm before the centers of the links, and
the frame of their poses is tilted. All that is measured has noise. The new bag does not say which
scene it is of.
"""

import argparse

from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer
import numpy as np

AHEAD = 40_000_000  # ns, of the clock of the poses
MARKER = np.array([0.03, 0.0, 0.0])  # m, in the frame of a link: x toward the next link, z up
ROLL, PITCH = 0.02, -0.03  # rad, of the floor in the frame of the poses
NOISE_POSITION, NOISE_ANGLE = 1e-3, 8.7e-3  # m, rad
TOPICS = '/joint_command', '/joint_states', '/link_poses'


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the product of two quaternions x y z w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def turned(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return a vector turned by a quaternion."""
    return product(product(q, np.append(v, 0.0)), q * [-1.0, -1.0, -1.0, 1.0])[:3]


def measured(pose: object, tilt: np.ndarray, noise: np.random.Generator) -> None:
    """Change the pose of a link to that of its marker in the tilted frame, with noise."""
    r, p = pose.position, pose.orientation
    link = np.array([p.x, p.y, p.z, p.w])
    place = turned(tilt, np.array([r.x, r.y, r.z]) + turned(link, MARKER))
    r.x, r.y, r.z = (place + NOISE_POSITION * noise.standard_normal(3)).tolist()
    off = np.append(NOISE_ANGLE / 2 * noise.standard_normal(3), 1.0)
    wrong = product(off, product(tilt, link))
    p.x, p.y, p.z, p.w = (wrong / np.linalg.norm(wrong)).tolist()


def main() -> None:
    """Read a bag, and write what was measured into another one."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('run', help='MCAP file of a run')
    parser.add_argument('out', help='MCAP file to write')
    arguments = parser.parse_args()
    roll = np.array([np.sin(ROLL / 2), 0.0, 0.0, np.cos(ROLL / 2)])
    pitch = np.array([0.0, np.sin(PITCH / 2), 0.0, np.cos(PITCH / 2)])
    tilt, noise = product(pitch, roll), np.random.default_rng(1)
    with open(arguments.out, 'wb') as file:
        writer, schemas = Writer(file), {}
        for item in read_ros2_messages(arguments.run, topics=TOPICS):
            name, message = item.schema.name, item.ros_msg
            if name not in schemas:
                schemas[name] = writer.register_msgdef(name, item.schema.data.decode())
            if item.channel.topic == '/link_poses':
                stamp = message.header.stamp
                ahead = stamp.sec * 10**9 + stamp.nanosec + AHEAD
                stamp.sec, stamp.nanosec = divmod(ahead, 10**9)
                for pose in message.poses:
                    measured(pose, tilt, noise)
            elif item.channel.topic == '/joint_states':
                angle = np.array(message.position)
                message.position = (
                    angle + NOISE_ANGLE * noise.standard_normal(len(angle))
                ).tolist()
            writer.write_message(
                item.channel.topic, schemas[name], message,
                log_time=item.log_time_ns, publish_time=item.publish_time_ns,
            )  # fmt: skip
        writer.finish()


if __name__ == '__main__':
    main()
