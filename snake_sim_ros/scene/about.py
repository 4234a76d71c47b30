# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What every room may know of the package: its version and where it is installed."""

from pathlib import Path

__version__ = '1.0.0'
PACKAGE = Path(__file__).resolve().parent.parent  # folder of the sources
