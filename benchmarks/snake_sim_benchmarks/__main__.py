# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command line: ``python3 -m snake_sim_benchmarks bench``, or ``./run bench``."""

import argparse
from importlib import import_module
import sys

from snake_sim_ros.commands.main import heed_ctrl_c
from snake_sim_ros.scene.checked_records import ParameterError

# In the order of the help text: the module of each command, where its function `add_...` is, and
# what it does.
COMMANDS = {
    'bench': ('bench', 'measure error, time and much else of all methods: a CSV file'),
    'artefacts': ('artefacts', 'measure what methods without set-valued laws make up: a CSV file'),
    'stability': ('stability', 'map where methods converge, fail or blow up: a CSV file'),
    'limits': ('limits', 'whether all methods have one limit in random scenes: a CSV file'),
    'chart': ('chart', 'draw what the others measured'),
    'levels': ('levels', 'show the model level that each scene gets, its time and its error'),
    'figures': ('figures', "draw the paper's figures anew"),
    'pacing': ('pacing', 'measure how the node sim keeps time over ROS 2, and what that costs'),
    'fuzz': ('attacks', 'attack files, nodes and physics with random input: a CSV file'),
    'soak': ('attacks', 'very long runs, slowest steps, killed nodes and full disks: a CSV file'),
}


def main(args: list[str] | None = None) -> int:
    """
    Run the command.

    Returns
    -------
    int
        0; 1 if a promise was broken or a node died; 2 if the input is not usable; 130 after
        Ctrl-C.

    """
    heed_ctrl_c()
    try:
        options = _parser(sys.argv[1:] if args is None else args).parse_args(args)
        return int(options.command(options))
    except (ParameterError, OSError) as error:
        print(f'run: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _parser(args: list[str]) -> argparse.ArgumentParser:
    """Return the parser of the command in the arguments, or of all if there is none."""
    parser = argparse.ArgumentParser(prog='./run', description=__doc__)
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND')
    # A command does not wait for the imports of the others.
    chosen = [name for name in args if name in COMMANDS][:1]
    for name in chosen:
        module = import_module(f'snake_sim_benchmarks.commands.{COMMANDS[name][0]}')
        getattr(module, f'add_{name}')(subparsers)
    for name, (_, summary) in () if chosen else COMMANDS.items():
        subparsers.add_parser(name, help=summary)
    return parser


if __name__ == '__main__':
    sys.exit(main())
