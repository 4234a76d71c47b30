# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Programs that use the nodes over ROS 2: the demo, the live view, the recorder, the pacing."""
