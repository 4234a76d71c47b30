# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim pacing`: how the node `sim` keeps time, and what that costs."""

import argparse
from typing import Any

from snake_sim_ros.nodes.programs import missing_ros

RATES = (50.0, 100.0, 200.0, 500.0)  # publish rates [Hz]


def add_pacing(subparsers: Any) -> None:
    """Add the command."""
    command = subparsers.add_parser('pacing')
    command.set_defaults(command=_pacing)
    command.add_argument('--duration', type=float, default=5.0, help='of each part [s], default 5')
    command.add_argument(
        '--rates', nargs='*', type=float, default=RATES, metavar='HZ',
        help='publish rates at which it runs as fast as possible, default 50 100 200 500',
    )  # fmt: skip


def _pacing(options: argparse.Namespace) -> int:
    try:
        from snake_sim_benchmarks.pacing import pacing
    except ImportError as error:
        raise missing_ros('pacing', 'pacing', error) from None
    return pacing(options.duration, options.rates)
