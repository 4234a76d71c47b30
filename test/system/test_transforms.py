# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The transforms of a real `sim`, with the messages of tf2_msgs."""

import numpy as np
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from sim_client import SimClient
from tf2_msgs.msg import TFMessage


def test_transforms_lead_to_where_odom_has_the_base(make_graph):
    graph = make_graph()
    moving = graph.record(TFMessage, '/tf')
    fixed = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.node.create_subscription(TFMessage, '/tf_static', fixed.append, latched)
    sim = SimClient(graph, 'start_paused:=true', '-r __ns:=/aiko', namespace='aiko')
    sim.wait_until_connected()
    graph.until(lambda: fixed and moving, 'transforms')
    (world,) = fixed[0].transforms
    assert (world.header.frame_id, world.child_frame_id) == ('world', 'aiko/odom')
    count = len(moving)
    odom = sim.step()[2]
    graph.until(lambda: len(moving) > count, 'a transform')
    (base,) = moving[-1].transforms
    assert (base.header.frame_id, base.child_frame_id) == ('aiko/odom', 'aiko/base_link')
    assert base.header.stamp == odom.header.stamp
    place, there = base.transform.translation, odom.pose.pose.position
    assert [place.x, place.y, place.z] == pytest.approx([there.x, there.y, there.z])
    turn, orientation = base.transform.rotation, odom.pose.pose.orientation
    parts = [[q.x, q.y, q.z, q.w] for q in (turn, orientation)]
    assert abs(np.dot(*parts)) == pytest.approx(1.0)
