# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The nodes as programs, ``python3 -m snake_sim_ros.nodes sim``.

A signal ends a program cleanly from its first moment on.
"""

from importlib import import_module
import os
import resource
import sys

from snake_sim_ros.nodes.programs import missing_ros, on_signals

# MB of addresses with which the nodes start; with 1000, 300 and 600 they abort, or wait.
NEEDED = {'sim': 1500, 'gait': 600, 'control': 600, 'follow': 600, 'viewer': 1000}


def sim() -> int:
    """Run the simulated robot."""
    return _run('sim')


def gait() -> int:
    """Run the node that commands a robot."""
    return _run('gait')


def control() -> int:
    """Run the node that moves a robot by a controller."""
    return _run('control')


def follow() -> int:
    """Run the node that leads a robot along a path."""
    return _run('follow')


def viewer() -> int:
    """Run the node that shows a robot in a browser."""
    return _run('viewer')


def _run(name: str) -> int:
    # The imports of a node take a second or two. Until they are done there is nothing to clean up.
    on_signals(lambda number, frame: os._exit(0))
    sys.argv[0] = name
    limit = resource.getrlimit(resource.RLIMIT_AS)[0]
    if 0 <= limit < NEEDED[name] * 10**6:
        print(
            f'error: {name} needs {NEEDED[name]} MB of memory addresses, and the limit '
            f'(ulimit -v) is {limit / 1e6:.0f} MB',
            file=sys.stderr,
        )
        return 2
    try:
        node = import_module(f'snake_sim_ros.nodes.{name}_node')
    except ImportError as error:
        package = (error.name or '').partition('.')[0]
        of_ros = package == 'rclpy' or package.endswith(('_msgs', '_srvs', '_interfaces'))
        why = missing_ros(name, name, error) if of_ros else error
        print(f'error: {why}', file=sys.stderr)
        return 2
    return int(node.main())


if __name__ == '__main__':
    sys.exit(_run(sys.argv.pop(1)))
