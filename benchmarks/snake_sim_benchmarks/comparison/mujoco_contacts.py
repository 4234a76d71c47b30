# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contacts and solver settings of MuJoCo: its own, two sets found by hand, and those of a search.

The search went through 9256 settings with the integrator `discrete`, springs as drives, islands
off and the tree rooted at the middle link. The settings that it found are named after a case and
an error: A 3 % was the fastest one in case A whose worst error was at most 3 % in seven runs: as
given, with time steps 20 % shorter and longer, and with friction and yaw amplitude 2 % smaller and
larger (see `families.neighbors`).

`A soft` and `A less soft` are of another search, by root mean squares over perturbed scenes, for
errors between those of A 2 % and A 1 %: 1.0 and 0.9 % over 8 scenes, at some 440 and 390 times
real time.

Most of those for A and D have `impratio` 1e-4. This is the regularized friction that MuJoCo has
itself: the friction of a contact is then so soft that it grows in proportion to the slip, up to
the cone, and is solved implicitly together with the joints. A friction law of another shape, such
as tanh, would have to be a passive force from a callback. MuJoCo does not know the derivative of
such a force and takes it from the start of the step, which needs small steps.
"""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class ContactModel:
    """
    Contacts and solver of MuJoCo; None stands for MuJoCo's own value.

    Attributes
    ----------
    solver : str or None
    iterations, ls_iterations : int or None
        Limits of the iterations of the solver, and of its line search.
    tolerance : float or None
        At which the solver stops.
    cone : str or None
        `elliptic` or `pyramidal`; None for the one of `MujocoSettings`.
    impratio : float or None
        How much harder friction is than the normal force.
    time_constant : float or None
        In which penetration decays [s].
    time_steps : float or None
        The same in time steps, where there is no `time_constant`.
    solimp : tuple of float or None
        Impedance at the surface and inside, and the depth between the two [m].
    noslip_iterations : int or None
        Iterations that solve friction again without softness.
    jacobian : str or None
        `dense` or `sparse`; by itself MuJoCo takes dense ones below 60 degrees of freedom. With
        its own contacts sparse ones are faster from 20 links on (6 times at 80), with the chosen
        ones dense ones are (up to 4 times at 80).
    refsafe, islands : bool
        Whether MuJoCo lengthens short time constants, and whether it looks for islands.
    lead : str
        `mid` or `end`: the time of a step at which it gets the joint references.

    """

    solver: str | None = None
    iterations: int | None = None
    ls_iterations: int | None = None
    tolerance: float | None = None
    cone: str | None = None
    impratio: float | None = None
    time_constant: float | None = None
    time_steps: float | None = None
    solimp: tuple[float, float, float] | None = None
    noslip_iterations: int | None = None
    jacobian: str | None = None
    refsafe: bool = True
    islands: bool = True
    lead: str = 'mid'

    def options(self, cone: str) -> dict[str, Any]:
        """Return attributes of MuJoCo's options, with this cone if the model has none."""
        names = ('solver', 'iterations', 'ls_iterations', 'tolerance', 'impratio',
                 'noslip_iterations', 'jacobian')  # fmt: skip
        found = {name: getattr(self, name) for name in names}
        given = {name: value for name, value in found.items() if value is not None}
        return {'cone': self.cone or cone, **given}

    def flags(self) -> dict[str, str]:
        """Return the flags of MuJoCo that are not its own."""
        on = {'refsafe': self.refsafe, 'island': self.islands}
        return {name: 'disable' for name, value in on.items() if not value}

    def pair(self, dt: float, shortest: float) -> dict[str, Any]:
        """
        Return attributes of a contact pair.

        Parameters
        ----------
        dt : float
            Time step [s].
        shortest : float
            Shortest time constant, in time steps, that MuJoCo accepts for its integrator.

        """
        found: dict[str, Any] = {}
        if self.time_constant is not None:
            found['solref'] = (self.time_constant, 1)
        elif self.time_steps is not None:
            found['solref'] = (max(self.time_steps, shortest) * dt, 1)
        return found if self.solimp is None else {**found, 'solimp': self.solimp}


@dataclass(frozen=True)
class SearchedModel:
    """A contact model of the search, with the case and the steps a second it was found for."""

    case: str
    rate: float
    model: ContactModel


