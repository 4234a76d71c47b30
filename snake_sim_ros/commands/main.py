# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command `snake-sim`: scenes without ROS, and the live demonstration."""

import argparse
from importlib import import_module
import signal
import sys

from snake_sim_ros.scene import __version__
from snake_sim_ros.scene.checked_records import ParameterError

# In the order of the help text: the module of each command, which has its function `add_...`, and
# what the command does.
COMMANDS = {
    'run': ('scenes', 'run a scene and record it'),
    'study': ('study', 'run a scene with many values on all cores'),
    'optimize': ('optimize', 'find values of a scene that optimize an expression of metrics'),
    'fit': ('fit', 'find friction and gains from a recorded motion'),
    'export': ('recordings', 'convert a recorded run to other formats'),
    'record': ('recordings', 'record all topics of a live robot as a bag'),
    'view': ('recordings', 'show a robot in the browser: live, in a scene, or recorded'),
    'score': ('recordings', 'measure how well a robot followed a path, in a scene or recorded'),
    'plot': ('recordings', 'plot path, joint angles, torques and contact forces of a run'),
    'urdf': ('scenes', 'print the robot of a scene as a URDF'),
    'sdf': ('scenes', 'write the world of a scene as an SDF file'),
    'demo': ('scenes', 'run a scene live: the nodes sim and gait over ROS 2'),
    'topic': ('graph', 'list, show, time and publish topics, as ros2 topic does'),
    'param': ('graph', 'list, get, set and describe parameters, as ros2 param'),
    'service': ('graph', 'list and call services, as ros2 service does'),
}


def main(args: list[str] | None = None) -> int:
    """
    Run the command.

    Returns
    -------
    int
        0; 1 if a run diverged or a node died; 2 if the input is not usable; 130 after Ctrl-C.

    """
    heed_ctrl_c()
    try:
        options = _parser(sys.argv[1:] if args is None else args).parse_args(args)
        return int(options.command(options))
    except (ParameterError, OSError) as error:
        print(f'snake-sim: {error}', file=sys.stderr)
        return 2
    except MemoryError as error:
        print(f'snake-sim: not enough memory: {error}'.removesuffix(': '), file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _parser(args: list[str]) -> argparse.ArgumentParser:
    """Return the parser of the command in the arguments, or of all if there is none."""
    parser = argparse.ArgumentParser(prog='snake-sim', description=__doc__)
    parser.add_argument('--version', action='version', version=__version__)
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND')
    # A command does not wait for the imports of the others, above all the compiler; the list of
    # all commands waits for none.
    chosen = [name for name in args if name in COMMANDS][:1]
    for name in chosen:
        module = import_module(f'snake_sim_ros.commands.{COMMANDS[name][0]}')
        getattr(module, f'add_{name}')(subparsers)
    for name, (_, summary) in () if chosen else COMMANDS.items():
        subparsers.add_parser(name, help=summary)
    return parser


def heed_ctrl_c() -> None:
    """Let SIGINT end the command even if a script started it with ``&``, which ignores SIGINT."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
