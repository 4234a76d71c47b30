# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The compiled loop over steps, its report and its samples."""

from typing import Any, NamedTuple, TYPE_CHECKING, TypeAlias

import numpy as np

from snake_sim_ros.contact.problem import Outcome
from snake_sim_ros.dynamics.compilation import (
    cycle_counter,
    Dispatched,
    inlined,
    record_array,
    Table,
)
from snake_sim_ros.dynamics.records import entry
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import divergence, Report
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable
from snake_sim_ros.stepping.samples import row_after
from snake_sim_ros.stepping.state import History

if TYPE_CHECKING:
    from snake_sim_ros.stepping.model import Model, Workspace
    from snake_sim_ros.stepping.planar.model import PlanarModel, PlanarWorkspace


class LoopReport:
    """Fields of `base.Report` that a loop adds up, and the reason why it ended early."""

    steps: int
    iterations: int
    iterations_max: int
    unconverged: int
    fallbacks: int
    residual_max: float  # [m/s]
    printed_residual_max: float  # [m/s]
    penetration_max: float  # [m]
    joint_gap_max: float  # [m]
    joint_twist_max: float  # [1]
    further_parts: int
    contacts: int
    overflows: int
    failed_link: int  # link, from 1, that would turn too far; 0 for none
    failed_turn: float  # the angle by which it would [rad]
    not_planar: int  # whether the next step is not planar


row_at = inlined(row_after)


class Record(NamedTuple):
    """
    What a loop keeps after every so many steps, a row for each sample; see `samples.Samples`.

    Rows of q and u are those of `Steps`.
    """

    every: int  # steps from one sample to the next; 0: nothing is kept
    first: int  # steps up to the first sample
    q: Array  # (m, *q.shape)
    u: Array  # (m, *u.shape)
    torque: Array  # (m, n-1, 2) of the step before a sample [N m]
    impulse: Array  # (m, contacts, 5) of the step before a sample [N s]
    span: Array  # (m,) time for which these acted [s]


class Steps(NamedTuple):
    """
    The steps that a loop takes: their start, the joint references, the report, and samples.

    A loop advances q, u and history in place, by one step for each reference. Compiled functions
    of this package take this record as `steps`, or its q, u and history by these names.
    """

    q: Array  # (n, 7) as in `state.State`; in the plane (n+2,) as in `planar.model.PlanarMemory`
    u: Array  # (n, 6) as in `state.State`; in the plane (n, 3)
    history: History  # of the last step
    angle: Array  # (steps, n-1, 2) joint references at the middle of every step [rad]
    rate: Array  # (steps, n-1, 2) [rad/s]
    report: Table[LoopReport]  # (1,)
    cycles: Array  # (steps+1,) time stamps before and after every step
    record: Record  # samples that the loop keeps
    pushes: PushTable  # forces from outside in these steps


def make_steps(
    state: tuple[Array, Array],
    history: History,
    reference: tuple[Array, Array],
    record: Record,
    pushes: PushTable = NO_PUSHES,
) -> Steps:
    """
    Return the steps for some references: angles and rates.

    They change the state, q and u, and the history in place.
    """
    (q, u), (angle, rate) = state, reference
    report = record_array(1, LoopReport)
    cycles = np.zeros(len(angle) + 1, np.int64)
    angle, rate = np.ascontiguousarray(angle), np.ascontiguousarray(rate)
    return Steps(q, u, history, angle, rate, report, cycles, record, pushes)


Integrator = tuple[object, ...]  # a NamedTuple, whose type chooses the step
AnyModel: TypeAlias = 'Model | PlanarModel'
AnyWorkspace: TypeAlias = 'Workspace | PlanarWorkspace'


@Dispatched
def take_step(  # type: ignore[empty-body]
    integrator: Integrator, model: AnyModel, work: AnyWorkspace, steps: Steps, k: int, shows: bool
) -> tuple[bool, float]:
    """
    Take step k with the integrator that belongs to the type of `integrator`.

    The call is compiled. Every integrator registers a class of its own, which holds its contact
    solver or its arrays. It moves q, u and history, adds step and solutions to the report, and
    fills `work.applied`. If `shows`, q and u are read after the step.

    Returns
    -------
    goes_on : bool
        Whether the loop goes on.
    span : float
        Time for which the impulses of the step acted [s].

    """


@entry
def advance(integrator: Integrator, model: AnyModel, work: AnyWorkspace, steps: Steps) -> None:
    """Take the steps up to the first that the integrator does not take; see `take_step`."""
    report, record, count = steps.report[0], steps.record, len(steps.angle)
    steps.cycles[0] = cycle_counter()
    for k in range(count):
        row = row_at(k, record.every, record.first, len(record.span))
        goes_on, span = take_step(integrator, model, work, steps, k, row >= 0 or k + 1 == count)
        if row >= 0 and report.steps > k:
            keep_sample(row, model.dt, span, work.applied, steps)
        steps.cycles[k + 1] = cycle_counter()
        if not goes_on:
            break


