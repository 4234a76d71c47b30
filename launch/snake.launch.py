# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Start a simulated robot with its gait, its frames and its page in the browser.

``ros2 launch snake_sim_ros snake.launch.py scene:=sidewinding namespace:=aiko``. The frames of the
links need the package robot_state_publisher, the page needs viser; what is missing is left out.
"""

from importlib.util import find_spec

from ament_index_python.packages import get_packages_with_prefixes
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.robot_description import robot_description

FRAMES = 'robot_state_publisher'


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes for the values of the arguments."""
    scene = LaunchConfiguration('scene').perform(context)
    namespace = LaunchConfiguration('namespace').perform(context).strip('/')
    has_frames = FRAMES in get_packages_with_prefixes()
    simulated = {'use_sim_time': True}
    own = {
        'sim': {'scene': scene, 'publish_robot_description': not has_frames},
        'gait': {'scene': scene, **simulated},
    }
    if find_spec('viser'):
        own['viewer'] = {'scene': scene}
    started = [
        Node(
            package='snake_sim_ros',
            executable=name,
            namespace=namespace,
            parameters=[parameters],
            output='screen',
        )
        for name, parameters in own.items()
    ]
    if has_frames:
        parameters = {
            'robot_description': robot_description(load_scene(scene).robot),
            'frame_prefix': f'{namespace}/'.lstrip('/'),
            **simulated,
        }
        started.append(
            Node(package=FRAMES, executable=FRAMES, namespace=namespace, parameters=[parameters])
        )
    return started


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` starts."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'scene',
                default_value='lateral_undulation',
                description='a YAML file, or the name of a scene that comes with the package',
            ),
            DeclareLaunchArgument(
                'namespace', default_value='', description='of all nodes and their topics'
            ),
            OpaqueFunction(function=nodes),
        ]
    )
