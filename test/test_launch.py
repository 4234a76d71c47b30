# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the launch file starts, with stand-ins for the packages launch and launch_ros.

They are not on PyPI. The stand-ins keep what they are given.
"""

import importlib.util
from pathlib import Path
import sys
from types import ModuleType, SimpleNamespace

import pytest

from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.robot_description import robot_description

FILE = Path(__file__).resolve().parent.parent / 'launch' / 'snake.launch.py'


class Given(SimpleNamespace):
    """Keeps its arguments."""

    def __init__(self, *arguments, **names):
        super().__init__(arguments=arguments, **names)

    def perform(self, context):
        return context[self.arguments[0]]


@pytest.fixture
def launch_file(monkeypatch):
    """The launch file as a module, and a list of the packages that are installed."""
    contents = {
        'launch': ('LaunchContext', 'LaunchDescription'),
        'launch.actions': ('DeclareLaunchArgument', 'OpaqueFunction'),
        'launch.substitutions': ('LaunchConfiguration',),
        'launch_ros': (),
        'launch_ros.actions': ('Node',),
        'ament_index_python': (),
        'ament_index_python.packages': (),
    }
    for name, classes in contents.items():
        module = ModuleType(name)
        for item in classes:
            setattr(module, item, Given)
        monkeypatch.setitem(sys.modules, name, module)
    installed = []
    packages = sys.modules['ament_index_python.packages']
    packages.get_packages_with_prefixes = lambda: dict.fromkeys(installed, '')
    spec = importlib.util.spec_from_file_location('snake_launch', FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, installed


def started(launch_file, **arguments):
    """Return name of the executable -> namespace and parameters, for values of the arguments."""
    *declared, function = launch_file.generate_launch_description().arguments[0]
    values = {item.arguments[0]: item.default_value for item in declared}
    assert set(values) == {'scene', 'namespace'}
    nodes = function.function({**values, **arguments})
    return {node.executable: (node.namespace, *node.parameters) for node in nodes}


def test_robot_and_gait_are_started(launch_file, monkeypatch):
    module, _ = launch_file
    monkeypatch.setattr(module, 'find_spec', lambda name: None)
    scene = 'lateral_undulation'
    assert started(module) == {
        'sim': ('', {'scene': scene, 'publish_robot_description': True}),
        'gait': ('', {'scene': scene, 'use_sim_time': True}),
    }


def test_frames_and_page_are_started_where_they_are_installed(launch_file, monkeypatch):
    module, installed = launch_file
    monkeypatch.setattr(module, 'find_spec', lambda name: object())
    installed.append('robot_state_publisher')
    scene = 'slender_undulation'
    frames = {
        'robot_description': robot_description(load_scene(scene).robot),
        'frame_prefix': 'aiko/',
        'use_sim_time': True,
    }
    assert started(module, scene=scene, namespace='/aiko') == {
        'sim': ('aiko', {'scene': scene, 'publish_robot_description': False}),
        'gait': ('aiko', {'scene': scene, 'use_sim_time': True}),
        'viewer': ('aiko', {'scene': scene}),
        'robot_state_publisher': ('aiko', frames),
    }
