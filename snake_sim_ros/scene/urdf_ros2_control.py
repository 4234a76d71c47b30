# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The element ``<ros2_control>`` of a URDF, with which a controller manager finds the simulation.

Its hardware is the plugin JointStateTopicSystem of joint_state_topic_hardware_interface, which
sends a JointState with commands and reads one with states.
"""

from collections.abc import Sequence
from xml.etree import ElementTree

from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.parameters import Robot

PLUGIN = 'joint_state_topic_hardware_interface/JointStateTopicSystem'
INTERFACES = ('position', 'velocity', 'effort')
COMMANDS, STATES = 'sim/joint_command', 'sim/joint_states'  # as ros2_control.launch.py has them
# Below it the plugin sends nothing: at 1e-5, its default, a simulation could not tell a robot that
# has arrived from a controller manager that is gone.
ALWAYS = -1


def with_ros2_control(
    description: str,
    robot: Robot,
    interfaces: Sequence[str] = ('position',),
    *,
    commands: str = f'/{COMMANDS}',
    states: str = f'/{STATES}',
) -> str:
    """
    Return a URDF with an element ``<ros2_control>`` for all joint axes.

    Parameters
    ----------
    description : str
        The URDF.
    robot : Robot
    interfaces : sequence of str, optional
        Command interfaces: position, velocity, effort. All three are state interfaces.
    commands, states : str, optional
        Topics of commands and states.

    Raises
    ------
    ParameterError
        If the robot does not have one of the interfaces.

    """
    check_interfaces(interfaces, robot)
    root = ElementTree.fromstring(description)
    system = ElementTree.SubElement(root, 'ros2_control', name=root.get('name', ''), type='system')
    hardware = ElementTree.SubElement(system, 'hardware')
    ElementTree.SubElement(hardware, 'plugin').text = PLUGIN
    for name, value in (
        ('joint_commands_topic', commands),
        ('joint_states_topic', states),
        ('trigger_joint_command_threshold', str(ALWAYS)),
    ):
        ElementTree.SubElement(hardware, 'param', name=name).text = value
    for axis in robot.axis_names:
        joint = ElementTree.SubElement(system, 'joint', name=axis)
        for interface in interfaces:
            ElementTree.SubElement(joint, 'command_interface', name=interface)
        for interface in INTERFACES:
            ElementTree.SubElement(joint, 'state_interface', name=interface)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding='unicode')


def check_interfaces(interfaces: Sequence[str], robot: Robot) -> None:
    """Raise an error if a robot does not have some command interfaces."""
    for name in interfaces:
        if name not in INTERFACES:
            raise ParameterError(
                f'command interfaces are {", ".join(INTERFACES)}, got {quoted(name)}'
            )
    if len(set(interfaces)) < len(interfaces) or not interfaces:
        raise ParameterError(
            f'command interfaces must be some of {", ".join(INTERFACES)}, each once, got '
            f'{quoted(" ".join(interfaces))}'
        )
    if 'effort' in interfaces and not robot.effort_commands:
        raise ParameterError(
            'the command interface effort needs a robot that takes torques: '
            'robot.effort_commands is false'
        )
