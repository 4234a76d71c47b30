# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The environment of all system tests, and physics that is compiled once for them."""

from importlib.metadata import version
import os
from pathlib import Path

from forks import start_server
from graph import Graph
from programs import next_domain
import pytest
import rclpy

from snake_sim_ros import Scene, Simulation
from snake_sim_ros.gaits.joint_reference import compile_sampling


@pytest.fixture(scope='session', autouse=True)
def environment(tmp_path_factory):
    """Keep to this machine and to the middleware of the wheels; check all fields of messages."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
        patch.setenv('ROS_PYTHON_CHECK_FIELDS', '1')
        patch.setenv('ROS_LOG_DIR', str(tmp_path_factory.mktemp('log')))
        profiles = str(Path(__file__).with_name('fast_discovery.xml'))
        # kilted knows the name of jazzy, and warns of it in every process.
        name = 'FASTRTPS' if int(version('rclpy').partition('.')[0]) < 9 else 'FASTDDS'
        patch.setenv(f'{name}_DEFAULT_PROFILES_FILE', profiles)
        patch.delenv('RMW_IMPLEMENTATION', raising=False)
        patch.delenv('ROS_DOMAIN_ID', raising=False)
        yield os.environ


@pytest.fixture(scope='session', autouse=True)
def compiled(environment):
    """Compile the physics into the cache on disk and load it, so that no node has to."""
    compile_sampling(Scene())
    Simulation(Scene()).compile()
    start_server()


@pytest.fixture
def middleware():
    """Let nodes be made in the process of the test."""
    rclpy.init(domain_id=next_domain())
    yield
    rclpy.shutdown()


@pytest.fixture(scope='module')
def make_graph(compiled):
    """Return a function that makes a domain with a client; everything ends with the module."""
    graphs = []

    def make(**options):
        graphs.append(Graph(**options))
        return graphs[-1]

    yield make
    for graph in graphs:
        graph.close()
