# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Start a simulated robot whose joints the controllers of ros2_control move.

``ros2 launch snake_sim_ros ros2_control.launch.py scene:=sidewinding``. It needs the packages
controller_manager, joint_state_topic_hardware_interface, ros2_controllers and
robot_state_publisher. `sim` has its joints under the topics `sim/joint_states` and
`sim/joint_command`, since `joint_states` is that of the joint_state_broadcaster.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.robot_description import robot_description
from snake_sim_ros.scene.urdf_ros2_control import COMMANDS, STATES, with_ros2_control

SHARE = Path(get_package_share_directory('snake_sim_ros'))
ARGUMENTS = {  # name -> default value and description
    'scene': ('lateral_undulation', 'a YAML file, or the name of a scene of the package'),
    'interfaces': ('position', 'command interfaces of all joints: position, velocity, effort'),
    'controllers': (str(SHARE / 'config' / 'controllers.yml'), 'parameters of the controllers'),
    'active': ('joint_state_broadcaster joint_trajectory_controller', 'controllers to start'),
    'inactive': ('forward_position_controller', 'controllers to load only'),
    'real_time_factor': ('1.0', 'speed of simulated time'),
    'parameters': ('', 'a YAML file of parameters, such as sensors, which sim reads last'),
}


def nodes(context: LaunchContext) -> list[Node]:
    """Return the nodes for the values of the arguments."""
    given = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    robot = load_scene(given['scene']).robot
    interfaces = given['interfaces'].split()
    description = with_ros2_control(robot_description(robot), robot, interfaces)
    described = {'robot_description': description, 'use_sim_time': True}
    own = {
        'scene': given['scene'],
        'real_time_factor': float(given['real_time_factor']),
        'publish_robot_description': False,
    }
    files = [given['parameters']] if given['parameters'] else []
    started = [
        Node(
            package='snake_sim_ros',
            executable='sim',
            parameters=[own, *files],
            remappings=[('joint_states', STATES), ('joint_command', COMMANDS)],
            output='screen',
        ),
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            parameters=[described],
        ),
        Node(
            package='controller_manager',
            executable='ros2_control_node',
            parameters=[described, given['controllers']],
            output='screen',
        ),
    ]
    for names, options in ((given['active'], []), (given['inactive'], ['--inactive'])):
        if names:
            arguments = [*names.split(), '--param-file', given['controllers'], *options]
            started.append(
                Node(package='controller_manager', executable='spawner', arguments=arguments)
            )
    return started


def generate_launch_description() -> LaunchDescription:
    """Return what `ros2 launch` starts."""
    declared = [
        DeclareLaunchArgument(name, default_value=value, description=description)
        for name, (value, description) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
