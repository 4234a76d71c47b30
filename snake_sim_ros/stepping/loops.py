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

from snake_sim_ros.dynamics.compilation import COMPILES, Dispatched, inlined, record_array, Table
from snake_sim_ros.dynamics.records import Block, BoundCall, call_code, entry, Loop
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
    add_up,
    as_report,
    clear_report,
    copy_numbers,
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

    def code(self) -> Any:
        """Return what steppers whose loops have the same machine code share; None without any."""
        if not isinstance(self.loop, Loop):
            return None
        blocks = self.loop.blocks(self.model, self.work)
        return self.level, self.loop.func, *(block.kind for block in blocks)

    def run_loop(self, steps: Steps) -> Report:
        """Run the loop over steps, which it changes in place."""
        self.loop(self.model, self.work, steps)
        self.cycles = steps.cycles
        return report_of(steps, self.work.applied, self.model.dt, self.level)


class End(NamedTuple):
    """What a stepper makes of the end of a loop."""

    history: Callable[[Steps], History]  # a copy, with the memory of the level
    # What `show` takes to fill q (n, 7) and u (n, 6) of a `State`, and the samples of a call.
    shown: Callable[[Steps, Samples, Array, Array], tuple[Any, ...]]


@Dispatched
def show(shown: tuple[Any, ...]) -> None:
    """
    Fill coordinates and velocities of links in space, after the last step and at each sample.

    See `End`.
    """


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


@inlined
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


class Shared(NamedTuple):
    """Arrays that calls in place share with the caller."""

    angle: Array  # (steps, n-1, 2) references of the next call [rad]
    rate: Array  # (steps, n-1, 2) [rad/s]
    q: Array  # (n, 7) of the state after the last call, as in `state.State`
    u: Array  # (n, 6)
    torque: Array  # (n-1, 2) torques of the last step [N m]
    total: Table[LoopReport]  # (1,) of the calls since it was emptied


class Going(NamedTuple):
    """What `go_on` takes."""

    code: int  # address of the machine code of the loop
    address: int  # of what that takes
    following: Next
    pause_ends: float  # as in `StepsInPlace`
    dt: float  # [s]
    block: Array  # all numbers that the loop changes in place
    before: Array  # of the same shape
    applied: Array  # (n-1, 2) impulses of the joints in the last step [N m s]
    shared: Shared
    shown: tuple[Any, ...]  # see `show`
    kept: Samples  # of a call
    samples: Samples  # of all calls
    row: Array  # (1,) of the first sample of the next call in these


@entry
def go_on(going: Going) -> int:
    """Take the steps of a call that continues in place; return 1, or 0 without a step."""
    following, shared = going.following, going.shared
    count = len(following.angle)
    if following.settling[0] - count < going.pause_ends:
        return 0
    copy_numbers(shared.angle, following.angle)
    copy_numbers(shared.rate, following.rate)
    copy_numbers(going.block, going.before)
    if begin_next(following) == 0:
        return 0
    call_code(going.code, going.address)
    report = following.report[0]
    if report.steps != count:
        copy_numbers(going.before, going.block)
        return 0
    if going.pause_ends > -math.inf:
        following.settling[0] -= count
    following.pushes.clock[0] += count
    add_up(shared.total[0], report)
    for j in range(len(shared.torque)):
        for k in range(2):
            shared.torque[j, k] = going.applied[j, k] / going.dt
    show(going.shown)
    copy_samples(going.kept, going.samples, going.row[0])
    return 1


