# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The option that chooses one of several robots in a bag."""

import argparse


def add_namespace(command: argparse.ArgumentParser) -> None:
    """Add the option."""
    command.add_argument(
        '--namespace', metavar='NAME', help='of the robot, where a bag has several'
    )
