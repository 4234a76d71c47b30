# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Steps that are taken one at a time, as a controller in Python takes them, in memory that stays.

They are those of `base.Stepper.advance`, to the bit. That checks and copies what it is given,
chooses a level, and makes a new state. Here, the compiled loop goes on from where it ended, as
long as nothing but a step like the last one is asked for.
"""

from collections.abc import Callable
from collections.abc import Iterable
from typing import Any
from typing import cast
from typing import NamedTuple

import numpy as np

from snake_sim_ros.dynamics.bound_call import BoundCall
from snake_sim_ros.dynamics.bound_call import call
from snake_sim_ros.dynamics.bound_call import last_argument
from snake_sim_ros.dynamics.compilation import compiled
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.state import History
from snake_sim_ros.stepping.state import named_arrays
from snake_sim_ros.stepping.state import State
from snake_sim_ros.stepping.state import with_arrays
from snake_sim_ros.stepping.steps import clear_report
from snake_sim_ros.stepping.steps import make_steps
from snake_sim_ros.stepping.steps import Record
from snake_sim_ros.stepping.steps import report_of
from snake_sim_ros.stepping.steps import Steps

PITCH_ROUNDING = 1e-9  # pitch references up to this count as zero [rad], [rad/s]
ANY_PITCH, NO_PITCH, PITCH = (
    0,
    1,
    2,
)  # pitch references for which a loop is right: all, zero, not zero
FLOAT = np.dtype(np.float64)


class End(NamedTuple):
    """What a stepper makes of the end of a loop. Both are copies."""

    state: Callable[[Steps], State]
    history: Callable[[Steps], History]


@compiled
def take_one(bound, pitch, settles):
    """
    Take a step by a bound call of a loop; return False if the step is another one, or not taken.

    Parameters
    ----------
    bound : BoundCall
        Its last argument is a `steps.Steps` with one joint reference.
    pitch : int
        The pitch references for which the loop is right: ANY_PITCH, NO_PITCH or PITCH.
    settles : bool
        Whether the robot must yet lie flat before it is planar; see `state.History`.

    """
    steps = last_argument(bound)
    if pitch != ANY_PITCH:
        largest = 0.0
        for j in range(steps.angle.shape[1]):
            largest = max(largest, abs(steps.angle[0, j, 1]), abs(steps.rate[0, j, 1]))
        if (largest > PITCH_ROUNDING) != (pitch == PITCH):
            return False
        if (steps.history.settling[0] > 0.0) != settles:
            return False
    clear_report(steps.report[0])
    call(bound)
    return steps.report[0].steps == 1


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
    pitch : int
        See `take_one`.
    end : End

    Attributes
    ----------
    left : str
        Why the planar level was left, for the reports; empty if it was not.

    """

    def __init__(
        self, stepper: Any, q: Array, u: Array, history: History, record: Record, pitch: int,
        end: End,
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
            np.zeros(self.shape), record,
        )  # fmt: skip
        self.angle, self.rate = self.steps.angle, self.steps.rate
        self.pitch, self.settles = pitch, bool(history.settling[0] > 0.0)
        self.level, self.dt, self.applied = stepper.level, stepper.model.dt, stepper.work.applied
        stepper.cycles = self.steps.cycles
        self.bound = BoundCall(
            stepper.loop.func, *stepper.loop.args, stepper.model, stepper.work, self.steps
        )
        self.end, self.left = end, ''
        self.given_state: Given | None = None
        self.given_history: Given | None = None

    def take(self, angle: Array, rate: Array) -> Report | None:
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
        for given in (self.given_state, self.given_history):
            if given and given.is_changed():
                return None
        self.angle[...], self.rate[...], self.before[...] = angle, rate, self.block
        if take_one(self.bound, self.pitch, self.settles):
            self.given_state = self.given_history = None
            report = report_of(self.steps, self.applied, self.dt, self.level)
            report.left = self.left
            return report
        self.block[...] = self.before
        return None

    def prepare(self) -> None:
        """Compile the steps, by one that is not taken."""
        take_one(self.bound, ANY_PITCH, False)
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