@inlined
def copy_samples(kept: Samples, samples: Samples, row: int) -> None:
    """Copy samples to others, from a row of these on."""
    for m in range(len(kept.span)):
        copy_numbers(kept.q[m], samples.q[row + m])
        copy_numbers(kept.u[m], samples.u[row + m])
        copy_numbers(kept.torque[m], samples.torque[row + m])
        copy_numbers(kept.impulse[m], samples.impulse[row + m])
        samples.span[row + m] = kept.span[m]
        samples.is_planar[row + m] = kept.is_planar[m]


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
    links : State
        The state of the links in space; it is copied.

    Attributes
    ----------
    left : str
        Why the planar level was left, for the reports; empty if it was not.
    pause_ends : float
        `state.History.settling` at the end of a pause, if the steps are those of one.
    shared : Shared
    samples : Samples
        What the calls fill, a number of rows each.

    """

    def __init__(
        self, stepper: LoopStepper, calls: Calls, state: tuple[Array, Array], history: History,
        end: End, links: State,
    ) -> None:  # fmt: skip
        assert isinstance(stepper.loop, Loop)
        q, u = state
        arrays = {'q': q, 'u': u, **named_arrays(history)}
        self.block = np.concatenate([array.ravel() for array in arrays.values()])
        ends = np.cumsum([array.size for array in arrays.values()])[:-1]
        parts = zip(arrays.items(), np.split(self.block, ends), strict=True)
        views = {name: part.reshape(array.shape) for (name, array), part in parts}
        self.shape = (calls.steps, len(u) - 1, 2)
        reference = np.zeros(self.shape), np.zeros(self.shape)
        self.pitch, self.every = calls.pitch, calls.every
        self.rows = calls.steps // calls.every if calls.every else 0
        self.kept = make_samples(stepper.scene, calls.every, self.rows)
        self.kept.is_planar[:] = stepper.level == 'planar'
        self.steps = make_steps(
            (views['q'], views['u']), with_arrays(history, views), reference,
            stepper.record_of(self.kept), calls.pushes,
        )  # fmt: skip
        self.level, self.dt, self.applied = stepper.level, stepper.model.dt, stepper.work.applied
        stepper.cycles = self.steps.cycles
        self.loop = stepper.loop.bound(stepper.model, stepper.work, self.steps)
        self.end, self.left, self.pause_ends = end, '', -math.inf
        self.shared = Shared(
            *reference, links.q.copy(), links.u.copy(), np.zeros(self.shape[1:]),
            record_array(1, LoopReport),
        )  # fmt: skip
        self.samples, self.row = self.kept, np.zeros(1, np.int64)
        self.given_state: Given | None = None
        self.given_history: Given | None = None

    def bind(
        self, shared: Shared | None = None, samples: Samples | None = None
    ) -> tuple[int, int]:
        """
        Share arrays with the caller from now on, where they are given.

        Returns
        -------
        code, address : int
            Of a `BoundCall`, which returns 1 if the steps for the references in `shared` were like
            the last, or 0 without a step.

        """
        if shared:
            for own, other in zip(self.shared[2:5], shared[2:5], strict=True):
                other[...] = own
            self.shared = shared
        if samples:
            self.samples = samples
        steps, settling = self.steps, self.steps.history.settling
        following = Next(
            self.pitch, bool(settling[0] > 0.0), steps.angle, steps.rate, settling, steps.report,
            steps.pushes,
        )  # fmt: skip
        going = Going(
            self.loop.code, self.loop.address, following, self.pause_ends, self.dt, self.block,
            self.block.copy(), self.applied, self.shared,
            self.end.shown(steps, self.kept, self.shared.q, self.shared.u), self.kept,
            self.samples, self.row,
        )  # fmt: skip
        self.call = BoundCall(go_on, Block(going))
        self.present = State(self.shared.q, self.shared.u)
        return self.call.code, self.call.address

    def take(
        self, angle: Array, rate: Array, pushes: PushTable, samples: Samples | None = None,
        begun: int = 0,
    ) -> bool:  # fmt: skip
        """
        Take steps; return False, without a step, if one is not like the last.

        Nothing is checked but that the references, as in `base.Stepper.advance`, are those of as
        many steps, that the samples are the same, with `begun` steps since they began, and that
        state and history are not changed from outside. The caller takes all other steps, and says
        what is wrong with them.
        """
        if not (type(angle) is type(rate) is np.ndarray and angle.dtype is rate.dtype is FLOAT):
            return False
        if not angle.shape == rate.shape == self.shape:
            return False
        if pushes is not self.steps.pushes or not self.keeps(samples, begun):
            return False
        for given in (self.given_state, self.given_history):
            if given and given.is_changed():
                return False
        self.shared.angle[...], self.shared.rate[...] = angle, rate
        if not self.call():
            return False
        self.given_state = self.given_history = None
        return True

    def keeps(self, samples: Samples | None, begun: int) -> bool:
        """Return whether the next call keeps samples of a kind, with steps since they began."""
        if samples is None:
            return not self.every
        if samples is not self.samples:
            return False
        row, rest = divmod(begun, self.every)
        self.row[0] = row
        return rest == 0 and row + self.rows <= len(samples.span)

    @property
    def has_moved(self) -> bool:
        """Whether steps were taken that are not `noted` yet."""
        total: Any = self.shared.total
        return bool(total['steps'][0])

    def noted(self) -> tuple[Report, Report]:
        """Return the reports of the last call and of all since the last time, one or more."""
        total: Any = self.shared.total
        rest = self.shared.torque.copy(), self.dt, self.level, self.left
        last, both = as_report(self.steps.report[0], *rest), as_report(total[0], *rest)
        total[:] = np.zeros(1, total.dtype)
        return last, both

    def prepare(self) -> None:
        """Compile the steps, by some that are not taken."""
        if COMPILES:
            before, clock = self.block.copy(), self.steps.pushes.clock.copy()
            self.bind()
            self.call()
            self.block[...], self.steps.pushes.clock[:] = before, clock

    @property
    def state(self) -> State:
        """The state after the last step, as the stepper returns it."""
        if not self.given_state:
            state = State(self.shared.q.copy(), self.shared.u.copy())
            self.given_state = Given(state, (state.q, state.u))
        return cast(State, self.given_state.record)

    @property
    def history(self) -> History:
        """The history after the last step, as the stepper returns it."""
        if not self.given_history:
            history = self.end.history(self.steps)
            self.given_history = Given(history, named_arrays(history).values())
        return cast(History, self.given_history.record)
