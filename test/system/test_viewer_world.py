# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node viewer sends the solids of a world to its page, as the markers of a sim have them."""

import re
import time

from builtin_interfaces.msg import Time
import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from snake_sim_ros import Box, Pole, Robot, Scene, World
from snake_sim_ros.nodes.state_publishers import SceneMarkers
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.scene.surfaces import surfaces_of

viser = pytest.importorskip('viser')  # brings websockets
connect = pytest.importorskip('websockets.sync.client').connect

TIMEOUT = 30.0  # s
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
WORLD = World(boxes=(Box(rpy=(0.1, 0.2, 0.3)),), poles=(Pole(),))


def has_all(connection, wanted):
    """Return whether all of some bytes come, in any frames."""
    end, left = time.monotonic() + TIMEOUT, list(wanted)
    while left and time.monotonic() < end:
        frame = connection.recv(TIMEOUT)
        left = [each for each in left if each not in frame]
    return not left


def test_solids_are_sent_to_the_page(make_graph):
    graph = make_graph()
    viewer = graph.start('viewer', 'port:=0')
    description = graph.node.create_publisher(String, 'robot_description', LATCHED)
    markers = graph.node.create_publisher(MarkerArray, 'markers', 10)
    description.publish(String(data=robot_description(Robot())))
    graph.until(markers.get_subscription_count, 'the viewer')
    viewer.wait_for('the viewer is at ', TIMEOUT)
    address = re.search(r'http://(127\.0\.0\.1:\d+)', viewer.output)[1]
    shown = SceneMarkers(Scene(world=WORLD))
    # A page has the coordinates of corners as they are, 32 bits each. Those of markers are sorted.
    corners = [np.unique(points, axis=0) for points, _ in surfaces_of(WORLD)]
    wanted = [points.astype(np.float32).tobytes() for points in corners]
    with connect(f'ws://{address}', subprotocols=[f'viser-v{viser.__version__}']) as page:
        shown.fill(Time(), *np.zeros((2, 0, 3)))
        for _ in range(2):  # the description may come after the first
            markers.publish(shown.message)
            graph.spin(0.3)
        shown.fill(Time(), *np.zeros((2, 0, 3)))
        assert not any(marker.ns == 'world' for marker in shown.message.markers)
        markers.publish(shown.message)
        assert has_all(page, wanted)
    with connect(f'ws://{address}', subprotocols=[f'viser-v{viser.__version__}']) as page:
        assert has_all(page, wanted)  # messages without the world take nothing away
