# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""For which scenes the live view starts the node follow, so that paths can be drawn."""

from dataclasses import replace

from snake_sim_ros import Gait, load_scene, Scene, Wave
from snake_sim_ros.nodes.tools.live_view import can_be_steered


def test_gaits_that_move_can_be_steered():
    assert all(can_be_steered(load_scene(name)) for name in ('lateral_undulation', 'sidewinding'))
    still = Gait(yaw=replace(Scene().gait.yaw, angular_frequency=0.0), pitch=Wave())
    assert not can_be_steered(replace(Scene(), gait=still))