@inlined
def keep_sample(row: int, dt: float, span: float, applied: Array, steps: Steps) -> None:
    """Fill a row of the record after a step of dt [s]; its impulses acted for a span [s]."""
    record, history = steps.record, steps.history
    copy_numbers(steps.q, record.q[row])
    copy_numbers(steps.u, record.u[row])
    copy_numbers(history.impulse, record.impulse[row])
    for j in range(len(applied)):
        for k in range(2):
            record.torque[row, j, k] = applied[j, k] / dt
    record.span[row] = span


@inlined
def copy_numbers(array: Array, to: Array) -> None:
    """Copy the numbers of an array of any dimension to one of the same shape."""
    for k in range(array.size):
        to.flat[k] = array.flat[k]


@inlined
def note_outcome(outcome: Outcome, report: LoopReport) -> None:
    """Add an `Outcome` of a contact solver to a report."""
    report.iterations += outcome.iterations
    report.unconverged += outcome.converged == 0
    report.fallbacks += outcome.fell_back
    report.residual_max = max(report.residual_max, outcome.residual)
    report.printed_residual_max = max(report.printed_residual_max, outcome.printed_residual)


@inlined
def noted(report: LoopReport) -> tuple[int, int, int, int, float, float]:
    """Return what `note_outcome` has added to a report."""
    return (
        report.iterations, report.iterations_max, report.unconverged, report.fallbacks,
        report.residual_max, report.printed_residual_max,
    )  # fmt: skip


@inlined
def take_back(before: tuple[int, int, int, int, float, float], report: LoopReport) -> None:
    """Set a report back to what was `noted` before a step that is not taken."""
    report.iterations, report.iterations_max, report.unconverged = before[0], before[1], before[2]
    report.fallbacks, report.residual_max = before[3], before[4]
    report.printed_residual_max = before[5]


@inlined
def iterations_left(most: int, report: LoopReport) -> int:
    """
    Return the iterations that the next solution of a step may take, at least 1.

    The step is to end with `most` iterations in a report.
    """
    return max(1, most - report.iterations)


@inlined
def count_steps(before: tuple[int, int, int, int, float, float], report: LoopReport) -> None:
    """Count the step, not its solutions, of which `before` was `noted` before the step."""
    report.iterations_max = max(report.iterations_max, report.iterations - before[0])
    report.unconverged = min(report.unconverged, before[2] + 1)
    report.fallbacks = min(report.fallbacks, before[3] + 1)


@inlined
def add_up(total: LoopReport, later: LoopReport) -> None:
    """Add the report of later steps to that of earlier ones, as `base.Report` does."""
    total.steps += later.steps
    total.iterations += later.iterations
    total.iterations_max = max(total.iterations_max, later.iterations_max)
    total.unconverged += later.unconverged
    total.fallbacks += later.fallbacks
    total.residual_max = max(total.residual_max, later.residual_max)
    total.printed_residual_max = max(total.printed_residual_max, later.printed_residual_max)
    total.penetration_max = max(total.penetration_max, later.penetration_max)
    total.joint_gap_max = max(total.joint_gap_max, later.joint_gap_max)
    total.joint_twist_max = max(total.joint_twist_max, later.joint_twist_max)
    total.further_parts += later.further_parts
    total.contacts = later.contacts
    total.overflows += later.overflows


@inlined
def clear_report(report: LoopReport) -> None:
    """Empty a report."""
    report.steps = report.iterations = report.iterations_max = report.unconverged = 0
    report.fallbacks = report.contacts = report.failed_link = report.not_planar = 0
    report.further_parts = report.overflows = 0
    report.residual_max = report.printed_residual_max = report.penetration_max = 0.0
    report.joint_gap_max = report.joint_twist_max = report.failed_turn = 0.0


def report_of(steps: Steps, applied: Array, dt: float, level: str) -> Report:
    """Return the report of a loop whose last step, of dt [s], had joint impulses (n-1, 2)."""
    record: Any = steps.report[0]
    return as_report(record, applied / dt, dt, level, '')


def as_report(record: Any, torque: Array, dt: float, level: str, left: str) -> Report:
    """Return a record of `LoopReport` as a report; the last step had torques (n-1, 2) [N m]."""
    numbers = record.item()
    link, turn, _ = numbers[-3:]
    planar_steps = numbers[0] if level == 'planar' else 0
    failure = divergence(link, turn, dt) if link else ''
    rest = torque, level, planar_steps, left, failure
    return Report(*(numbers[:-3] + rest))
