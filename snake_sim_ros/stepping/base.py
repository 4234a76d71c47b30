"""
What a time stepper takes and returns.

A stepper is made for a scene and has one method, `advance`. It never raises because a step did not
converge or blew up: that is part of the report. Only misuse raises.
"""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field
from dataclasses import fields
from enum import Enum
from typing import Any
from typing import NamedTuple
from typing import Protocol
from typing import TypeVar

import numpy as np

from snake_sim_ros.dynamics.compilation import merged
from snake_sim_ros.scene.obstacles import same_contacts
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.quantities import ParameterError

T = TypeVar('T')


class History(NamedTuple):
    """
    What a step takes over from the one before, besides the state.

    Attributes
    ----------
    impulse : ndarray, shape (contacts, 5)
        Last impulse of every contact: normal, sliding x y, rolling x y [N s], eq. (93).
    velocity : ndarray, shape (contacts, 5)
        Relative velocities after it [m/s].
    change : ndarray, shape (contacts, 5)
        By how much the last step changed the normal impulse and the other velocities.
    settling : ndarray, shape (1,)
        Steps for which a robot has still to lie flat and still before it is planar, see `levels`.
    memory : NamedTuple of arrays, or None
        What the method itself keeps at its level, of a type of its own; None if it is nothing.

    """

    impulse: Array
    velocity: Array
    change: Array
    settling: Array
    memory: Any = None


@merged
def without_memory(history):
    """
    Return the same history without the memory of the method: what the solvers of contacts take.

    Compiled. They are compiled once for all methods then.
    """
    return History(history.impulse, history.velocity, history.change, history.settling, None)


def empty_history(contacts: int, memory: Any = None) -> History:
    """Return the history before the first contact of a scene with so many of them."""
    slabs = np.zeros((3, contacts, 5))
    return History(slabs[0], slabs[1], slabs[2], np.zeros(1), memory)


def named_arrays(record: Any, name: str = 'history') -> dict[str, Array]:
    """Return the arrays of nested NamedTuples such as a history, by their dotted names."""
    if isinstance(record, np.ndarray):
        return {name: record}
    found: dict[str, Array] = {}
    for part in getattr(record, '_fields', ()):
        found |= named_arrays(getattr(record, part), f'{name}.{part}')
    return found


def copied(record: T) -> T:
    """Return a copy of nested NamedTuples of arrays, such as a history."""
    if record is None:
        return record
    if isinstance(record, np.ndarray):
        return record.copy()
    parts: Any = record
    return type(record)(*map(copied, parts))


@dataclass(frozen=True)
class State:
    """
    Coordinates and velocities of all links, nothing else.

    Attributes
    ----------
    q : ndarray, shape (n, 7)
        Link centers r_G [m, frame I] and Euler parameters p, scalar first.
    u : ndarray, shape (n, 6)
        Velocities v_G [m/s, frame I] and angular velocities omega [rad/s, frame B].

    """

    q: Array
    u: Array


class Status(Enum):
    """How the steps of a call went."""

    CONVERGED = 'converged'
    MAX_ITERATIONS = 'max_iterations'
    DIVERGED = 'diverged'


