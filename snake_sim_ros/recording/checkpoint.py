"""
Checkpoints: a simulation in a file, from which it goes on to the bit.

A checkpoint is the scene, the state, and the history with the memory of the method. Every array
has its dotted name in the file, such as ``history.memory.start.pose``.
"""

from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from snake_sim_ros.recording.npz import format_of
from snake_sim_ros.recording.npz import load_arrays
from snake_sim_ros.recording.npz import report_from_text
from snake_sim_ros.recording.npz import report_to_text
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import scene_from_text
from snake_sim_ros.scene.parameters import scene_to_text
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import check_history
from snake_sim_ros.stepping.state import named_arrays
from snake_sim_ros.stepping.state import State
from snake_sim_ros.stepping.state import with_arrays

FORMAT = 1


def write(simulation: Simulation, path: Path) -> None:
    """
    Write all that a simulation needs to go on.

    Raises
    ------
    ParameterError
        If its stepper was made by the caller: a file cannot say how.

    """
    if simulation.given:
        raise ParameterError(
            f'a checkpoint names the method of its scene, and this simulation has a '
            f'{type(simulation.stepper).__name__} made by the caller'
        )
    data: dict[str, Any] = {
        'checkpoint': FORMAT,
        'scene': scene_to_text(simulation.scene),
        'step_count': simulation.step_count,
        'report': report_to_text(simulation.report),
        'state.q': simulation.state.q,
        'state.u': simulation.state.u,
        **named_arrays(simulation.history),
    }
    buffer = BytesIO()
    np.savez_compressed(buffer, **data)
    path.write_bytes(buffer.getvalue())


def read(path: Path) -> Simulation:
    """
    Return the simulation that `write` wrote; its next step is the one after the last.

    Raises
    ------
    ParameterError
        If the file is not whole or not a checkpoint, is of another version, or if what it holds is
        not what its scene needs.

    """
    data = load_arrays(path, 'checkpoint.write writes one')
    if 'checkpoint' not in data:
        raise ParameterError(f'{path} is not a checkpoint')
    version = format_of({'format': data['checkpoint']})
    if version != FORMAT:
        raise ParameterError(
            f'{path} is a checkpoint in format {version}, of another version of snake_sim_ros; '
            f'this one reads format {FORMAT}'
        )
    try:
        return _simulation(data)
    except KeyError as error:
        raise ParameterError(f'{path} is not a whole checkpoint: it has no {error}') from None
    except Exception as error:  # broken text makes parsers raise whatever they like
        raise ParameterError(f'{path} is not a whole checkpoint: {error}') from None


def _simulation(data: dict[str, Array]) -> Simulation:
    def text(name: str) -> Any:
        return data[name].tolist()

    simulation = Simulation(scene_from_text(text('scene')))
    empty = simulation.stepper.empty_history()
    history = with_arrays(empty, {name: data[name] for name in named_arrays(empty)})
    state = State(data['state.q'], data['state.u'])
    check_history(simulation.scene.robot.link_count, empty, state, history)
    step_count = text('step_count')
    if type(step_count) is not int or step_count < 0:
        raise ParameterError(f'step_count must be a whole number from 0 on, got {step_count}')
    simulation.state, simulation.history, simulation.step_count = state, history, step_count
    simulation.report = simulation.last = report_from_text(text('report'))
    return simulation
