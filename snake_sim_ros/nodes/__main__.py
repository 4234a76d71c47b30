"""The nodes as programs, ``python3 -m snake_sim_ros.nodes sim``: signals end them well at once."""

from importlib import import_module
import os
import signal
import sys


def sim() -> int:
    """Run the simulated robot."""
    return _run('sim')


def gait() -> int:
    """Run the node that commands it."""
    return _run('gait')


def viewer() -> int:
    """Run the node that shows the robot in a browser."""
    return _run('viewer')


def _run(name: str) -> int:
    # To import what a node needs takes a second or two, and there is nothing to put away.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, frame: os._exit(0))
    sys.argv[0] = name
    return int(import_module(f'snake_sim_ros.nodes.{name}_node').main())


if __name__ == '__main__':
    sys.exit(_run(sys.argv.pop(1)))
