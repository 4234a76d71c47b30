# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a step starts from: the state of all links, and the history of the steps before it."""

from collections.abc import Mapping
from dataclasses import dataclass
import math
from typing import Any, cast, NamedTuple, Protocol, TypeVar

import numpy as np

from snake_sim_ros.contact.placing import lift_out_of_world
from snake_sim_ros.contact.problem import ContactHistory, make_contact_history
from snake_sim_ros.dynamics.compilation import inlined
from snake_sim_ros.dynamics.joint_control import ControlMemory, make_control_memory
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.obstacles import contact_count, same_contacts
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.posture import initial_coordinates


@dataclass(frozen=True)
class State:
    """
    Coordinates and velocities of all links.

    Attributes
    ----------
    q : ndarray, shape (n, 7)
        Link centers r_G [m, frame I] and Euler parameters p, scalar first.
    u : ndarray, shape (n, 6)
        Velocities v_G [m/s, frame I] and angular velocities omega [rad/s, frame B].

    """

    q: Array
    u: Array

    @property
    def position(self) -> Array:
        """Link centers, shape (n, 3) [m, frame I]."""
        return self.q[:, :3]


def initial_state(scene: Scene) -> State:
    """Return the robot at rest in the initial posture of the scene, beside all solids."""
    q = initial_coordinates(scene)
    if scene.world:
        # As low as the solids let it, and from there as high as the start says.
        q[:, 2] -= scene.start.height
        q[:, 2] += scene.start.height + lift_out_of_world(scene, q)
    return State(q, np.zeros((scene.robot.link_count, 6)))


T = TypeVar('T')


class Memory(Protocol):
    """What a method keeps of the last step at its level: a NamedTuple of arrays."""

    def last_span(self) -> float:
        """Return the time for which the last impulses acted [s], 0 before the first step."""
        ...


class History(NamedTuple):
    """
    What a step takes from the step before it, besides the state.

    Attributes
    ----------
    impulse : ndarray, shape (contacts, 5)
        Impulses P of the last step [N s], eq. (93), with the components of `contact.problem`.
    velocity : ndarray, shape (contacts, 5)
        Relative velocities after that step [m/s].
    change : ndarray, shape (contacts, 5)
        Change of the normal impulse in that step [N s], and of the other velocities [m/s].
    settling : ndarray, shape (1,)
        Steps for which the robot must yet lie flat and still before it is planar; see `levels`.
    control : ControlMemory
        What the control loop of the robot keeps; see `dynamics.joint_control`.
    memory : NamedTuple of arrays, or None
        What the method keeps at its level, in a type of its own; None if it keeps nothing.

    """

    impulse: Array
    velocity: Array
    change: Array
    settling: Array
    control: ControlMemory
    memory: Any = None


@inlined
def of_contacts(history: History) -> ContactHistory:
    """Return the part of a history that contact solvers take, whatever the method is."""
    return ContactHistory(history.impulse, history.velocity, history.change)


def empty_history(scene: Scene, memory: Memory | None = None) -> History:
    """Return the history before the first step of a scene."""
    contacts = make_contact_history(contact_count(scene))
    return History(*contacts, np.zeros(1), make_control_memory(scene), memory)


def named_arrays(record: Any, name: str = 'history') -> dict[str, Array]:
    """Return the arrays of nested NamedTuples, such as a history, by their dotted names."""
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


def with_arrays(record: T, arrays: Mapping[str, Array], name: str = 'history') -> T:
    """Return nested NamedTuples such as `record` with arrays of dotted names for theirs."""
    found: Any = record
    if isinstance(record, np.ndarray):
        found = arrays[name]
    elif record is not None:
        parts: Any = record
        pairs = zip(parts._fields, parts, strict=True)
        found = type(record)(*(with_arrays(part, arrays, f'{name}.{key}') for key, part in pairs))
    return cast(T, found)


def is_finite(record: Any) -> bool:
    """Return whether all numbers in nested NamedTuples of arrays are finite."""
    if isinstance(record, np.ndarray):
        # The sum of squares is finite only if all numbers are; it may overflow where they are.
        return math.isfinite(np.vdot(record, record)) or bool(np.isfinite(record).all())
    return not isinstance(record, tuple) or all(map(is_finite, record))


