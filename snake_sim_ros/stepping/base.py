"""
What a time stepper takes and returns, and the table of those that exist.

A stepper is made for a scene and has one method, `advance`. It never raises because a step did not
converge or blew up: that is part of the report. Only misuse raises.
"""

from collections.abc import Callable
from dataclasses import dataclass
from dataclasses import field
from dataclasses import fields
from dataclasses import replace
from enum import Enum
from functools import partial
from typing import Any
from typing import Protocol

import numpy as np

from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.obstacles import same_contacts
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.posture import initial_coordinates
from snake_sim_ros.scene.quantities import ParameterError


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

    def advance(
        self, state: State, history: Array, angle: Array, rate: Array
    ) -> tuple[State, Array, Report]:
        """
        Return state, history and report after as many steps as there are references.

        Parameters
        ----------
        state : State
        history : ndarray, shape (7, contacts, 5)
            What a step takes over from the one before. Of every contact: IMPULSE, the last one
            (normal, sliding x y, rolling x y) [N s], eq. (93); VELOCITY, relative velocities after
            it [m/s]; CHANGE, by how much the last step changed the normal impulse and the other
            velocities. From PREVIOUS on, in a row: what a method of two steps keeps. `no_history`
            before the first step; `carried` where the step before was one of a scene with other
            contacts, another method or another level.
        angle, rate : ndarray, shape (steps, n-1, 2)
            Joint references [rad], [rad/s] at the middle of every step.

        Returns
        -------
        state : State
            The last good state if a step diverged.
        history : ndarray, shape (7, contacts, 5)
        report : Report

        Raises
        ------
        ParameterError
            If an array has not the shape or the type of number that it must have: compiled code
            does not look where it writes. If coordinates or history are not finite.

        """
        ...


IMPULSE, VELOCITY, CHANGE, PREVIOUS = range(4)
SLABS = 7  # of history, with room for what a method of two steps keeps
SETTLING = (-1, -1, -1)  # in history: steps that a robot still has to lie flat and still


def check_state(links: int, contacts: int, state: State, history: Array) -> None:
    """
    Check what a stepper goes on from; `links` and `contacts` are those of its scene.

    Raises
    ------
    ParameterError
        If an array has another shape or other numbers than a `Stepper` takes, or the coordinates
        or the history are not finite. Velocities that are not are a step that diverged.

    """
    _check_array('state.q', state.q, (links, 7))
    _check_array('state.u', state.u, (links, 6))
    _check_array('history', history, (SLABS, contacts, 5))
    for name, array in (('state.q', state.q), ('history', history)):
        if not np.isfinite(array).all():
            place = np.argwhere(~np.isfinite(array))[0].tolist()
            raise ParameterError(f'{name} must be finite, got {array[tuple(place)]} at {place}')


def check_arguments(
    links: int, contacts: int, state: State, history: Array, angle: Array, rate: Array
) -> None:
    """
    Check all that `Stepper.advance` takes; `links` and `contacts` are those of its scene.

    Raises
    ------
    ParameterError
        If an array has another shape or other numbers than a `Stepper` takes.

    """
    check_state(links, contacts, state, history)
    steps = len(angle) if np.ndim(angle) else 0
    _check_array('angle', angle, (steps, links - 1, 2))
    _check_array('rate', rate, (steps, links - 1, 2))


def _check_array(name: str, array: Any, shape: tuple[int, ...]) -> None:
    """Raise if this is not an array of floats of a shape."""
    if isinstance(array, np.ndarray) and array.shape == shape and array.dtype == np.float64:
        return
    got = f'shape {np.shape(array)} of {array.dtype}' if isinstance(array, np.ndarray) else ''
    raise ParameterError(
        f'{name} must be an array of shape {shape} of float64, got {got or type(array).__name__}'
    )


def _planar(scene: Scene, loop: Callable[..., None]) -> Stepper:
    from snake_sim_ros.stepping.planar.stepper import PlanarStepper

    return PlanarStepper(scene, loop)


def _spatial(scene: Scene, loop: Callable[..., None]) -> Stepper:
    from snake_sim_ros.stepping.spatial import SpatialStepper

    return SpatialStepper(scene, loop)


def _with_delassus(loop: Callable[..., None], size: int) -> Callable[..., None]:
    """Return a loop with the Delassus operator that it forms, of so many rows; None for 0."""
    from snake_sim_ros.contact.delassus import make_delassus

    return partial(loop, make_delassus(size))


def _newton(scene: Scene, level: str = 'spatial', size: int = 0) -> Stepper:
    if level == 'planar':
        from snake_sim_ros.stepping.planar import newton as planar_newton

        return _planar(scene, _with_delassus(planar_newton.advance, size))
    from snake_sim_ros.contact import newton

    return _spatial(scene, _with_delassus(newton.advance, size))


def _newton_dense(scene: Scene, level: str = 'spatial') -> Stepper:
    return _newton(scene, level, 5 * contact_count(scene))


