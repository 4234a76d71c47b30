# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Checkpoints: a simulation saved to a file, from which it resumes with identical bits.

A checkpoint is the scene, the state, and the history with the memory of the method. Every array
has its dotted name in the file, such as ``history.memory.start.pose``.
"""

from collections.abc import Mapping, Sequence
import math
from pathlib import Path
from typing import Any

import numpy as np

from snake_sim_ros.dynamics.joint_control import make_control_loop
from snake_sim_ros.recording.recorded_runs import (
    format_of,
    load_arrays,
    report_from_text,
    report_to_text,
)
from snake_sim_ros.scene.checked_records import cut, LONGEST_REASON, ParameterError
from snake_sim_ros.scene.files import whole_file
from snake_sim_ros.scene.parameters import Array, Scene, scene_from_text, scene_to_text
from snake_sim_ros.stepping.bdf2.formula import ANEW, SMOOTH, TICKS, UNKNOWN
from snake_sim_ros.stepping.simulation import Simulation
from snake_sim_ros.stepping.state import check_history, named_arrays, State, with_arrays

FORMAT = 1
LONGEST_REST = 2**53  # steps for which a robot may yet have to lie still


def write(simulation: Simulation, path: Path) -> None:
    """
    Write all that a simulation needs to resume.

    Raises
    ------
    ParameterError
        If its stepper was made by the caller, which a file cannot describe.

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
    with whole_file(path) as part, part.open('wb') as file:
        np.savez_compressed(file, **data)


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
    except Exception as error:  # parsers raise anything on broken text
        raise ParameterError(
            f'{path} is not a whole checkpoint: {cut(str(error), LONGEST_REASON)}'
        ) from None


def _simulation(data: dict[str, Array]) -> Simulation:
    def text(name: str) -> Any:
        return data[name].tolist()

    simulation = Simulation(scene_from_text(text('scene')))
    empty = simulation.stepper.empty_history()
    history = with_arrays(empty, {name: data[name] for name in named_arrays(empty)})
    state = State(data['state.q'], data['state.u'])
    check_history(simulation.scene.robot.link_count, empty, state, history)
    _check_counters(simulation.scene, named_arrays(history))
    step_count = text('step_count')
    if type(step_count) is not int or step_count < 0:
        raise ParameterError(f'step_count must be a whole number, at least 0, got {step_count}')
    simulation.state, simulation.history, simulation.step_count = state, history, step_count
    report, axes = report_from_text(text('report')), (simulation.scene.robot.link_count - 1, 2)
    if report.joint_torque.shape != axes:
        raise ParameterError(
            f'joint_torque of the report must have shape {axes}, got {report.joint_torque.shape}'
        )
    simulation.report = report
    return simulation


def _check_counters(scene: Scene, arrays: Mapping[str, Array]) -> None:
    """Check the numbers by which compiled code finds its place, in a history by their names."""
    loop = make_control_loop(scene)
    largest: dict[str, Sequence[float]] = {
        'history.settling': [LONGEST_REST],
        'history.control.next': [loop.delay],
        'history.control.wait': [max(loop.period - 1, 0), max(loop.hold - 1, 0)],
        'history.memory.phase': [max(UNKNOWN, ANEW, SMOOTH)],
        'history.memory.ticks': [TICKS],
    }
    for name in largest.keys() & arrays.keys():
        for number, most in zip(arrays[name].tolist(), largest[name], strict=True):
            if not (number.is_integer() and 0 <= number <= most):
                raise ParameterError(f'{name} cannot be {number:g} in this scene')
    ticks = arrays.get('history.memory.ticks')
    if ticks is not None and ticks > 0 and not math.log2(ticks.item()).is_integer():
        raise ParameterError(f'history.memory.ticks must be a power of 2, got {ticks.item():g}')
    if arrays.get('history.memory.phase') == SMOOTH and not arrays['history.memory.dt'] > 0.0:
        raise ParameterError('history.memory.dt must be above 0 s after a step')
