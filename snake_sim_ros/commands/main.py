"""The command `snake-sim`: scenes without ROS, measurements, and the live demonstration."""

import argparse
import signal
import sys

from snake_sim_ros import __version__
from snake_sim_ros.commands.artefacts import add_artefacts
from snake_sim_ros.commands.bench import add_bench
from snake_sim_ros.commands.chart import add_chart
from snake_sim_ros.commands.demo import add_demo
from snake_sim_ros.commands.export import add_export
from snake_sim_ros.commands.figures import add_figures
from snake_sim_ros.commands.graph import add_param
from snake_sim_ros.commands.graph import add_service
from snake_sim_ros.commands.graph import add_topic
from snake_sim_ros.commands.levels import add_levels
from snake_sim_ros.commands.pacing import add_pacing
from snake_sim_ros.commands.record import add_record
from snake_sim_ros.commands.run import add_run
from snake_sim_ros.commands.seal import add_seal
from snake_sim_ros.commands.stability import add_stability
from snake_sim_ros.commands.urdf import add_urdf
from snake_sim_ros.commands.view import add_view
from snake_sim_ros.scene.checked_records import ParameterError

# In the order of the help text.
COMMANDS = (
    *(add_run, add_export, add_record, add_view),
    *(add_figures, add_bench, add_artefacts, add_stability, add_chart, add_seal),
    *(add_levels, add_urdf, add_demo, add_pacing),
    *(add_topic, add_param, add_service),
)


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
        options = _parser().parse_args(args)
        return int(options.command(options))
    except (ParameterError, OSError) as error:
        print(f'snake-sim: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='snake-sim', description=__doc__)
    parser.add_argument('--version', action='version', version=__version__)
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND')
    for add_command in COMMANDS:
        add_command(subparsers)
    return parser


def heed_ctrl_c() -> None:
    """Let SIGINT end the command also where a script started it with ``&``, which ignores it."""
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
