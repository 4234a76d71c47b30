# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Start a simulated robot with what moves it, its frames and its page in the browser.

``ros2 launch snake_sim_ros snake.launch.py scene:=sidewinding namespace:=aiko``. The gait moves
it, or the controller that the scene names; `follow` leads it along the path of the scene. The
frames of the links need the package robot_state_publisher, the page needs viser; what is missing
is left out.
"""

from importlib.util import find_spec
from typing import Any

from ament_index_python.packages import get_packages_with_prefixes
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from snake_sim_ros.controllers.named import GAIT
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.robot_description import robot_description

FRAMES = 'robot_state_publisher'


ARGUMENTS = {  # name -> default value and description
    'scene': ('lateral_undulation', 'a YAML file, or the name of a scene of the package'),
    'namespace': ('', 'of all nodes and their topics'),
    'real_time_factor': ('1.0', 'speed of simulated time'),
    'parameters': ('', 'a YAML file of parameters, which all nodes read last'),
    'viewer': ('true', 'whether to show the page, where viser is installed'),
    'port': ('8080', 'of the page'),
}


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes for the values of the arguments."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    name, namespace = given['scene'], given['namespace'].strip('/')
    scene, has_frames = load_scene(name), FRAMES in get_packages_with_prefixes()
    simulated = {'use_sim_time': True}
    own: dict[str, dict[str, Any]] = {
        'sim': {
            'publish_robot_description': not has_frames,
            'real_time_factor': float(given['real_time_factor']),
        },
        'control' if scene.controller.name not in ('', GAIT) else 'gait': simulated,
    }
    if scene.follow and 'gait' in own and not scene.controller:
        own['follow'] = simulated
    if given['viewer'] == 'true' and find_spec('viser'):
        own['viewer'] = {'port': int(given['port'])}
    files = [given['parameters']] if given['parameters'] else []
    started = [
        Node(
            package='snake_sim_ros',
            executable=executable,
            namespace=namespace,
            parameters=[{'scene': name, **parameters}, *files],
            output='screen',
        )
        for executable, parameters in own.items()
    ]
    if has_frames:
        parameters = {
            'robot_description': robot_description(scene.robot),
            'frame_prefix': f'{namespace}/'.lstrip('/'),
            **simulated,
        }
        started.append(
            Node(package=FRAMES, executable=FRAMES, namespace=namespace, parameters=[parameters])
        )
    return started


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` starts."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=description)
        for name, (value, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
