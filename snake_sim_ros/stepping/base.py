# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What a time stepper takes and returns.

A stepper is made for a scene. If a step does not converge, or diverges, its `advance` says so in
the report and raises no error. Only misuse raises one.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple, Protocol, TYPE_CHECKING

import numpy as np

from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.stepping.pushes import NO_PUSHES, PushTable
from snake_sim_ros.stepping.samples import Samples
from snake_sim_ros.stepping.state import History, State

if TYPE_CHECKING:
    from snake_sim_ros.stepping.loops import StepsInPlace
    from snake_sim_ros.stepping.planar.stepper import PlanarStepper
    from snake_sim_ros.stepping.spatial import SpatialStepper


class Status(Enum):
    """How the steps of a call went."""

    CONVERGED = 'converged'
    MAX_ITERATIONS = 'max_iterations'
    DIVERGED = 'diverged'


@dataclass
class Report:
    """
    What happened in some steps. The sum of two reports is the report of all their steps.

    Attributes
    ----------
    steps, iterations, unconverged, fallbacks : int
        Steps done, contact iterations in all of them, steps that reached the iteration limit,
        steps in which the solver needed a slower method.
    iterations_max : int
        Most iterations in one step.
    residual_max, printed_residual_max : float
        Largest natural-map residual of the contact laws after a step, with the selection rule and
        as the paper prints them [m/s]: the distances of the impulses from the projections
        (87)-(89), over the prox parameters. For orthotropic friction they are upper bounds.
    penetration_max : float
        Largest penetration after a step [m].
    joint_gap_max, joint_twist_max : float
        Largest joint violation g_J in position [m] and angle [1] that a step made, before the
        drift correction of section VII-C removed it.
    further_parts : int
        Parts of the steps beyond one for each, where the method divides steps.
    contacts : int
        Contacts closed in the last step.
    overflows : int
        Steps in which a link touched a world in more places than it has contacts for, 6 a sphere
        and 4 the interior of a capsule; those with the smallest gaps count.
    joint_torque : ndarray, shape (n-1, 2)
        Torque (yaw, pitch) of the last step [N m].
    level : str
        Model level of the last step, `spatial` or `planar`.
    planar_steps : int
        How many of the steps were planar.
    left : str
        Why the planar level was left; empty if it was not.
    failure : str
        The sentence that says what diverged, when and where; empty if nothing did.

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
    further_parts: int = 0
    contacts: int = 0
    overflows: int = 0
    joint_torque: Array = field(default_factory=lambda: np.zeros((0, 2)))
    level: str = 'spatial'
    planar_steps: int = 0
    left: str = ''
    failure: str = ''

    @property
    def parts(self) -> int:
        """Number of internal steps: the parts of all steps."""
        return self.steps + self.further_parts

    @property
    def status(self) -> Status:
        """The worst status of any of the steps."""
        if self.failure:
            return Status.DIVERGED
        return Status.MAX_ITERATIONS if self.unconverged else Status.CONVERGED

    def __add__(self, later: 'Report') -> 'Report':
        """Return the report of these steps and of `later` ones."""
        return Report(
            self.steps + later.steps,
            self.iterations + later.iterations,
            max(self.iterations_max, later.iterations_max),
            self.unconverged + later.unconverged,
            self.fallbacks + later.fallbacks,
            max(self.residual_max, later.residual_max),
            max(self.printed_residual_max, later.printed_residual_max),
            max(self.penetration_max, later.penetration_max),
            max(self.joint_gap_max, later.joint_gap_max),
            max(self.joint_twist_max, later.joint_twist_max),
            self.further_parts + later.further_parts,
            later.contacts,
            self.overflows + later.overflows,
            later.joint_torque,
            later.level,
            self.planar_steps + later.planar_steps,
            later.left,
            self.failure or later.failure,
        )


def divergence(link: int, turn: float, dt: float) -> str:
    """Return the failure of a step [s] in which a link, counted from 1, turns too far [rad]."""
    return (
        f'link {link} would turn by {turn:.3g} rad in one step of {dt:g} s; less than pi/2 is '
        f'resolved'
    )


class Inputs(NamedTuple):
    """What steps take beside state and history, checked; see `Stepper.advance`."""

    angle: Array  # (m, n-1, 2) joint references [rad]
    rate: Array  # (m, n-1, 2) [rad/s]
    samples: Samples  # that the steps fill
    pushes: PushTable  # in these steps


class Stepper(Protocol):
    """
    A method that advances a scene in time.

    Attributes
    ----------
    level : str
        Model level of the last step.
    cycles : ndarray, shape (steps+1,)
        Time stamps before and after every step of the last call; empty without a compiled loop.

    """

    level: str

    @property
    def cycles(self) -> Array: ...  # noqa: D102

    def empty_history(self) -> History:
        """Return the history before the first step."""
        ...

    def advance(
        self, state: State, history: History, angle: Array, rate: Array,
        samples: Samples | None = None, pushes: PushTable = NO_PUSHES,
    ) -> tuple[State, History, Report]:  # fmt: skip
        """
        Return state, history and report after as many steps as there are references.

        Parameters
        ----------
        state : State
        history : History
            From the last step of this stepper. Before the first step it is `empty_history`, and
            after a step of another scene, method or level `state.carried`. It is not changed.
        angle, rate : ndarray, shape (steps, n-1, 2)
            Joint references [rad], [rad/s] at the middle of every step.
        samples : Samples, optional
            Filled with the samples that the steps reach.
        pushes : PushTable, optional
            What pushes the robot in these steps.

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
            If an array has a wrong shape or type, since compiled code does not check where it
            writes; if coordinates or history are not finite; or if the memory is that of another
            method or level.

        """
        ...

    def limit_iterations(self, limit: int) -> None:
        """Let a step take that many contact iterations at most."""
        ...

    def in_place(
        self, count: int, state: State, history: History, pushes: PushTable, every: int = 0
    ) -> 'StepsInPlace | None':
        """
        Return calls of some steps that continue the last one; None if there are none.

        They keep a sample after `every` steps, which divides `count`; none if it is 0.
        """
        ...


def _everything(scene: Scene) -> str:
    return ''


@dataclass(frozen=True)
class Method:
    """
    A time stepping method: how its steppers are made, and which scenes it can run.

    Attributes
    ----------
    spatial, planar : callable
        Make the stepper of a scene, as `spatial.SpatialStepper` and `planar.stepper.PlanarStepper`
        do. The method has no planar level if `planar` is None.
    where_impulses_acted : callable
        ``where_impulses_acted(scene, q, u)`` returns the coordinates (m, n, 7) at which the
        impulses acted in the steps before m states, with their q (m, n, 7) and u (m, n, 6).
    what_is_not_possible : callable
        Returns why the method cannot run a scene, as a sentence; empty if it can.
    planar_pegs : bool
        Whether the planar level has contacts with pegs.
    energy_balance : bool
        Whether impulses are those of a whole step, as an energy balance needs them.

    """

    spatial: Callable[[Scene], 'SpatialStepper']
    planar: Callable[[Scene], 'PlanarStepper'] | None
    where_impulses_acted: Callable[[Scene, Array, Array], Array]
    what_is_not_possible: Callable[[Scene], str] = _everything
    planar_pegs: bool = False
    energy_balance: bool = True
