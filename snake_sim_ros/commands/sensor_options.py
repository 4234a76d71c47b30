# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Arguments that choose the sensors of a run, and the sensors they mean."""

import argparse

from snake_sim_ros.commands.scene_options import given_values
from snake_sim_ros.recording.sensors import Sensors
from snake_sim_ros.scene.checked_records import from_mapping, ParameterError
from snake_sim_ros.scene.files import parse_yaml

OF_LINKS = {'imu': 'imu_links', 'contact_forces': 'contact_force_links'}


def add_sensors(command: argparse.ArgumentParser) -> None:
    """Add the options that choose sensors and how well they measure."""
    for name, what in (('imu', 'with an IMU'), ('contact-forces', 'whose contacts are measured')):
        command.add_argument(
            f'--{name}', action='append', default=[], metavar='LINK',
            help=f'link {what}: link_6, 6 or all; may be given often',
        )  # fmt: skip
    command.add_argument(
        '--sensor', action='append', default=[], metavar='KEY=VALUE',
        help='noise, bias, rate or seed, named as the parameters of sim, such as '
        'imu_acceleration_noise=0.02; may be given often',
    )  # fmt: skip


def sensors_of(options: argparse.Namespace, count: int, rate: float) -> Sensors:
    """
    Return the sensors that the options of `add_sensors` choose.

    Parameters
    ----------
    options : Namespace
    count : int
        Number of links of the robot.
    rate : float
        States a second [Hz].

    Raises
    ------
    ParameterError
        If a value is not usable.

    """
    values = given_values(options.sensor, '--sensor')
    for option, name in OF_LINKS.items():
        if links := [parse_yaml(link) for link in getattr(options, option)]:
            if name in values:
                flag = option.replace('_', '-')
                raise ParameterError(f'links are given twice, by --{flag} and by --sensor {name}')
            values[name] = 'all' if 'all' in links else links
    sensors: Sensors = from_mapping(Sensors, values, '--sensor')
    for name in OF_LINKS.values():
        sensors.links(name, count)
    sensors.states_in_sample(rate)
    return sensors