def _bdf2(scene: Scene, level: str = 'spatial') -> Stepper:
    if scene.pd_scheme not in IMPLICIT_SCHEMES:
        raise ParameterError(
            f'pd_scheme {scene.pd_scheme} is explicit, and method bdf2 takes the controller at '
            f'the end of a step; choose pd_scheme {" or ".join(IMPLICIT_SCHEMES)}, or method '
            f'newton'
        )
    if level == 'planar':
        from snake_sim_ros.stepping.planar import bdf2 as planar_bdf2

        return _planar(scene, planar_bdf2.advance)
    from snake_sim_ros.stepping import bdf2

    return _spatial(scene, bdf2.advance)


def _gauss_seidel(scene: Scene, level: str = 'spatial') -> Stepper:
    from snake_sim_ros.contact import gauss_seidel

    size = 5 * contact_count(scene)
    if level == 'planar':
        return _planar(scene, _with_delassus(gauss_seidel.advance_in_plane, size))
    return _spatial(scene, _with_delassus(gauss_seidel.advance, size))


def _paper(scene: Scene, level: str = 'spatial') -> Stepper:
    from snake_sim_ros.contact import prox_iteration

    if level == 'planar':
        return _planar(scene, prox_iteration.advance_in_plane)
    return _spatial(scene, _with_delassus(prox_iteration.advance, prox_iteration.CONDENSED))


def _reference(scene: Scene, level: str = 'spatial') -> Stepper:
    if level == 'planar':
        from snake_sim_ros.stepping.planar.reference import make_loop

        return _planar(scene, make_loop(scene))
    from snake_sim_ros.stepping.reference import ReferenceStepper

    return ReferenceStepper(scene)


METHODS: dict[str, Callable[..., Stepper]] = {
    'newton': _newton,  # semismooth Newton through the chain of links
    'bdf2': _bdf2,  # the same solver in a step of second order, for large steps
    'newton_dense': _newton_dense,  # the same on the Delassus operator
    'gauss_seidel': _gauss_seidel,  # projections, one contact after the other
    'paper': _paper,  # the paper's iteration: projections of all contacts at once
    'reference': _reference,  # the same in dense NumPy, to read beside the paper
}


AUTO = 'auto'  # in place of a method: the one that docs/speed_accuracy.md finds best for the step
LARGE_STEP = 1e-3  # s; above it, a method of second order
# Where the controller may act in a method of second order. It has a law of its own for both: all
# at the end of the step, linear about the end that is predicted.
IMPLICIT_SCHEMES = ('average', 'end')


def method_of(scene: Scene) -> str:
    """
    Return the method that a scene gets: the one that it names, or the choice of `auto`.

    The choice can do what the scene asks for: `bdf2` has no explicit joint control.

    Raises
    ------
    ParameterError
        If the scene names no method of METHODS.

    """
    if scene.method == AUTO:
        large = scene.dt > LARGE_STEP and scene.pd_scheme in IMPLICIT_SCHEMES
        return 'bdf2' if large else 'newton'
    if scene.method not in METHODS:
        names = ', '.join(sorted([AUTO, *METHODS]))
        raise ParameterError(f'unknown method {scene.method!r}; choose from: {names}')
    return scene.method


def make_stepper(scene: Scene) -> Stepper:
    """
    Return the stepper of a scene.

    Raises
    ------
    ParameterError
        If the scene names no method, see `method_of`, or one that cannot do what it asks for.

    """
    from snake_sim_ros.stepping.levels import stepper_of_level

    scene = replace(scene, method=method_of(scene))
    return stepper_of_level(scene, METHODS[scene.method])


def initial_state(scene: Scene) -> State:
    """Return the robot at rest in the initial posture of the scene."""
    return State(initial_coordinates(scene), np.zeros((scene.robot.link_count, 6)))


def no_history(scene: Scene) -> Array:
    """Return the history before the first contact: zero, shape (7, contacts, 5)."""
    return np.zeros((SLABS, contact_count(scene), 5))


def carried(history: Array, before: Scene, after: Scene, scale: float) -> Array:
    """
    Return what the steps of a scene may take over from those of another one.

    Contacts that both have keep what is known of them, and those that are new have not touched
    yet. A method remembers nothing: what another method, another level or the same with other
    contacts left there would be read as something else, and differences over two steps mean
    nothing where forces jump.

    Parameters
    ----------
    history : ndarray, shape (7, contacts, 5)
        After a step of the scene `before`; left alone.
    before, after : Scene
        Of the same robot and time step.
    scale : float
        Time step over the time in which the last impulses acted: here they are of a whole step.

    Returns
    -------
    ndarray, shape (7, contacts of `after`, 5)

    """
    old, new = same_contacts(before, after)
    taken = no_history(after)
    taken[:PREVIOUS, new] = history[:PREVIOUS, old]
    taken[IMPULSE] *= scale
    taken[CHANGE, :, 0] *= scale
    taken[SETTLING] = history[SETTLING]
    return taken
