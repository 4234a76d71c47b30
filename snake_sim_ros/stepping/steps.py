# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The steps that a compiled loop takes, its report, and calls that continue in place.

`StepsInPlace` are those of `base.Stepper.advance`, to the bit, as a controller in Python takes
them. `advance` checks and copies what it is given, chooses a level, and makes a new state. Steps
in place stay in memory: the compiled loop continues from where it ended, as long as nothing but
as many steps like the last ones are requested.
"""

from collections.abc import Callable, Iterable
import math
from typing import Any, cast, NamedTuple

import numpy as np

from snake_sim_ros.contact.problem import Outcome
from snake_sim_ros.dynamics.compilation import compiled, inlined, record_array, Table
from snake_sim_ros.dynamics.kinematics import copy_rows
from snake_sim_ros.dynamics.records import Block, BoundCall
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import divergence, Report
from snake_sim_ros.stepping.pushes import lifts_in_step, NO_PUSHES, PushTable
from snake_sim_ros.stepping.samples import row_after
from snake_sim_ros.stepping.state import History, named_arrays, State, with_arrays

# Fields of `base.Report` that a loop adds up, and the reason why it ended early.
REPORT = np.dtype(
    [
        ('steps', np.int64),
        ('iterations', np.int64),
        ('iterations_max', np.int64),
        ('unconverged', np.int64),
        ('fallbacks', np.int64),
        ('residual_max', float),  # [m/s]
        ('printed_residual_max', float),  # [m/s]
        ('penetration_max', float),  # [m]
        ('joint_gap_max', float),  # [m]
        ('joint_twist_max', float),  # [1]
        ('further_parts', np.int64),
        ('contacts', np.int64),
        ('failed_link', np.int64),  # link, from 1, that would turn too far; 0 for none
        ('failed_turn', float),  # the angle by which it would [rad]
        ('not_planar', np.int64),  # whether the next step is not planar
    ]
)

row_at = inlined(row_after)
PITCH_ROUNDING = 1e-9  # pitch references up to this count as zero [rad], [rad/s]
# Steps for which a loop is right: all, those that leave a flat robot flat, those with a pitch
# reference that is not zero or with a push that lifts.
ANY_PITCH, NO_PITCH, PITCH = 0, 1, 2
FLOAT = np.dtype(np.float64)


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
    history: History
    angle: Array  # (steps, n-1, 2) joint references at the middle of every step [rad]
    rate: Array  # (steps, n-1, 2) [rad/s]
    report: Table  # (1,) a record of REPORT
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
    report = record_array(1, REPORT)
    cycles = np.zeros(len(angle) + 1, np.int64)
    angle, rate = np.ascontiguousarray(angle), np.ascontiguousarray(rate)
    return Steps(q, u, history, angle, rate, report, cycles, record, pushes)


@inlined
def sampled_row(k: int, record: Record) -> int:
    """Return the row of a sample after step k; -1 if there is none."""
    return row_at(k, record.every, record.first, len(record.span))


@inlined
def keep_forces(
    row: int, applied: Array, dt: float, span: float, history: History, record: Record
) -> None:
    """Fill a row with the torques of joint impulses (n-1, 2) of a step of dt, and the impulses."""
    for j in range(len(applied)):
        for k in range(2):
            record.torque[row, j, k] = applied[j, k] / dt
    for a in range(len(history.impulse)):
        for k in range(5):
            record.impulse[row, a, k] = history.impulse[a, k]
    record.span[row] = span


@inlined
def keep_sample(k: int, dt: float, span: float, applied: Array, steps: Steps) -> None:
    """Keep the state after step k of dt [s], if it is a sample; impulses acted for a span [s]."""
    record = steps.record
    row = sampled_row(k, record)
    if row >= 0:
        copy_rows(steps.q, record.q[row], 7)
        copy_rows(steps.u, record.u[row], 6)
        keep_forces(row, applied, dt, span, steps.history, record)


@inlined
def note_outcome(outcome: Outcome, report: Table) -> None:
    """Add an `Outcome` of a contact solver to a report, a record of REPORT."""
    report.iterations += outcome.iterations
    report.unconverged += outcome.converged == 0
    report.fallbacks += outcome.fell_back
    report.residual_max = max(report.residual_max, outcome.residual)
    report.printed_residual_max = max(report.printed_residual_max, outcome.printed_residual)


@inlined
def noted(report: Table) -> tuple[int, int, int, int, float, float]:
    """Return what `note_outcome` has added to a report."""
    return (
        report.iterations, report.iterations_max, report.unconverged, report.fallbacks,
        report.residual_max, report.printed_residual_max,
    )  # fmt: skip


@inlined
def take_back(before: tuple[int, int, int, int, float, float], report: Table) -> None:
    """Set a report back to what was `noted` before a step that is not taken."""
    report.iterations, report.iterations_max, report.unconverged = before[0], before[1], before[2]
    report.fallbacks, report.residual_max = before[3], before[4]
    report.printed_residual_max = before[5]


@inlined
def iterations_left(most: int, report: Table) -> int:
    """
    Return the iterations that the next solution of a step may take, at least 1.

    The step is to end with `most` iterations in a report, a record of REPORT.
    """
    return max(1, most - report.iterations)


@inlined
def count_steps(before: tuple[int, int, int, int, float, float], report: Table) -> None:
    """Count the step, not its solutions, of which `before` was `noted` before the step."""
    report.iterations_max = max(report.iterations_max, report.iterations - before[0])
    report.unconverged = min(report.unconverged, before[2] + 1)
    report.fallbacks = min(report.fallbacks, before[3] + 1)


@inlined
def clear_report(report: Table) -> None:
    """Empty a report, a record of REPORT."""
    report.steps = report.iterations = report.iterations_max = report.unconverged = 0
    report.fallbacks = report.contacts = report.failed_link = report.not_planar = 0
    report.further_parts = 0
    report.residual_max = report.printed_residual_max = report.penetration_max = 0.0
    report.joint_gap_max = report.joint_twist_max = report.failed_turn = 0.0


def report_of(steps: Steps, applied: Array, dt: float, level: str, left: str = '') -> Report:
    """
    Return the report of a loop whose last step, of dt [s], had joint impulses (n-1, 2).

    `left` is as in `base.Report`.
    """
    numbers: Any = steps.report[0].item()
    link, turn, _ = numbers[-3:]
    planar_steps = numbers[0] if level == 'planar' else 0
    failure = divergence(link, turn, dt) if link else ''
    rest = applied / dt, level, planar_steps, left, failure
    return Report(*(numbers[:-3] + rest))


class End(NamedTuple):
    """What a stepper makes of the end of a loop. Both are copies."""

    state: Callable[[Steps], State]
    history: Callable[[Steps], History]


class Next(NamedTuple):
    """The requested steps, and the kind of steps that a loop takes."""

    pitch: int  # steps that the loop takes: ANY_PITCH, NO_PITCH or PITCH
    settles: bool  # whether the robot must yet lie flat before it is planar; see `state.History`
    angle: Array  # (steps, n-1, 2) as in `Steps` [rad]
    rate: Array  # (steps, n-1, 2) [rad/s]
    settling: Array  # (1,) as in `state.History`
    report: Table  # (1,) a record of REPORT
    pushes: PushTable  # as in `Steps`


@compiled
def begin_next(following: 'Next') -> int:
    """Empty the report for the `Next` steps; return 1 if the loop can take them, or 0."""
    if following.pitch != ANY_PITCH:
        for k in range(len(following.angle)):
            angle, rate, largest = following.angle[k], following.rate[k], 0.0
            for j in range(len(angle)):
                largest = max(largest, abs(angle[j, 1]), abs(rate[j, 1]))
            is_vertical = largest > PITCH_ROUNDING or lifts_in_step(following.pushes, k)
            if is_vertical != (following.pitch == PITCH):
                return 0
        if (following.settling[0] > 0.0) != following.settles:
            return 0
    clear_report(following.report[0])
    return 1


class Given:
    """A record that was returned to the caller, and what its arrays were then."""

    def __init__(self, record: State | History, arrays: Iterable[Array]) -> None:
        self.record, self.arrays = record, tuple(arrays)
        self.content = self.read()

    def read(self) -> bytes:
        """Return what is in the arrays."""
        return b''.join(array.tobytes() for array in self.arrays)

    def is_changed(self) -> bool:
        """Return whether the arrays have changed since."""
        return self.read() != self.content


class StepsInPlace:
    """
    The loop of one level, which continues from its last step by as many steps in each call.

    Parameters
    ----------
    stepper : SpatialStepper or PlanarStepper
    count : int
        Steps of a call.
    state : tuple of ndarray
        q and u, as in `steps.Steps`; they are copied.
    history : History
        From the last step, with the memory of this level. It is copied.
    pushes : PushTable
        Whose clock the steps follow.
    pitch : int
        See `Next`.
    end : End

    Attributes
    ----------
    left : str
        Why the planar level was left, for the reports; empty if it was not.
    pause_ends : float
        `state.History.settling` at the end of a pause, if the steps are those of one.

    """

    def __init__(
        self, stepper: Any, count: int, state: tuple[Array, Array], history: History,
        pushes: PushTable, pitch: int, end: End,
    ) -> None:  # fmt: skip
        q, u = state
        arrays = {'q': q, 'u': u, **named_arrays(history)}
        self.block = np.concatenate([array.ravel() for array in arrays.values()])
        self.before = self.block.copy()
        ends = np.cumsum([array.size for array in arrays.values()])[:-1]
        parts = zip(arrays.items(), np.split(self.block, ends), strict=True)
        views = {name: part.reshape(array.shape) for (name, array), part in parts}
        self.shape = (count, len(u) - 1, 2)
        reference = np.zeros(self.shape), np.zeros(self.shape)
        self.steps = make_steps(
            (views['q'], views['u']), with_arrays(history, views), reference,
            stepper.no_record, pushes,
        )  # fmt: skip
        self.angle, self.rate = self.steps.angle, self.steps.rate
        self.level, self.dt, self.applied = stepper.level, stepper.model.dt, stepper.work.applied
        stepper.cycles = self.steps.cycles
        settling = self.steps.history.settling
        following = pitch, bool(settling[0] > 0.0), self.angle, self.rate, settling
        self.begin = BoundCall(begin_next, Block(Next(*following, self.steps.report, pushes)))
        self.loop = stepper.loop.bound(stepper.model, stepper.work, self.steps)
        self.end, self.left, self.pause_ends = end, '', -math.inf
        self.given_state: Given | None = None
        self.given_history: Given | None = None

    def take(self, angle: Array, rate: Array, pushes: PushTable) -> Report | None:
        """
        Take steps, and return their report; None, without a step, if one is not like the last.

        Nothing is checked but that the references, as in `base.Stepper.advance`, are those of as
        many steps, and that state and history are not changed from outside. The caller takes all
        other steps, and says what is wrong with them.
        """
        if not (type(angle) is type(rate) is np.ndarray and angle.dtype is rate.dtype is FLOAT):
            return None
        if not angle.shape == rate.shape == self.shape:
            return None
        if pushes is not self.steps.pushes:
            return None
        for given in (self.given_state, self.given_history):
            if given and given.is_changed():
                return None
        settling, count = self.steps.history.settling, len(self.angle)
        if settling[0] - count < self.pause_ends:
            return None
        self.angle[...], self.rate[...], self.before[...] = angle, rate, self.block
        if self.begin():
            self.loop()
            report = report_of(self.steps, self.applied, self.dt, self.level, self.left)
            if report.steps == count:
                if self.pause_ends > -math.inf:
                    settling[0] -= count
                self.given_state = self.given_history = None
                return report
            self.block[...] = self.before
        return None

    def prepare(self) -> None:
        """Compile the steps, by some that are not taken."""
        self.begin()
        self.loop()
        self.block[...] = self.before

    @property
    def state(self) -> State:
        """The state after the last step, as the stepper returns it."""
        if not self.given_state:
            state = self.end.state(self.steps)
            self.given_state = Given(state, (state.q, state.u))
        return cast(State, self.given_state.record)

    @property
    def history(self) -> History:
        """The history after the last step, as the stepper returns it."""
        if not self.given_history:
            history = self.end.history(self.steps)
            self.given_history = Given(history, named_arrays(history).values())
        return cast(History, self.given_history.record)
