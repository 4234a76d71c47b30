# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the compiler does for a level, and what of that a second process can do at the same time.

The contact solver is half of a step, for the compiler too.
"""

from typing import Any

import numpy as np

from snake_sim_ros.contact.line_search import line_search
from snake_sim_ros.contact.natural_map import natural_map
from snake_sim_ros.contact.solver import Problem
from snake_sim_ros.contact.solver import solve
from snake_sim_ros.dynamics.bound_call import compile_call
from snake_sim_ros.dynamics.bound_call import Loop
from snake_sim_ros.dynamics.compilation import Dispatched
from snake_sim_ros.dynamics.records import type_of
from snake_sim_ros.dynamics.records import type_of_made
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping import bdf2
from snake_sim_ros.stepping import moreau
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.planar import moreau as planar_moreau
from snake_sim_ros.stepping.planar.solver import solve_in_plane
from snake_sim_ros.stepping.state import without_memory
from snake_sim_ros.stepping.steps import REPORT


def one_level(scene: Scene, level: str) -> Any:
    """Return the stepper of one level of a scene; None if its steps are not compiled."""
    stepper: Any = make_stepper(scene)
    stepper = getattr(stepper, level, stepper)
    return stepper if isinstance(getattr(stepper, 'loop', None), Loop) else None


def function_counts(scene: Scene, level: str) -> dict[str, int]:
    """
    Return how many functions the compiler meets at most in each function for the steps of a level.

    It compiles them once more with each function that they are in.
    """
    stepper = one_level(scene, level)
    found: dict[Any, set[Any]] = {}
    if stepper:
        _within(stepper.loop.func, stepper.loop.first, found)
    return {
        function.py_func.__name__: len(inside)
        for function, inside in found.items()
        if function.targetoptions.get('inline') != 'always'
    }


def _within(name: Any, first: Any, found: dict[Any, set[Any]]) -> set[Any]:
    """
    Return the functions in what a name means, itself included.

    `first` chooses between implementations. What is in any of them is added to `found`.
    """
    if isinstance(name, Dispatched):
        known = name.implementations
        chosen = [known[type(first)]] if type(first) in known else known.values()
        return set().union(*(_within(function, first, found) for function in chosen))
    if not hasattr(name, 'py_func'):
        return set()
    if name not in found:
        function = name.py_func
        found[name] = {name}  # an attribute may have the name of a function
        for called in function.__code__.co_names:
            found[name] |= _within(function.__globals__.get(called), first, found)
    return found[name]


def compile_solver(scene: Scene, level: str) -> None:
    """Compile the contact solver as the steps of a level call it."""
    stepper = one_level(scene, level)
    if not stepper:
        return
    function, model, work = stepper.loop.func, stepper.model, stepper.work
    first, kinds = stepper.loop.first, (type_of(model), type_of(work))
    history = type_of_made(without_memory(stepper.empty))
    if function in (moreau.advance, bdf2.advance):
        problem = type_of_made(Problem(model.laws, work.closed, work.contacts, work.chain))
    if function is moreau.advance:
        whole = type_of(stepper.empty)
        compile_call(solve, type_of(first), kinds[0], problem, whole, type_of(1))
    elif function is bdf2.advance:
        h, report = type_of(model.dt), type_of(np.zeros(1, REPORT)).dtype
        arguments = kinds[0], type_of(first), kinds[1], problem, h, h, history, report
        compile_call(bdf2.solve_landing, *arguments)
    else:
        is_moreau = function is planar_moreau.advance_in_plane
        solver = type_of(first if is_moreau else first.solver)
        compile_call(solve_in_plane, solver, *kinds, type_of(work.closed), history, type_of(1))


def compile_search(scene: Scene, level: str) -> None:
    """Compile what Newton's method comes to last: its residual and its line search."""
    stepper = one_level(scene, level)
    if not stepper:
        return
    model, work = stepper.model, stepper.work
    contacts = [type_of(part) for part in (model.laws, work.closed, work.contacts)]
    compile_call(natural_map, *contacts, type_of(model.residual_tolerance))
    compile_call(line_search, *contacts)