@dataclass
class Report:
    """
    What happened in some steps; the sum of two reports is the report of all their steps.

    Attributes
    ----------
    steps, iterations, unconverged, fallbacks : int
        Steps done, contact iterations in all of them, steps that hit the iteration limit, steps in
        which the solver fell back on a slower method.
    iterations_max : int
        Most iterations in one step.
    residual_max, printed_residual_max : float
        Largest natural-map residual of the contact laws after a step, with the selection rule and
        as the paper prints them [m/s]: how far the impulses are from the projections (87)-(89),
        over the prox parameters. For orthotropic friction an upper bound.
    penetration_max : float
        Deepest gap below zero after a step [m].
    joint_gap_max, joint_twist_max : float
        Largest joint violation g_J in position [m] and angle [1] that a step made, before the
        drift correction of section VII-C removed it.
    contacts : int
        Contacts closed in the last step.
    joint_torque : ndarray, shape (n-1, 2)
        Torque (yaw, pitch) of the last step [N m].
    level : str
        Model level of the last step, `spatial` or `planar`.
    planar_steps : int
        How many of the steps were planar.
    left : str
        Why the planar level was left, empty if it was not.
    failure : str
        Empty, or the sentence that says what diverged, when and where.

    """

    steps: int = 0
    iterations: int = 0
    iterations_max: int = 0
    unconverged: int = 0
    fallbacks: int = 0
    residual_max: float = 0.0
    printed_residual_max: float = 0.0
    penetration_max: float = 0.0
    joint_gap_max: float = 0.0
    joint_twist_max: float = 0.0
    contacts: int = 0
    joint_torque: Array = field(default_factory=lambda: np.zeros((0, 2)))
    level: str = 'spatial'
    planar_steps: int = 0
    left: str = ''
    failure: str = ''

    @property
    def status(self) -> Status:
        """The worst that happened in any of the steps."""
        if self.failure:
            return Status.DIVERGED
        return Status.MAX_ITERATIONS if self.unconverged else Status.CONVERGED

    def __add__(self, later: 'Report') -> 'Report':
        """Return the report of these steps and of `later` ones."""
        added = {name: getattr(self, name) + getattr(later, name) for name in ADDED}
        largest = {name: max(getattr(self, name), getattr(later, name)) for name in LARGEST}
        return Report(
            **added,
            **largest,
            contacts=later.contacts,
            joint_torque=later.joint_torque,
            level=later.level,
            left=later.left,
            failure=self.failure or later.failure,
        )


ADDED = ('steps', 'iterations', 'unconverged', 'fallbacks', 'planar_steps')
LARGEST = tuple(item.name for item in fields(Report) if item.name.endswith('_max'))


def divergence(link: int, turn: float, dt: float, steps: int) -> str:
    """Return the sentence for a link that would turn too far, or to nowhere, in one step."""
    return (
        f'link {link} would turn by {turn:.3g} rad in one step of {dt:g} s after {steps} good '
        f'steps; less than pi/2 is resolved'
    )


class Stepper(Protocol):
    """
    A method that advances a scene in time.

    Attributes
    ----------
    level : str
        Model level of the last step.
    cycles : ndarray, shape (steps+1,)
        Time stamps between the steps of the last call; empty if they are not compiled.

    """

    level: str

    @property
    def cycles(self) -> Array: ...  # noqa: D102

    def empty_history(self) -> History:
        """Return the history before the first step."""
        ...

    def advance(
        self, state: State, history: History, angle: Array, rate: Array
    ) -> tuple[State, History, Report]:
        """
        Return state, history and report after as many steps as there are references.

        Parameters
        ----------
        state : State
        history : History
            After the last step of this stepper; `empty_history` before the first one, `carried`
            where the last step was one of another scene, method or level. It is left alone.
        angle, rate : ndarray, shape (steps, n-1, 2)
            Joint references [rad], [rad/s] at the middle of every step.

        Returns
        -------
        state : State
            The last good state if a step diverged.
        history : History
            Empty if a step diverged.
        report : Report

        Raises
        ------
        ParameterError
            If an array has not the shape or the type of number that it must have: compiled code
            does not look where it writes. If coordinates or history are not finite, or the memory
            is that of another method or level.

        """
        ...


def _everything(scene: Scene) -> str:
    return ''


def _nowhere(scene: Scene) -> bool:
    return False


@dataclass(frozen=True)
class Method:
    """
    A time stepping method: how its steppers are made, and what others need to know of it.

    Attributes
    ----------
    spatial, planar : callable
        Make the stepper of a scene, a `spatial.SpatialStepper` and a `stepper.PlanarStepper`.
    where_impulses_acted : callable
        ``where_impulses_acted(scene, state, memory)``: the coordinates (n, 7) for which the last
        step had impulses, and how long these acted [s].
    what_is_not_possible : callable
        Why the method cannot run a scene, as a sentence; empty if it can.
    is_faster_in_space : callable
        Whether the spatial level takes less time for a scene that is planar.
    planar_pegs : bool
        Whether it meets pegs at the planar level, too.
    energy_balance : bool
        Whether impulses are those of a whole step, so that an energy balance can be drawn up.
    compiled : bool
        Whether its steps are compiled, and timed.

    """

    spatial: Callable[[Scene], Any]
    planar: Callable[[Scene], Any]
    where_impulses_acted: Callable[[Scene, State, Any], tuple[Array, float]]
    what_is_not_possible: Callable[[Scene], str] = _everything
    is_faster_in_space: Callable[[Scene], bool] = _nowhere
    planar_pegs: bool = False
    energy_balance: bool = True
    compiled: bool = True


