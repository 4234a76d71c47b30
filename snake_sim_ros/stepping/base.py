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
from typing import Protocol

import numpy as np

from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.state import History
from snake_sim_ros.stepping.state import State


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
