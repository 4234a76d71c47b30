# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Steps that are taken one at a time, as a controller in Python takes them, in memory that stays.

They are those of `base.Stepper.advance`, to the bit. That checks and copies what it is given,
chooses a level, and makes a new state. Here, the compiled loop goes on from where it ended, as
long as nothing but a step like the last one is asked for.
"""

from collections.abc import Callable, Iterable
from typing import Any, cast, NamedTuple

import numpy as np

from snake_sim_ros.dynamics.bound_call import BoundCall
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.dynamics.records import Block
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.pushes import lifts_at_once, PushTable
from snake_sim_ros.stepping.state import History, named_arrays, State, with_arrays
from snake_sim_ros.stepping.steps import clear_report, make_steps, Record, report_of, Steps

PITCH_ROUNDING = 1e-9  # pitch references up to this count as zero [rad], [rad/s]
# Steps for which a loop is right: all, those that leave a flat robot flat, those with a pitch
# reference that is not zero or with a push that lifts.
ANY_PITCH, NO_PITCH, PITCH = 0, 1, 2
FLOAT = np.dtype(np.float64)


class End(NamedTuple):
    """What a stepper makes of the end of a loop. Both are copies."""

    state: Callable[[Steps], State]
    history: Callable[[Steps], History]


class Next(NamedTuple):
    """The step that is asked for, and for which a loop is right."""

    pitch: int  # the steps for which it is: ANY_PITCH, NO_PITCH or PITCH
    settles: bool  # whether the robot must yet lie flat before it is planar; see `state.History`
    angle: Array  # (1, n-1, 2) as in `steps.Steps`
    rate: Array  # (1, n-1, 2)
    settling: Array  # (1,)
    report: Any  # (1,)
    pushes: PushTable


@compiled
def begin_one(following):
    """Empty the report for the `Next` step; return 1 if the loop is right for it, or 0."""
    if following.pitch != ANY_PITCH:
        angle, rate, largest = following.angle, following.rate, 0.0
        for j in range(angle.shape[1]):
            largest = max(largest, abs(angle[0, j, 1]), abs(rate[0, j, 1]))
        is_vertical = largest > PITCH_ROUNDING or lifts_at_once(following.pushes)
        if is_vertical != (following.pitch == PITCH):
            return 0
        if (following.settling[0] > 0.0) != following.settles:
            return 0
    clear_report(following.report[0])
    return 1


class Given:
    """A record that was given away, and what its arrays were then."""

    def __init__(self, record: State | History, arrays: Iterable[Array]) -> None:
        self.record, self.arrays = record, tuple(arrays)
        self.content = self.read()

    def read(self) -> bytes:
        """Return what is in the arrays."""
        return b''.join(array.tobytes() for array in self.arrays)

    def is_changed(self) -> bool:
        """Return whether the arrays have changed since."""
        return self.read() != self.content


class SingleSteps:
    """
    The loop of one level, which goes on from its last step by one step at a time.

    Parameters
    ----------
    stepper : SpatialStepper or PlanarStepper
    q, u : ndarray
        As in `steps.Steps`; they are copied.
    history : History
        From the last step, with the memory of this level. It is copied.
    record : Record
        Without samples.
    pushes : PushTable
        Whose clock the steps follow.
    pitch : int
        See `Next`.
    end : End

    Attributes
    ----------
    left : str
        Why the planar level was left, for the reports; empty if it was not.

    """

    def __init__(
        self, stepper: Any, q: Array, u: Array, history: History, record: Record,
        pushes: PushTable, pitch: int, end: End,
    ) -> None:  # fmt: skip
        arrays = {'q': q, 'u': u, **named_arrays(history)}
        self.block = np.concatenate([array.ravel() for array in arrays.values()])
        self.before = self.block.copy()
        ends = np.cumsum([array.size for array in arrays.values()])[:-1]
        parts = zip(arrays.items(), np.split(self.block, ends), strict=True)
        views = {name: part.reshape(array.shape) for (name, array), part in parts}
        self.shape = (1, len(u) - 1, 2)
        self.steps = make_steps(
            views['q'], views['u'], with_arrays(history, views), np.zeros(self.shape),
            np.zeros(self.shape), record, pushes,
        )  # fmt: skip
        self.angle, self.rate = self.steps.angle, self.steps.rate
        self.level, self.dt, self.applied = stepper.level, stepper.model.dt, stepper.work.applied
        stepper.cycles = self.steps.cycles
        settling = self.steps.history.settling
        following = pitch, bool(settling[0] > 0.0), self.angle, self.rate, settling
        self.begin = BoundCall(begin_one, Block(Next(*following, self.steps.report, pushes)))
        self.loop = stepper.loop.bound(stepper.model, stepper.work, self.steps)
        self.end, self.left = end, ''
        self.given_state: Given | None = None
        self.given_history: Given | None = None

    def take(self, angle: Array, rate: Array, pushes: PushTable) -> Report | None:
        """
        Take a step, and return its report; None if it is not one like the last, and not taken.

        Nothing is checked but that the references, as in `base.Stepper.advance`, are those of one
        step, and that state and history are not changed from outside. The caller takes all other
        steps, and says what is wrong with them.
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
        self.angle[...], self.rate[...], self.before[...] = angle, rate, self.block
        if self.begin():
            self.loop()
            report = report_of(self.steps, self.applied, self.dt, self.level, self.left)
            if report.steps:
                self.given_state = self.given_history = None
                return report
            self.block[...] = self.before
        return None

    def prepare(self) -> None:
        """Compile the steps, by one that is not taken."""
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
