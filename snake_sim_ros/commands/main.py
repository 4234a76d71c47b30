"""The command `snake-sim`: scenes without ROS, measurements, and the live demonstration."""

import argparse
from importlib import import_module
import signal
import sys

from snake_sim_ros import __version__
from snake_sim_ros.scene.checked_records import ParameterError

# In the order of the help text: the module of each command, where its function `add_...` is.
COMMANDS = {
    **{name: name for name in ('run', 'study', 'optimize', 'fit', 'export')},
    **{name: name for name in ('record', 'view', 'plot', 'figures')},
    **{name: name for name in ('bench', 'artefacts', 'stability', 'chart', 'seal', 'levels')},
    **{name: name for name in ('urdf', 'demo', 'pacing')},
    **dict.fromkeys(('fuzz', 'soak'), 'attacks'),
    **dict.fromkeys(('topic', 'param', 'service'), 'graph'),
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
    except KeyboardInterrupt:
        return 130


def _parser(args: list[str]) -> argparse.ArgumentParser:
    """Return the parser of the command in the arguments, or of all if there is none."""
    parser = argparse.ArgumentParser(prog='snake-sim', description=__doc__)
    parser.add_argument('--version', action='version', version=__version__)
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND')
    # A command does not wait for the imports of the others, the compiler above all.
    for name in [name for name in args[:1] if name in COMMANDS] or COMMANDS:
        module = import_module(f'snake_sim_ros.commands.{COMMANDS[name]}')
        getattr(module, f'add_{name}')(subparsers)
    return parser


def heed_ctrl_c() -> None:
    """Let SIGINT end the command also where a script started it with ``&``, which ignores it."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