def check_state(links: int, contacts: int, state: State, history: History) -> None:
    """
    Check the result of a step; `links` and `contacts` are the numbers of them in its scene.

    Raises
    ------
    ParameterError
        If an array has another shape or type than a `base.Stepper` takes, or if the coordinates or
        the history are not finite. Velocities may be infinite: the next step then diverges.

    """
    _check_array('state.q', state.q, (links, 7))
    _check_array('state.u', state.u, (links, 6))
    if not isinstance(history, History):
        raise ParameterError(f'history must be a History, got {type(history).__name__}')
    for name in ('impulse', 'velocity', 'change'):
        _check_array(f'history.{name}', getattr(history, name), (contacts, 5))
    _check_array('history.settling', history.settling, (1,))
    if not (is_finite(state.q) and is_finite(history)):
        _refuse_what_is_not_finite({'state.q': state.q, **named_arrays(history)})


def check_history(links: int, empty: History, state: State, history: History) -> None:
    """
    Check what a stepper continues from; `links` and `empty` are those of the stepper.

    Raises
    ------
    ParameterError
        As `check_state`, and if the memory of the history is that of another method or level.

    """
    check_state(links, len(empty.impulse), state, history)
    _check_memory('history.control', history.control, empty.control)
    _check_memory('history.memory', history.memory, empty.memory)


class Returned:
    """
    What a stepper returned last, which it need not check when it is passed back.

    Parameters
    ----------
    links : int
    empty : History
        Its empty history, as of `check_history`.

    """

    def __init__(self, links: int, empty: History) -> None:
        self.links, self.empty = links, empty
        self.last: tuple[Any, Any] = None, None
        self.begun: History | None = None

    def empty_history(self) -> History:
        """Return a copy of the empty history."""
        self.begun = copied(self.empty)
        return self.begun

    def check(self, state: State, history: History, angle: Array, rate: Array) -> None:
        """Check the arguments of `base.Stepper.advance`, as it raises errors."""
        is_known = self.last[0] is state and self.last[1] is history
        if is_known and is_finite(state.q) and is_finite(state.u):
            pass
        elif history is self.begun:
            check_state(self.links, len(self.empty.impulse), state, history)
        else:
            check_history(self.links, self.empty, state, history)
        check_references(self.links, angle, rate)


def check_references(links: int, angle: Array, rate: Array) -> None:
    """Raise an error if the references of some steps are not arrays (steps, n-1, 2) of floats."""
    steps = len(angle) if np.ndim(angle) == 3 else 1
    _check_array('angle', angle, (steps, links - 1, 2))
    _check_array('rate', rate, (steps, links - 1, 2))


def _check_array(name: str, array: Any, shape: tuple[int, ...]) -> None:
    """Raise an error if this is not an array of floats of that shape."""
    if isinstance(array, np.ndarray) and array.shape == shape and array.dtype == np.float64:
        return
    got = f'shape {np.shape(array)} of {array.dtype}' if isinstance(array, np.ndarray) else ''
    raise ParameterError(
        f'{name} must be an array of shape {shape} of float64, got {got or type(array).__name__}'
    )


def _check_memory(name: str, memory: Any, wanted: Any) -> None:
    """Raise an error if a memory has other parts than the wanted one, at any depth."""
    if isinstance(wanted, np.ndarray):
        return _check_array(name, memory, wanted.shape)
    if type(memory) is not type(wanted):
        raise ParameterError(
            f'{name} must be that of this method and level, {_name(wanted)}, got {_name(memory)}; '
            f'begin with empty_history() of the stepper, or see carried'
        )
    for part in getattr(wanted, '_fields', ()):
        _check_memory(f'{name}.{part}', getattr(memory, part), getattr(wanted, part))
    return None


def _name(memory: Any) -> str:
    """Return the name of the type of a memory."""
    return 'None' if memory is None else type(memory).__name__


def _refuse_what_is_not_finite(arrays: dict[str, Array]) -> None:
    """Raise an error with the name and place of the first number that is not finite, if any."""
    for name, array in arrays.items():
        if not np.isfinite(array).all():
            place = np.argwhere(~np.isfinite(array))[0].tolist()
            raise ParameterError(f'{name} must be finite, got {array[tuple(place)]} at {place}')


def carried(
    history: History, before: Scene, after: Scene, scale: float, empty: History
) -> History:
    """
    Return the history for the steps of a scene after those of another scene.

    Contacts of both scenes keep their impulses and velocities. Those that are new have not touched
    yet. The memory is empty, since differences over two steps mean nothing where forces jump.

    Parameters
    ----------
    history : History
        From the last step of the scene `before`; it is not changed.
    before, after : Scene
        Scenes with the same robot and time step.
    scale : float
        Time step over the time for which the last impulses acted; it scales them to a whole step.
    empty : History
        Empty history of the stepper of the scene `after`.

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
    if before.robot == after.robot:
        taken = taken._replace(control=copied(history.control))
    return taken