def check_state(links: int, contacts: int, state: State, history: History) -> None:
    """
    Check what a step went to; `links` and `contacts` are those of its scene.

    Raises
    ------
    ParameterError
        If an array has another shape or other numbers than a `Stepper` takes, or the coordinates
        or the history are not finite. Velocities that are not are a step that diverged.

    """
    _check_array('state.q', state.q, (links, 7))
    _check_array('state.u', state.u, (links, 6))
    if not isinstance(history, History):
        raise ParameterError(f'history must be a History, got {type(history).__name__}')
    for name in ('impulse', 'velocity', 'change'):
        _check_array(f'history.{name}', getattr(history, name), (contacts, 5))
    _check_array('history.settling', history.settling, (1,))
    for name, array in {'state.q': state.q, **named_arrays(history)}.items():
        if not np.isfinite(array).all():
            place = np.argwhere(~np.isfinite(array))[0].tolist()
            raise ParameterError(f'{name} must be finite, got {array[tuple(place)]} at {place}')


def check_arguments(
    links: int, empty: History, state: State, history: History, angle: Array, rate: Array
) -> None:
    """
    Check all that `Stepper.advance` takes; `links` and `empty` are those of the stepper.

    Raises
    ------
    ParameterError
        If an array has another shape or other numbers than a `Stepper` takes, or the memory of the
        history is that of another method or level.

    """
    check_state(links, len(empty.impulse), state, history)
    memory, wanted = history.memory, empty.memory
    if type(memory) is not type(wanted):
        raise ParameterError(
            f'history.memory must be that of this method and level, {_kind(wanted)}, got '
            f'{_kind(memory)}; begin with empty_history() of the stepper, or see carried'
        )
    found = named_arrays(memory, 'history.memory')
    for name, array in named_arrays(wanted, 'history.memory').items():
        _check_array(name, found.get(name), array.shape)
    steps = len(angle) if np.ndim(angle) else 0
    _check_array('angle', angle, (steps, links - 1, 2))
    _check_array('rate', rate, (steps, links - 1, 2))


def _kind(memory: Any) -> str:
    """Return what a memory is called."""
    kind = type(memory)
    return (
        'None'
        if memory is None
        else f'{kind.__module__.rpartition("stepping.")[2]}.{kind.__name__}'
    )


def _check_array(name: str, array: Any, shape: tuple[int, ...]) -> None:
    """Raise if this is not an array of floats of a shape."""
    if isinstance(array, np.ndarray) and array.shape == shape and array.dtype == np.float64:
        return
    got = f'shape {np.shape(array)} of {array.dtype}' if isinstance(array, np.ndarray) else ''
    raise ParameterError(
        f'{name} must be an array of shape {shape} of float64, got {got or type(array).__name__}'
    )


def initial_state(scene: Scene) -> State:
    """Return the robot at rest in the initial posture of the scene."""
    return State(initial_coordinates(scene), np.zeros((scene.robot.link_count, 6)))


def carried(
    history: History, before: Scene, after: Scene, scale: float, empty: History
) -> History:
    """
    Return what the steps of a scene may take over from those of another one.

    Contacts that both have keep what is known of them, and those that are new have not touched
    yet. The memory is empty: differences over two steps mean nothing where forces jump.

    Parameters
    ----------
    history : History
        After a step of the scene `before`; left alone.
    before, after : Scene
        Of the same robot and time step.
    scale : float
        Time step over the time in which the last impulses acted: here they are of a whole step.
    empty : History
        That the stepper of the scene `after` begins with.

    Returns
    -------
    History

    """
    old, new = same_contacts(before, after)
    taken = copied(empty)
    for name in ('impulse', 'velocity', 'change'):
        getattr(taken, name)[new] = getattr(history, name)[old]
    taken.impulse[:] *= scale
    taken.change[:, 0] *= scale
    taken.settling[:] = history.settling
    return taken