# By trying some hundred settings on cases A, B and C with 60 to 4000 steps a second. The cone of
# MuJoCo lifts sliding contacts, so that the load moves to contacts that slide less. `fast` accepts
# this: in case A its error rises and falls with the step by chance, and in case B it is large.
# `accurate` does not lift: its errors decrease slowly with the step in cases A and B, and stay at
# 1 % in case C.
_HARD: dict[str, Any] = {
    'solver': 'PGS',
    'iterations': 5,
    'tolerance': 1e-5,
    'time_steps': 1.0,
    'jacobian': 'dense',
}
# Soft at the surface, which spreads the load, and hard from a depth of 0.1 mm on.
_SOFT_SURFACE = (0.1, 0.99, 1e-4)
BY_HAND: dict[str, ContactModel] = {
    'default': ContactModel(),
    # Friction is so soft that it does not affect the normal forces, which therefore do not lift.
    # Then friction is solved again without softness, within the cones of these forces.
    'accurate': ContactModel(**_HARD, solimp=_SOFT_SURFACE, impratio=1e-4, noslip_iterations=3),
    # Friction is harder than the normal force, which makes creep smaller by the same factor.
    'fast': ContactModel(**_HARD, solimp=_SOFT_SURFACE, impratio=30.0),
}
CASES = {'A': 'lateral_undulation', 'C': 'sidewinding', 'D': 'sinus_lifting'}
_USUAL = (0.9, 0.95, 1e-4)
# Case and bound; steps a second; solver, its iterations, those of the line search, tolerance;
# cone; impratio; time constant [s] or in steps; solimp; noslip iterations; lead; refsafe.
_FOUND: tuple[tuple[Any, ...], ...] = (
    ('A 3 %', 20, ('Newton', 3, 5, 1e-3), 'elliptic', 1e-4, 0.02, _USUAL, 0, 'mid', False),
    ('A 2 %', 20, ('Newton', 100, 5, 1e-5), 'pyramidal', 1e-4, 0.02, _USUAL, 0, 'end', False),
    ('A 1 %', 200, ('PGS', 3, 50, 1e-5), 'elliptic', 1e-4, '2', (0.99, 0.999, 1e-4), 0, 'end',
     True),
    ('A soft', 40, ('Newton', 3, 5, 1e-5), 'elliptic', 1e-4, 0.01, _USUAL, 0, 'end', False),
    ('A less soft', 120, ('PGS', 3, 5, 1e-5), 'elliptic', 1e-4, 0.0025, _USUAL, 0, 'mid', False),
    ('C 5 %', 30, ('PGS', 2, 50, 1e-8), 'elliptic', 1, 0.01, (0.9, 0.95, 1e-3), 0, 'end', True),
    ('C 3 %', 30, ('PGS', 5, 50, 1e-5), 'elliptic', 10, 0.01, (0.9, 0.95, 1e-3), 0, 'end', True),
    ('C 2 %', 30, ('PGS', 10, 50, 1e-3), 'elliptic', 1, 0.01, _SOFT_SURFACE, 0, 'end', True),
    # The same at 70 steps a second was the fastest one at 1.5 %.
    ('C 1 %', 120, ('PGS', 5, 5, 1e-5), 'elliptic', 30, '1', (0.95, 0.99, 1e-4), 0, 'end', False),
    ('C 0.7 %', 200, ('PGS', 10, 5, 1e-3), 'elliptic', 1, '3', _SOFT_SURFACE, 0, 'mid', False),
    ('C 0.5 %', 1000, ('PGS', 30, 5, 1e-3), 'elliptic', 1, 0.002, (0.9, 0.99, 1e-3), 0, 'end',
     True),
    ('D 5 %', 20, ('CG', 10, 5, 1e-4), 'elliptic', 1e-4, '1', (0.9, 0.99, 1e-3), 0, 'mid', True),
    ('D 2 %', 35, ('Newton', 2, 50, 1e-8), 'elliptic', 1e-4, 0.02, _USUAL, 0, 'mid', False),
    ('D 1 %', 250, ('PGS', 1, 50, 1e-4), 'elliptic', 1e-4, 0.002, (0.95, 0.99, 1e-4), 3, 'mid',
     True),
    ('D 0.5 %', 400, ('PGS', 1, 5, 1e-8), 'elliptic', 1e-4, 0.005, (0.99, 0.999, 1e-4), 3, 'mid',
     True),
)  # fmt: skip


def _searched(numbers: tuple[Any, ...]) -> SearchedModel:
    name, rate, solver, cone, impratio, time, solimp, noslip, lead, refsafe = numbers
    in_steps = isinstance(time, str)
    model = ContactModel(
        solver=solver[0], iterations=solver[1], ls_iterations=solver[2], tolerance=solver[3],
        cone=cone, impratio=impratio, solimp=solimp, noslip_iterations=noslip, lead=lead,
        time_constant=None if in_steps else time, time_steps=float(time) if in_steps else None,
        refsafe=refsafe, islands=False, jacobian='dense',
    )  # fmt: skip
    return SearchedModel(CASES[name[0]], float(rate), model)


SEARCHED = {numbers[0]: _searched(numbers) for numbers in _FOUND}
CONTACT_MODELS = {**BY_HAND, **{name: found.model for name, found in SEARCHED.items()}}


def searched_for(case: str) -> dict[str, SearchedModel]:
    """Return the settings that were found for a case; all of them for a case without a search."""
    own = {name: found for name, found in SEARCHED.items() if found.case == case}
    return own or SEARCHED
