# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A compiled loop over steps as a stepper, and calls that continue in place.

`StepsInPlace` are those of `base.Stepper.advance`, to the bit, as a controller in Python takes
them. `advance` checks and copies what it is given, chooses a level, and makes a new state. Steps
in place stay in memory: the compiled loop continues from where it ended, as long as nothing but
as many steps like the last ones are requested.
"""

from collections.abc import Callable, Iterable
import math
from typing import Any, cast, NamedTuple, TYPE_CHECKING

import numpy as np

from snake_sim_ros.dynamics.compilation import Dispatched, Table
from snake_sim_ros.dynamics.records import Block, BoundCall, entry, Loop
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.base import Inputs, Report
from snake_sim_ros.stepping.model import Model, Workspace
from snake_sim_ros.stepping.pushes import lifts_in_step, NO_PUSHES, PushTable
from snake_sim_ros.stepping.samples import checked, make_samples, Samples
from snake_sim_ros.stepping.state import (
    copied,
    empty_history,
    History,
    Memory,
    named_arrays,
    Returned,
    State,
    with_arrays,
)
from snake_sim_ros.stepping.steps import (
    clear_report,
    LoopReport,
    make_steps,
    Record,
    report_of,
    Steps,
)

if TYPE_CHECKING:
    from snake_sim_ros.stepping.planar.model import PlanarModel, PlanarWorkspace

PITCH_ROUNDING = 1e-9  # pitch references up to this count as zero [rad], [rad/s]
# Steps for which a loop is right: all, those that leave a flat robot flat, those with a pitch
# reference that is not zero or with a push that lifts.
ANY_PITCH, NO_PITCH, PITCH = 0, 1, 2
FLOAT = np.dtype(np.float64)


class LoopStepper:
    """
    A stepper of one level with a compiled loop; see `base.Stepper`.

    Parameters
    ----------
    scene : Scene
    loop : callable
        Compiled ``advance(model, work, steps)``, which takes the steps up to the first that
        diverges; see `steps.Steps`. Its first argument is bound: a contact solver, or the arrays
        of a method.
    model, work
        The records of the level, `model.Model` or `planar.model.PlanarModel` and so on.
    memory : NamedTuple of arrays or None
        Memory of the loop before the first step; see `state.History`.

    """

    level: str

    def __init__(
        self, scene: Scene, loop: Callable[..., None], model: 'Model | PlanarModel',
        work: 'Workspace | PlanarWorkspace', memory: Memory | None,
    ) -> None:  # fmt: skip
        self.scene, self.loop, self.model, self.work = scene, loop, model, work
        self.empty = empty_history(scene, memory)
        self.returned = Returned(scene.robot.link_count, self.empty)
        self.no_samples = make_samples(scene, 0, 0)
        self.cycles = np.zeros(1, np.int64)

    def empty_history(self) -> History:
        """Return the history before the first step."""
        return self.returned.empty_history()

    def limit_iterations(self, limit: int) -> None:
        """Let a step take that many iterations at most."""
        self.model = self.model._replace(iteration_limit=limit)

    def advance(
        self, state: State, history: History, angle: Array, rate: Array,
        samples: Samples | None = None, pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """Return state, history and report after as many steps as there are references."""
        self.returned.check(state, history, angle, rate)
        inputs = Inputs(angle, rate, checked(samples, self.no_samples), pushes)
        state, history, report = self.take_steps(state, copied(history), inputs)
        self.returned.last = state, history
        return state, history, report

    def take_steps(
        self, state: State, history: History, inputs: Inputs
    ) -> tuple[State, History, Report]:
        """Advance with checked arguments, of which the history is changed in place."""
        raise NotImplementedError

    def record_of(self, kept: Samples) -> Record:
        """Return what a loop keeps for samples, in their memory where it can."""
        raise NotImplementedError

    def run_loop(self, steps: Steps) -> Report:
        """Run the loop over steps, which it changes in place."""
        self.loop(self.model, self.work, steps)
        self.cycles = steps.cycles
        return report_of(steps, self.work.applied, self.model.dt, self.level)


class End(NamedTuple):
    """What a stepper makes of the end of a loop. State and history are copies."""

    state: Callable[[Steps], Callable[[], State]]  # what reads q and u as links in space
    history: Callable[[Steps], History]  # with the memory of the level
    # What `show` takes to fill q (n, 7) and u (n, 6) of a `State`.
    shown: Callable[[Steps, Array, Array], tuple[Any, ...]]
    filled: Callable[[Steps, Samples], Callable[[], object]]  # what fills samples from the record


@Dispatched
def show(shown: tuple[Any, ...]) -> None:
    """Fill coordinates and velocities of links in space after the last step; see `End`."""


class Calls(NamedTuple):
    """What the calls are like that continue in place."""

    steps: int  # of a call
    every: int  # steps from one sample to the next, which divides them; 0: no samples
    pushes: PushTable  # whose clock the steps follow
    pitch: int  # steps that the loop takes: ANY_PITCH, NO_PITCH or PITCH


class Next(NamedTuple):
    """The requested steps, and the kind of steps that a loop takes."""

    pitch: int  # as in `Calls`
    settles: bool  # whether the robot must yet lie flat before it is planar; see `state.History`
    angle: Array  # (steps, n-1, 2) as in `Steps` [rad]
    rate: Array  # (steps, n-1, 2) [rad/s]
    settling: Array  # (1,) as in `state.History`
    report: Table[LoopReport]  # (1,)
    pushes: PushTable  # as in `Steps`


@entry
def begin_next(following: Next) -> int:
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
    stepper : LoopStepper
    calls : Calls
    state : tuple of ndarray
        q and u, as in `steps.Steps`; they are copied.
    history : History
        From the last step, with the memory of this level. It is copied.
    end : End

    Attributes
    ----------
    left : str
        Why the planar level was left, for the reports; empty if it was not.
    pause_ends : float
        `state.History.settling` at the end of a pause, if the steps are those of one.

    """

    def __init__(
        self, stepper: LoopStepper, calls: Calls, state: tuple[Array, Array], history: History,
        end: End,
    ) -> None:  # fmt: skip
        assert isinstance(stepper.loop, Loop)
        q, u = state
        arrays = {'q': q, 'u': u, **named_arrays(history)}
        self.block = np.concatenate([array.ravel() for array in arrays.values()])
        self.before = self.block.copy()
        ends = np.cumsum([array.size for array in arrays.values()])[:-1]
        parts = zip(arrays.items(), np.split(self.block, ends), strict=True)
        views = {name: part.reshape(array.shape) for (name, array), part in parts}
        self.shape = (calls.steps, len(u) - 1, 2)
        reference = np.zeros(self.shape), np.zeros(self.shape)
        self.rows = calls.steps // calls.every if calls.every else 0
        self.kept = make_samples(stepper.scene, calls.every, self.rows)
        self.kept.is_planar[:] = stepper.level == 'planar'
        self.steps = make_steps(
            (views['q'], views['u']), with_arrays(history, views), reference,
            stepper.record_of(self.kept), calls.pushes,
        )  # fmt: skip
        self.angle, self.rate = self.steps.angle, self.steps.rate
        self.level, self.dt, self.applied = stepper.level, stepper.model.dt, stepper.work.applied
        stepper.cycles = self.steps.cycles
        settling = self.steps.history.settling
        following = calls.pitch, bool(settling[0] > 0.0), self.angle, self.rate, settling
        self.following = Next(*following, self.steps.report, calls.pushes)
        self.begin = BoundCall(begin_next, Block(self.following))
        self.loop = stepper.loop.bound(stepper.model, stepper.work, self.steps)
        self.end, self.left, self.pause_ends = end, '', -math.inf
        self.read_state, self.fill = end.state(self.steps), end.filled(self.steps, self.kept)
        self.given_state: Given | None = None
        self.given_history: Given | None = None

    def take(
        self, angle: Array, rate: Array, pushes: PushTable, samples: Samples | None = None
    ) -> Report | None:
        """
        Take steps, and return their report; None, without a step, if one is not like the last.

        Nothing is checked but that the references, as in `base.Stepper.advance`, are those of as
        many steps, that the samples are as many, and that state and history are not changed from
        outside. The caller takes all other steps, and says what is wrong with them.
        """
        if not (type(angle) is type(rate) is np.ndarray and angle.dtype is rate.dtype is FLOAT):
            return None
        if not angle.shape == rate.shape == self.shape:
            return None
        if pushes is not self.steps.pushes or not self.keeps(samples):
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
                if samples:
                    self.fill()
                    for array, own in zip(samples[2:], self.kept[2:], strict=True):
                        array[: self.rows] = own
                return report
            self.block[...] = self.before
        return None

    def keeps(self, samples: Samples | None) -> bool:
        """Return whether calls keep such samples."""
        if samples is None:
            return not self.rows
        return samples[:2] == self.kept[:2] and all(
            len(array) >= self.rows and array.shape[1:] == own.shape[1:] and array.flags.writeable
            for array, own in zip(samples[2:], self.kept[2:], strict=True)
        )

    def prepare(self) -> None:
        """Compile the steps, by some that are not taken."""
        self.begin()
        self.loop()
        self.block[...] = self.before

    @property
    def state(self) -> State:
        """The state after the last step, as the stepper returns it."""
        if not self.given_state:
            state = self.read_state()
            self.given_state = Given(state, (state.q, state.u))
        return cast(State, self.given_state.record)

    @property
    def history(self) -> History:
        """The history after the last step, as the stepper returns it."""
        if not self.given_history:
            history = self.end.history(self.steps)
            self.given_history = Given(history, named_arrays(history).values())
        return cast(History, self.given_history.record)
