# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parameters of the node `sim` besides those of its scene, and which of all may change."""

from array import array
from collections.abc import Container, Iterable
from dataclasses import dataclass, replace
from typing import Any

from rclpy.parameter import Parameter

from snake_sim_ros.recording.sensors import link_index, Sensors
from snake_sim_ros.scene.checked_records import flat_fields, quantity
from snake_sim_ros.scene.parameters import Robot, Scene, steps_in, with_settings
from snake_sim_ros.scene.urdf_ros2_control import check_interfaces
from snake_sim_ros.stepping.accuracy import with_accuracy

CHANGEABLE = (
    *('real_time_factor', 'iteration_budget', 'command_horizon', 'command_timeout'),
    *('friction.longitudinal', 'friction.transversal', 'friction.rolling', 'pegs.friction'),
    *('robot.yaw_stiffness', 'robot.yaw_damping', 'robot.pitch_stiffness', 'robot.pitch_damping'),
    *('self_contact_friction', 'gravity', 'push_link', 'push_duration'),
)
STOPS = ('robot.joint_stop', 'robot.rate_stop')


@dataclass(frozen=True, kw_only=True)
class Settings(Sensors):
    """Parameters of the node besides those of the scene: those of its sensors, and its own."""

    scene: str = quantity(
        'lateral_undulation', '', 'scene: a YAML file or the name of one in config/'
    )
    robot_description: str = quantity(
        '', '', 'robot in place of that of the scene: a URDF, or the name of its file',
        longest=10**6,
    )  # fmt: skip
    publish_rate: float = quantity(
        200.0, 'Hz', 'state messages per second of simulated time', minimum=10, maximum=1000
    )
    real_time_factor: float = quantity(
        1.0, '1', 'simulated time per wall time; 0 = as fast as possible', minimum=0, maximum=1000
    )
    iteration_budget: int = quantity(
        0,
        '1',
        'contact iterations shared by the steps of a publish period; 0 = unlimited',
        minimum=0,
        maximum=10**12,
    )
    command_horizon: float = quantity(
        0.05,
        's',
        'time for which a command is extrapolated with its velocity',
        minimum=0,
        maximum=1,
    )
    command_timeout: float = quantity(
        0.5,
        's',
        'silence after which a stream of commands is reported as stopped; 0 = never',
        minimum=0,
    )
    publish_clock: bool = quantity(True, '', 'publish /clock; only one node in a graph should')
    publish_robot_description: bool = quantity(True, '', 'publish robot_description')
    ros2_control: str = quantity(
        '', '', 'command interfaces of a <ros2_control> element in robot_description; empty = none'
    )
    publish_tf: bool = quantity(True, '', 'publish /tf and /tf_static where tf2_msgs is installed')
    frame_prefix: str = quantity(
        'auto', '', 'prefix of the frames odom and base_link; auto = namespace and a slash'
    )
    start_paused: bool = quantity(False, '', 'start paused, until ~/pause or ~/step is called')
    push_link: str | int = quantity(
        '', '', 'link pushed by ~/push in frame world: name or number from 1; empty = middle'
    )
    push_duration: float = quantity(
        0.1, 's', 'duration of a push by a message on ~/push, in simulated time', above=0
    )

    def pushed_link(self, robot: Robot) -> int:
        """Return the index of the link that is pushed in frame world; raise if there is none."""
        if self.push_link == '':
            return robot.middle_link
        return link_index(self.push_link, robot, 'push_link')

    def check(self, scene: Scene) -> None:
        """Raise ParameterError if the node cannot run a scene with these settings."""
        self.pushed_link(scene.robot)
        steps_in(1.0 / self.publish_rate, scene.dt, 'publish period')
        if self.ros2_control:
            check_interfaces(self.ros2_control.split(), scene.robot)


def as_it_runs(settings: Settings, scene: Scene, given: Container[str]) -> Scene:
    """
    Return the scene with stops of its joints, and with the steps that its accuracy asks for.

    The stops hold joints within their limits, whatever is commanded. They act only there.

    Parameters
    ----------
    settings : Settings
    scene : Scene
    given : container of str
        Names of parameters that the user set. They stay.

    """
    scene = with_settings(scene, {name: True for name in STOPS if name not in given})
    if scene.accuracy == 0.0:
        return scene
    return with_accuracy(scene, scene.accuracy, 1.0 / settings.publish_rate, given)


def changed(
    settings: Settings, scene: Scene, parameters: Iterable[Parameter]
) -> tuple[Settings, Scene]:
    """
    Return settings and scene with the values of some parameters; others are not looked at.

    Raises
    ------
    ParameterError
        If a value is not usable.

    """
    given = {
        item.name: item.value.tolist() if isinstance(item.value, array) else item.value
        for item in parameters
        if item.name in CHANGEABLE
    }
    own: dict[str, Any] = {n: given.pop(n) for n in flat_fields(settings) if n in given}
    settings = replace(settings, **own)
    scene = with_settings(scene, given)
    settings.check(scene)
    return settings, scene
