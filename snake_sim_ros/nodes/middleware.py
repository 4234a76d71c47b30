# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""With which settings the nodes start Fast DDS, unless the user has others."""

from importlib.metadata import version
import os

from snake_sim_ros.scene.files import CONFIG

PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
USE_PROFILES = 'RMW_FASTRTPS_USE_QOS_FROM_XML'
# With profiles, the last one of these would be ignored.
OF_USER = (*PROFILES, USE_PROFILES, 'RMW_FASTRTPS_PUBLICATION_MODE')
# Each of the many buffers of a subscription keeps the size of the largest message it ever held,
# unless Fast DDS is told otherwise. Its variable has the second name from kilted on, where it
# warns of the first one.
NO_BUFFERS = {
    USE_PROFILES: '1',
    PROFILES[int(version('rclpy').partition('.')[0]) >= 9]: str(CONFIG / 'fastdds_no_buffers.xml'),
}


def keep_no_buffers() -> None:
    """Have this process keep no buffers of messages; settings of the user come first."""
    if not any(name in os.environ for name in OF_USER):
        os.environ.update(NO_BUFFERS)
