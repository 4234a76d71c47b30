# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What is compiled for a level, and which part of it a second process can compile meanwhile.

The contact solver is half of a step, for the compiler too.
"""

from typing import Any

import numpy as np

from snake_sim_ros.contact.admissible import without_gain
from snake_sim_ros.contact.laws import natural_map
from snake_sim_ros.contact.linear_problem import linear_step
from snake_sim_ros.contact.newton import line_search, Newton
from snake_sim_ros.contact.problem import ContactHistory, Outcome, Problem, solve_contacts
from snake_sim_ros.dynamics.compilation import Dispatched, record_type
from snake_sim_ros.dynamics.records import compile_call, made_type, type_of, type_of_record
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.base import Inputs
from snake_sim_ros.stepping.bdf2.motion import Bdf2Arrays
from snake_sim_ros.stepping.bdf2.step import solve_landing, Terms
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.planar.moreau import yaw_axes_change
from snake_sim_ros.stepping.planar.solvers import solve_in_plane
from snake_sim_ros.stepping.pushes import NO_PUSHES
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.steps import LoopReport, make_steps, Steps

OUTCOME_TYPE = type_of_record(Outcome(0, False, 0.0, 0.0, False))
REPORT_TYPE = type_of(np.zeros(1, record_type(LoopReport))).dtype


def one_level(scene: Scene, level: str) -> Any:
    """Return the stepper of one level of a scene."""
    stepper: Any = make_stepper(scene)
    return getattr(stepper, level, stepper)


def function_counts(scene: Scene, level: str) -> dict[str, int]:
    """
    Return how many functions the compiler meets at most in each function for the steps of a level.

    It compiles them once more with each function that they are in.
    """
    stepper = one_level(scene, level)
    found: dict[Any, set[Any]] = {}
    integrator = stepper.loop.first
    _within(stepper.loop.func, {type(integrator), *map(type, integrator)}, found)
    return {function.py_func.__name__: len(inside) for function, inside in found.items()}


def _within(name: Any, classes: set[type], found: dict[Any, set[Any]]) -> set[Any]:
    """
    Return the functions that a name leads to, itself included.

    `classes` choose between implementations. What is in any of them is added to `found`.
    """
    if isinstance(name, Dispatched):
        known = name.implementations
        chosen = [known[cls] for cls in classes if cls in known] or known.values()
        return set().union(*(_within(function, classes, found) for function in chosen))
    if not hasattr(name, 'py_func'):
        return set()
    if name not in found:
        function = name.py_func
        found[name] = {name}  # an attribute may have the name of a function
        for called in function.__code__.co_names:
            found[name] |= _within(function.__globals__.get(called), classes, found)
    return found[name]


def compile_solver(scene: Scene, level: str) -> None:
    """Compile the contact solver as the steps of a level call it."""
    stepper = one_level(scene, level)
    integrator, model, work = stepper.loop.first, type_of(stepper.model), type_of(stepper.work)
    history = type_of_record(ContactHistory(*stepper.empty[:3]))
    if isinstance(integrator, Bdf2Arrays):
        terms = type_of_record(Terms(0.0, 0.0, 0.0, 0))
        rest = _problem(stepper), terms, type_of(_steps(scene, stepper))
        compile_call(solve_landing, model, type_of(integrator), work, *rest)
        return
    solver = type_of(integrator.solver)
    if level == 'planar':
        closed = _contacts(stepper)[1]
        compile_call(solve_in_plane, solver, model, work, closed, history, type_of(1))
    else:
        compile_call(solve_contacts, solver, _problem(stepper), history, type_of(1))


def _steps(scene: Scene, stepper: Any) -> Steps:
    """Return no steps."""
    start, none = initial_state(scene), np.zeros((0, scene.robot.link_count - 1, 2))
    history = stepper.empty_history()
    return make_steps((start.q, start.u), history, (none, none), stepper.no_record)


def _contacts(stepper: Any) -> list[Any]:
    """Return the types of the laws, the closed contacts and all contacts in the steps."""
    laws, work = stepper.model.laws, stepper.work
    # In space the selection rule makes laws of a step from those of the model.
    kind = type_of(laws) if stepper.level == 'planar' else type_of_record(laws)
    return [kind, type_of(work.closed), type_of(work.contacts)]


def _problem(stepper: Any) -> Any:
    """Return the type of the contact problem of the steps in space."""
    return made_type(
        Problem, *_contacts(stepper), type_of(stepper.work.chain), type_of(stepper.work.pairs)
    )


def compile_search(scene: Scene, level: str) -> None:
    """Compile what the other process reaches last: parts of Newton's method, laws of joints."""
    stepper = one_level(scene, level)
    contacts, integrator = _contacts(stepper), stepper.loop.first
    if level == 'planar':
        step = type_of(stepper.model), type_of(stepper.work), OUTCOME_TYPE, type_of(1), type_of(1)
        compile_call(yaw_axes_change, *step, REPORT_TYPE)
    elif isinstance(integrator, Bdf2Arrays) or isinstance(integrator.solver, Newton):
        is_bdf2 = isinstance(integrator, Bdf2Arrays)
        operator = stepper.work.operator if is_bdf2 else integrator.solver.operator
        compile_call(linear_step, _problem(stepper), type_of(operator), type_of(True))
        compile_call(without_gain, _problem(stepper), OUTCOME_TYPE)
    compile_call(natural_map, *contacts, type_of(stepper.model.laws.residual_tolerance))
    compile_call(line_search, *contacts)


def compile_loop(scene: Scene, level: str) -> None:
    """Compile the loop over steps, by a call without steps."""
    stepper = one_level(scene, level)
    none = np.zeros((0, scene.robot.link_count - 1, 2))
    inputs = Inputs(none, none, stepper.no_samples, NO_PUSHES)
    now = initial_state(scene), stepper.empty_history(), inputs
    stepper.take_steps(*now)
