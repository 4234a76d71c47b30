# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim urdf`: the robot of a scene as a URDF."""

import argparse
from typing import Any

from snake_sim_ros.commands.scene_options import (
    add_scene_options,
    add_scene_or_default,
    scene_from,
)
from snake_sim_ros.scene.robot_description import robot_description


def add_urdf(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('urdf')
    command.set_defaults(command=_urdf)
    add_scene_or_default(command)
    add_scene_options(command)


def _urdf(options: argparse.Namespace) -> int:
    print(robot_description(scene_from(options, options.scene).robot))
    return 0
