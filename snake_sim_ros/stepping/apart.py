# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What the compiler does for a level, and what of that a second process can do at the same time.

The contact solver is half of a step, for the compiler too.
"""

from functools import partial
from typing import Any

import numpy as np

from snake_sim_ros.contact.line_search import line_search
from snake_sim_ros.contact.natural_map import natural_map
from snake_sim_ros.contact.solver import Problem
from snake_sim_ros.contact.solver import solve
from snake_sim_ros.dynamics.compilation import compile_call
from snake_sim_ros.dynamics.compilation import Dispatched
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping import bdf2
from snake_sim_ros.stepping import moreau
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.planar import moreau as planar_moreau
from snake_sim_ros.stepping.planar.newton import PlanarNewton
from snake_sim_ros.stepping.planar.solver import solve_in_plane
from snake_sim_ros.stepping.state import without_memory
from snake_sim_ros.stepping.steps import REPORT


def one_level(scene: Scene, level: str) -> Any:
    """Return the stepper of one level of a scene; None if its steps are not compiled."""
    stepper: Any = make_stepper(scene)
    stepper = getattr(stepper, level, stepper)
    return stepper if isinstance(getattr(stepper, 'loop', None), partial) else None


def function_count(scene: Scene, level: str) -> int:
    """Return how many functions the compiler meets at most for the steps of a level."""
    stepper = one_level(scene, level)
    found: set[Any] = set()
    if stepper:
        _find(stepper.loop.func, stepper.loop.args[0], found)
    return sum(1 for function in found if function.targetoptions.get('inline') != 'always')


def _find(name: Any, first: Any, found: set[Any]) -> None:
    """Add what a name means, and what it calls; `first` chooses between implementations."""
    if isinstance(name, Dispatched):
        known = name.implementations
        for function in [known[type(first)]] if type(first) in known else known.values():
            _find(function, first, found)
    elif hasattr(name, 'py_func') and name not in found:
        found.add(name)
        function = name.py_func
        for called in function.__code__.co_names:
            _find(function.__globals__.get(called), first, found)


def compile_solver(scene: Scene, level: str) -> None:
    """Compile the contact solver as the steps of a level call it."""
    stepper = one_level(scene, level)
    if not stepper:
        return
    loop, model, work, history = stepper.loop, stepper.model, stepper.work, stepper.empty
    (first,) = loop.args
    if loop.func in (moreau.advance, bdf2.advance):
        problem = Problem(model.laws, work.closed, work.contacts, work.chain)
    if loop.func is moreau.advance:
        compile_call(solve, first, model, problem, history, 1)
    elif loop.func is bdf2.advance:
        report = np.zeros(1, REPORT)[0]
        numbers = problem, 0.0, 0.0, without_memory(history), report
        compile_call(bdf2.solve_landing, model, first, work, *numbers)
    else:
        solver = first if loop.func is planar_moreau.advance_in_plane else PlanarNewton(None)
        rest = work.closed, without_memory(history), 1
        compile_call(solve_in_plane, solver, model, work, *rest)


def compile_search(scene: Scene, level: str) -> None:
    """Compile what Newton's method comes to last: its residual and its line search."""
    stepper = one_level(scene, level)
    if not stepper:
        return
    model, work = stepper.model, stepper.work
    contacts = model.laws, work.closed, work.contacts
    compile_call(natural_map, *contacts, model.residual_tolerance)
    compile_call(line_search, *contacts)
