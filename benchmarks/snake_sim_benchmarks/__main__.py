# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The command line: ``python3 -m snake_sim_benchmarks bench``, or ``./run bench``."""

import argparse
import sys

from snake_sim_benchmarks import commands
from snake_sim_ros import ParameterError
from snake_sim_ros.commands.main import heed_ctrl_c

SUMMARY = 'Measurements of the simulator, comparisons with others, and attacks.'
# In the order of the help text.
COMMANDS = {
    'bench': 'measure errors, times and costs of all methods, into a CSV file',
    'artefacts': 'measure artefacts of methods without set-valued laws, into a CSV file',
    'stability': 'map where methods converge, fail or blow up, into a CSV file',
    'limits': 'check in random scenes that all methods have one limit, into a CSV file',
    'chart': 'draw figures and tables from these CSV files',
    'levels': 'print the model level chosen for each scene, its step time and its error',
    'figures': "reproduce the paper's figures",
    'published': 'measure published results on gaits and controllers again: pass or fail',
    'pacing': 'measure jitter, latency and processor load of the node sim over ROS 2',
    'fuzz': 'attack file readers, nodes and physics with random input, into a CSV file',
    'soak': 'try very long runs, slowest steps, killed nodes, full disks, into a CSV file',
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
    parser = argparse.ArgumentParser(prog='./run', description=SUMMARY)
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND')
    chosen = [name for name in args if name in COMMANDS][:1]
    for name in chosen:
        getattr(commands, f'add_{name}')(subparsers)
    for name, summary in () if chosen else COMMANDS.items():
        subparsers.add_parser(name, help=summary)
    return parser


if __name__ == '__main__':
    sys.exit(main())
