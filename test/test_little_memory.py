# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes with little memory, and messages for which there is none."""

import subprocess
import sys
import tracemalloc

import pytest

from snake_sim_ros import Scene
from snake_sim_ros.nodes.received_commands import axes_of, RejectedCommand
from snake_sim_ros.scene.checked_records import cut


def test_a_node_with_too_little_memory_names_the_limit():
    limited = (
        'import resource, runpy, sys; '
        'resource.setrlimit(resource.RLIMIT_AS, (5 * 10**8, 5 * 10**8)); '
        'sys.argv[1:] = ["gait"]; '
        'runpy.run_module("snake_sim_ros.nodes", run_name="__main__", alter_sys=True)'
    )
    ended = subprocess.run(
        [sys.executable, '-c', limited], capture_output=True, text=True, timeout=60, check=False
    )
    assert ended.returncode == 2
    assert ended.stderr == (
        'error: gait needs 600 MB of memory addresses, and the limit (ulimit -v) is 500 MB\n'
    )


def test_a_very_long_name_of_a_joint_takes_little_memory():
    name = 'x' * 10**7
    tracemalloc.start()
    try:
        with pytest.raises(RejectedCommand, match='unknown joint') as caught:
            axes_of('joint_command', [name], Scene().robot)
        assert tracemalloc.get_traced_memory()[1] < 1e6
    finally:
        tracemalloc.stop()
    assert len(str(caught.value)) < 250
    assert cut('a' + name + 'b') == f'a{"x" * 37}...{"x" * 37}b'
