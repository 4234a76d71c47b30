# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
All methods have the same limit as the step goes to 0, on random scenes with events.

Scenes are those of `limits`: of each kind of event the first three in which 1e-5 m/s move the end
by 2e-5 m at most. In the others a robot lands or rocks on more contacts than hold it: which one
comes first decides, and with it loads and friction.
"""

from functools import cache

from limits import path, SEEDS, TIME, WITHOUT_PEGS
import numpy as np
from oracle import ORACLE
import pytest

from snake_sim_ros import Solver
from snake_sim_ros.stepping.methods import METHODS

STEPS = (960, 1920, 3840, 7680, 15360)  # a second
FINE = 'newton', 'bdf2'

each_seed = pytest.mark.parametrize('seed', SEEDS)


@cache
def end(seed, method, per_second, perturbed=0.0, time=TIME):
    """Return where the links are, see `path`."""
    return path(seed, method, per_second, perturbed, time)[0]


def apart(one, two):
    return float(np.abs(one - two).max())


@each_seed
@pytest.mark.parametrize('method', FINE)
def test_scenes_are_not_chaotic(method, seed):
    # In 0.3 s a velocity that is off by 1e-9 m/s, and one that is off by as much as methods are,
    # moves the end by as much, times five where a landing comes a step earlier.
    here = end(seed, method, 3840)
    assert apart(end(seed, method, 3840, 1e-9), here) < 1e-6
    for off in (1e-5, -1e-5):
        assert apart(end(seed, method, 3840, off), here) < 6e-5


@each_seed
def test_both_methods_have_one_limit(seed):
    # Errors of first order: from one step to its half they fall by as much as is left then. Events
    # that come a step late or not make single differences large or small: the larger of two.
    bound = 0.0
    for method in FINE:
        ends = [end(seed, method, per_second) for per_second in STEPS[-3:]]
        bound += max(apart(ends[0], ends[1]), apart(ends[1], ends[2]))
    assert apart(end(seed, 'newton', STEPS[-1]), end(seed, 'bdf2', STEPS[-1])) < bound < 6e-4


@pytest.mark.parametrize('method', FINE)
def test_errors_are_of_first_order_on_average(method):
    # The limit is that of the other method: `bdf2`, or the two finest steps of `newton` without
    # their error of first order. `bdf2`, too, is of first order where velocities jump: it takes a
    # landing to the end of its step. Single scenes scatter; the mean is 1 but for two of its
    # standard errors.
    orders = []
    for seed in SEEDS:
        coarse, fine = end(seed, 'newton', STEPS[-2]), end(seed, 'newton', STEPS[-1])
        limit = 2 * fine - coarse if method == 'bdf2' else end(seed, 'bdf2', STEPS[-1])
        errors = np.log2([apart(end(seed, method, k), limit) for k in (480, *STEPS[:-1])])
        orders.append(-np.polyfit(range(len(errors)), errors, 1)[0])
    scatter = np.std(orders) / np.sqrt(len(orders))
    assert np.mean(orders) > 1.0 - 2 * scatter
    assert scatter < 0.2


@pytest.mark.parametrize('seed', WITHOUT_PEGS)
@pytest.mark.parametrize('method', [name for name in METHODS if name not in FINE])
def test_solvers_of_one_step_have_one_path(method, seed):
    # Residuals of 1e-9 m/s in each of 144 steps, for 0.3 s, are 4e-8 m; loads of a stiff robot and
    # friction with them are ten times that. Projections that give up say so, and claim nothing:
    # they do where a robot lands flat, which newton solves.
    solver = Solver(residual_tolerance=1e-9, tolerance=1e-11, iteration_limit=20000)
    expected, unconverged = path(seed, 'newton', 480, solver=solver)
    assert unconverged == 0
    places, unconverged = path(seed, method, 480, solver=solver)
    assert unconverged or apart(places, expected) < 1e-6


@pytest.mark.parametrize('seed', [1, 18, 4])
def test_the_dense_step_has_the_same_path(seed):
    # A dozen steps, a push or a landing among them.
    one, other = (end(seed, method, 240, time=0.05) for method in (ORACLE, 'newton'))
    assert apart(one, other) < 1e-6
