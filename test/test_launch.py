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
from xml.etree import ElementTree

import pytest

from snake_sim_ros.scene.files import parse_yaml
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.robot_description import robot_description

ROOT = Path(__file__).resolve().parent.parent


class Given(SimpleNamespace):
    """Keeps its arguments."""

    def __init__(self, *arguments, **names):
        names['arguments_of'] = names.pop('arguments', None)  # of the program that a Node starts
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
    packages.get_package_share_directory = lambda name: str(ROOT)
    return module_of('snake.launch.py'), installed


def module_of(name):
    """Return a launch file as a module."""
    spec = importlib.util.spec_from_file_location('launch_file', ROOT / 'launch' / name)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def started(launch_file, **arguments):
    """Return name of the executable -> namespace and parameters, for values of the arguments."""
    *declared, function = launch_file.generate_launch_description().arguments[0]
    values = {item.arguments[0]: item.default_value for item in declared}
    assert set(arguments) <= set(values)
    nodes = function.function({**values, **arguments})
    return {node.executable: (node.namespace, *node.parameters) for node in nodes}


def of_sim(scene, **others):
    """Return the parameters of the node sim."""
    own = {'publish_robot_description': True, 'real_time_factor': 1.0}
    return {'scene': scene, **own, **others}


def test_robot_and_gait_are_started(launch_file, monkeypatch):
    module, _ = launch_file
    monkeypatch.setattr(module, 'find_spec', lambda name: None)
    scene = 'lateral_undulation'
    assert started(module) == {
        'sim': ('', of_sim(scene)),
        'gait': ('', {'scene': scene, 'use_sim_time': True}),
    }


@pytest.mark.parametrize(
    ('text', 'names'),
    [
        ('{}', ['gait']),
        ('follow: {points: [[0, 0], [2, 0]]}', ['gait', 'follow']),
        ('controller: oscillators', ['control']),
        ('{controller: gait, follow: {points: [[0, 0], [2, 0]]}}', ['gait']),
    ],
)
def test_what_moves_the_robot_is_what_the_scene_names(
    launch_file, monkeypatch, tmp_path, text, names
):
    module, _ = launch_file
    monkeypatch.setattr(module, 'find_spec', lambda name: None)
    scene = tmp_path / 'own.yaml'
    scene.write_text(text)
    found = started(module, scene=str(scene))
    assert list(found) == ['sim', *names]
    for name in names:
        assert found[name] == ('', {'scene': str(scene), 'use_sim_time': True})


def test_arguments_reach_the_nodes(launch_file, monkeypatch):
    module, _ = launch_file
    monkeypatch.setattr(module, 'find_spec', lambda name: object())
    found = started(module, real_time_factor='0.5', parameters='own.yaml', port='9000')
    assert found['sim'][1]['real_time_factor'] == 0.5
    assert found['viewer'][1]['port'] == 9000
    assert {name: parameters[2] for name, parameters in found.items()} == {
        'sim': 'own.yaml', 'gait': 'own.yaml', 'viewer': 'own.yaml'
    }  # fmt: skip
    assert 'viewer' not in started(module, viewer='false')


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
        'sim': ('aiko', of_sim(scene, publish_robot_description=False)),
        'gait': ('aiko', {'scene': scene, 'use_sim_time': True}),
        'viewer': ('aiko', {'scene': scene, 'port': 8080}),
        'robot_state_publisher': ('aiko', frames),
    }


def test_controllers_find_the_robot_and_its_topics(launch_file):
    *declared, function = (
        module_of('ros2_control.launch.py').generate_launch_description().arguments[0]
    )
    values = {item.arguments[0]: item.default_value for item in declared}
    nodes = function.function(
        {**values, 'scene': 'sidewinding', 'interfaces': 'position velocity'}
    )
    sim, publisher, manager, active, inactive = nodes
    assert sim.parameters[0]['publish_robot_description'] is False
    description = manager.parameters[0]['robot_description']
    assert publisher.parameters == [manager.parameters[0]]
    assert manager.parameters[0]['use_sim_time']
    hardware = ElementTree.fromstring(description).find('ros2_control/hardware')
    topics = {item.get('name'): item.text for item in hardware.findall('param')}
    for name, own in (('joint_states', 'joint_states'), ('joint_commands', 'joint_command')):
        assert topics[f'{name}_topic'] == f'/{dict(sim.remappings)[own]}'
    file = values['controllers']
    assert manager.parameters[1] == file
    started = ['joint_state_broadcaster', 'joint_trajectory_controller']
    assert active.arguments_of == [*started, '--param-file', file]
    assert inactive.arguments_of[-1] == '--inactive'
    (sensing, *_) = function.function({**values, 'parameters': 'imu.yaml'})
    assert sensing.parameters == [{**sim.parameters[0], 'scene': values['scene']}, 'imu.yaml']
    # Each controller that is started has its type and joints of the robot in the file.
    given = parse_yaml(Path(file).read_text(encoding='utf-8'))
    names = list(load_scene('sidewinding').robot.axis_names)
    for name in (*started, inactive.arguments_of[0]):
        parameters = given[name]['ros__parameters']
        assert parameters['type'].startswith(f'{name.replace("_position", "_command")}/')
        assert parameters.get('joints', names) == names
