# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The table of time stepping methods. A new method is an entry here, and a module."""

from collections.abc import Callable, Container, Mapping
from dataclasses import replace

from snake_sim_ros.contact.delassus import Delassus, make_delassus
from snake_sim_ros.contact.newton import Newton
from snake_sim_ros.contact.problem import Solver
from snake_sim_ros.contact.prox_iteration import MOST_CONDENSED_ROWS, ProxIteration
from snake_sim_ros.dynamics.records import Loop
from snake_sim_ros.scene.checked_records import ParameterError, quoted
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping import levels
from snake_sim_ros.stepping.accuracy import USUAL_ACCURACY, with_accuracy
from snake_sim_ros.stepping.base import Method, Stepper
from snake_sim_ros.stepping.bdf2 import step as bdf2
from snake_sim_ros.stepping.bdf2.motion import make_arrays, make_memory
from snake_sim_ros.stepping.moreau import Moreau, where_impulses_acted
from snake_sim_ros.stepping.planar import bdf2 as planar_bdf2
from snake_sim_ros.stepping.planar.moreau import PlanarMoreau
from snake_sim_ros.stepping.planar.solvers import PlanarNewton, PlanarProxIteration
from snake_sim_ros.stepping.planar.stepper import PlanarStepper
from snake_sim_ros.stepping.spatial import SpatialStepper
from snake_sim_ros.stepping.state import History
from snake_sim_ros.stepping.steps import advance

Make = Callable[[Scene], Solver]  # a contact solver for a scene


def paper_method(
    solver: Make, in_plane: Make | None = None, *, planar_pegs: bool = False
) -> Method:
    """
    Return the method that takes the paper's step with a contact solver.

    Parameters
    ----------
    solver : callable
        Makes the solver of a scene in space; see `contact.problem.solve_contacts`.
    in_plane : callable, optional
        Makes that of the planar level; None: the method has no planar level.
    planar_pegs : bool, optional
        Whether it solves contacts with pegs in the plane.

    """

    def spatial(scene: Scene) -> SpatialStepper:
        return SpatialStepper(scene, Loop(advance, Moreau(solver(scene))))

    def planar(scene: Scene) -> PlanarStepper:
        assert in_plane
        return PlanarStepper(scene, Loop(advance, PlanarMoreau(in_plane(scene))))

    return Method(
        spatial=spatial,
        planar=planar if in_plane else None,
        where_impulses_acted=where_impulses_acted,
        planar_pegs=planar_pegs,
    )


def _small_delassus(scene: Scene) -> Delassus:
    return make_delassus(MOST_CONDENSED_ROWS, scene.robot.link_count)


def _spatial_bdf2(scene: Scene) -> SpatialStepper:
    n = scene.robot.link_count
    own = make_arrays(n, contact_count(scene))
    return SpatialStepper(scene, Loop(advance, own), make_memory(n))


def _planar_bdf2(scene: Scene) -> PlanarStepper:
    n = scene.robot.link_count
    own = planar_bdf2.make_planar_arrays(n, contact_count(scene))
    return PlanarStepper(scene, Loop(advance, own), planar_bdf2.make_planar_bdf2_memory(n))


METHODS: dict[str, Method] = {
    # Semismooth Newton iteration through the chain of links.
    'newton': paper_method(
        lambda scene: Newton(None), lambda scene: PlanarNewton(), planar_pegs=True
    ),
    # The same solver in a method of second order, for large steps.
    'bdf2': Method(
        spatial=_spatial_bdf2,
        planar=_planar_bdf2,
        where_impulses_acted=bdf2.where_impulses_acted,
        what_is_not_possible=bdf2.what_is_not_possible,
        energy_balance=False,
    ),
    # The paper's iteration: projections of all contacts at once.
    'paper': paper_method(
        lambda scene: ProxIteration(_small_delassus(scene)), lambda scene: PlanarProxIteration()
    ),
}

AUTO = 'auto'  # the method that docs/speed_accuracy.md finds best for the time step
LARGE_STEP = 1e-3  # above it, a method of second order is chosen [s]
STEPPING = ('dt', 'method', 'level')  # with one of these, a user decides how a scene is run
USUAL_SCENE = Scene()


def method_of(scene: Scene) -> str:
    """
    Return the name of the method for a scene: the one that it names, or the choice of `auto`.

    `auto` chooses a method that can run the scene: `bdf2` has no explicit joint control. Only
    `bdf2` divides steps, so that `auto` takes it for a scene with an accuracy.

    Raises
    ------
    ParameterError
        If the scene names no method of METHODS.

    """
    if scene.method == AUTO:
        large = scene.dt > LARGE_STEP and not METHODS['bdf2'].what_is_not_possible(scene)
        return 'bdf2' if large or scene.accuracy > 0.0 else 'newton'
    if scene.method not in METHODS:
        names = ', '.join(sorted([AUTO, *METHODS]))
        raise ParameterError(f'unknown method {quoted(scene.method)}; choose from: {names}')
    return scene.method


def with_usual_steps(
    scene: Scene, given: Container[str], period: float | Mapping[str, float]
) -> Scene:
    """
    Return a scene with the steps that its accuracy needs, if it has one.

    It has the usual accuracy if neither an accuracy nor one of STEPPING is given or differs from
    its default, and if the method for it can run the scene.

    Parameters
    ----------
    scene : Scene
    given : container of str
        Dotted names of the values that a user gave beside the file of the scene.
    period : float or mapping
        Time between two samples [s], or more that steps divide; see `with_accuracy`.

    Raises
    ------
    ParameterError
        If the accuracy or the period is not usable.

    """
    accuracy = scene.accuracy
    is_free = all(
        name not in given and getattr(scene, name) == getattr(USUAL_SCENE, name)
        for name in STEPPING
    )
    if 'accuracy' not in given and is_free and not bdf2.what_is_not_possible(scene):
        accuracy = accuracy or USUAL_ACCURACY
    return with_accuracy(scene, accuracy, period, given) if accuracy else scene


def what_is_not_planar(scene: Scene) -> str:
    """Return the first reason why a scene is not planar, as a clause; empty if it is."""
    return levels.what_is_not_planar(scene, method_of(scene), METHODS[method_of(scene)])


def make_stepper(scene: Scene) -> Stepper:
    """
    Return the stepper for the method and the level of a scene.

    Raises
    ------
    ParameterError
        If the scene names no method or one that cannot run it, if its level is planar and the
        scene is not, or if there is not enough memory.

    """
    name = method_of(scene)
    method = METHODS[name]
    if scene.accuracy > 0.0 and name != 'bdf2':
        raise ParameterError(
            f'accuracy {scene.accuracy:g} needs method bdf2, which divides steps, or auto; got '
            f'method {name}'
        )
    if reason := method.what_is_not_possible(scene):
        raise ParameterError(reason)
    named = scene if scene.method == name else replace(scene, method=name)
    try:
        return levels.stepper_of_level(named, method)
    except MemoryError:
        raise ParameterError(
            f'method {name} needs more memory than there is for the {contact_count(scene)} '
            f'contacts that this scene can have'
        ) from None


def empty_history(scene: Scene) -> History:
    """Return the history before the first step of a scene; see `base.Stepper`."""
    return make_stepper(scene).empty_history()
