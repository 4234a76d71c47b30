# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The state of the simulation as a message for /diagnostics (REP 107)."""

import re

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
import numpy as np

from snake_sim_ros.stepping.methods import method_of
from snake_sim_ros.stepping.simulation import Simulation

SLOW = re.compile(r'real-time factor \S+ of ([^\s;]+)(?:; )?')  # the warning that time slips


def values_of(simulation: Simulation) -> dict[str, object]:
    """Return name -> value of what a simulation reports of its steps."""
    report, last = simulation.report, simulation.last
    return {
        'level': last.level,
        'planar_steps': report.planar_steps,
        'method': method_of(simulation.scene),
        'steps': report.steps,
        'residual': f'{last.residual_max:.3g}',
        'residual_max': f'{report.residual_max:.3g}',
        'printed_residual_max': f'{report.printed_residual_max:.3g}',
        'fallbacks': report.fallbacks,
        'iterations_per_step': f'{report.iterations / max(report.steps, 1):.3g}',
        'iterations_max': report.iterations_max,
        'unconverged_steps': report.unconverged,
        'penetration_max': f'{report.penetration_max:.3g}',
        'contacts': last.contacts,
        'saturated_joints': saturated_joints(simulation),
    }


def saturated_joints(simulation: Simulation) -> int:
    """Return how many joint axes are at their torque limit after the last step."""
    limit = simulation.scene.robot.per_joint('torque_limit')
    return int((np.abs(simulation.last.joint_torque) >= limit * (1.0 - 1e-9)).sum())


def shown(status: DiagnosticStatus) -> dict[str, str]:
    """
    Return name -> text that the viewer shows of a status; any node may have made it.

    The warning of a real-time factor changes all the time: its numbers have a row of their own,
    and the other rows stay as they are.
    """
    values = {item.key: item.value for item in status.values}
    factor = values.get('real_time_factor', '-')
    try:
        factor = f'{float(factor):.2f}'
    except ValueError:  # It is a word, or missing.
        pass
    state = status.message
    if slow := SLOW.search(state):
        factor = f'{factor} of {slow[1]}'
        state = state.replace(slow[0], '') or 'running slowly'
    return {
        'level': values.get('level', '-'),
        'real-time factor': factor,
        'sim': state,
    }


def is_paused(status: DiagnosticStatus) -> bool:
    """Return whether a status is that of a paused simulation."""
    return any((item.key, item.value) == ('state', 'paused') for item in status.values)


def status_of(
    name: str, failure: str, warning: str, state: str, values: dict[str, object]
) -> DiagnosticStatus:
    """
    Return a status: an error if there is a failure, else a warning if there is one.

    Parameters
    ----------
    name : str
        Name of the node.
    failure, warning : str
        One sentence each; empty if there is none.
    state : str
        The message if there is neither.
    values : dict
        Name -> value, as `values_of` returns them.

    """
    level, values = DiagnosticStatus.OK, {'state': state, **values}
    if warning:
        level = DiagnosticStatus.WARN
    if failure:
        level = DiagnosticStatus.ERROR
    return DiagnosticStatus(
        level=level,
        name=f'{name}: physics',
        hardware_id='simulated',
        message=failure or warning or state,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
