# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The dense solvers: on hard contact problems they find what `newton` finds."""

from dense_step import EPS, rounding, solved_step
from hard_contacts import load_problems
from limits import path, WITHOUT_PEGS
import numpy as np
import pytest

from snake_sim_ros import Solver
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.stepping.methods import METHODS

RESIDUAL = 1e-9  # m/s, the tolerance of all problems
NOT_UNIQUE = 'mu 5 step 2519'  # see docs/hard_steps.md
PROBLEMS = load_problems()
# Problems that a method does not solve, far beyond Painleve's threshold or with rolling friction.
OPEN = {
    'newton': {'mu 5 step 3090', 'mu 5 step 3192', 'mu 5 step 4050', 'mu 5 step 5529'},
    'newton_dense': {
        *('dropped and spinning, mu 2', 'dropped and spinning, mu 5'),
        *('dropped and spinning, mu_V 0.5', 'tumbling, mu_V 0.05'),
    },
}


def solved(name, method, **settings):
    """Return the dense step, the impulses and velocities of a method, and its report."""
    scene, *start = PROBLEMS[name]
    return solved_step(with_settings(scene, {'method': method, **settings}), *start)


@pytest.mark.parametrize('name', sorted({*PROBLEMS} - {NOT_UNIQUE, *set().union(*OPEN.values())}))
def test_newton_dense_finds_the_velocities_of_newton(name):
    step, P, u, report = solved(name, 'newton')
    _, other_P, other_u, other_report = solved(name, 'newton_dense')
    assert other_report.unconverged == report.unconverged == 0
    # A residual e moves redundant normal impulses by e/compliance, these the friction by mu of it
    # and that the velocities with the tangential part of G.
    friction = step.scene.friction
    mu = max(friction.longitudinal, friction.transversal, friction.rolling)
    G_TT = np.delete(np.delete(step.delassus(), np.s_[::5], 0), np.s_[::5], 1)
    gain = 1.0 + mu * np.linalg.eigvalsh(G_TT)[-1] / step.compliance
    errors = gain * (report.residual_max + other_report.residual_max)
    # `newton` balances momentum to rounding. `newton_dense` solves for impulses, and gamma is
    # formed once: the condition of W_J^T M^-1 W_J, 1.4e5, 1000 times that with a heavy link, with
    # the largest ratio of Delassus entries, tangential over normal, 26/2.9 = 9.
    heavy = 1000 if 'heavy' in name else 1
    elimination = 9 * 1.4e5 * heavy * EPS * max(1e-3, np.abs(u).max())
    # Where it follows a path, it ends on the chain and balances momentum, too.
    on_chain = step.balance_error(other_P, other_u) if other_report.fallbacks else 0.0
    assert np.abs(step.velocities(other_P) - other_u.ravel()).max() <= elimination + on_chain
    balance = step.balance_error(P, u) + elimination
    assert np.abs(u - other_u).max() <= errors + balance + rounding(P, u)


@pytest.mark.parametrize('name', sorted(OPEN['newton_dense']))
def test_what_newton_dense_leaves_open_it_says(name):
    step, P, u, report = solved(name, 'newton_dense')
    residual = step.residual(P, step.gamma(u), step.compliance)
    assert report.unconverged == (report.residual_max > RESIDUAL)
    assert residual <= report.residual_max * (1 + 1e-6) + 1e-12


@pytest.mark.parametrize('name', PROBLEMS)
def test_gauss_seidel_is_honest(name):
    # In 300 sweeps it mostly is not done, and says so.
    step, P, u, report = solved(name, 'gauss_seidel', **{'solver.iteration_limit': 300})
    assert report.unconverged == (report.residual_max > RESIDUAL)
    residual = step.residual(P, step.gamma(u), step.compliance)
    assert residual <= report.residual_max + rounding(P, u)


@pytest.mark.parametrize('method', ['newton_dense', 'gauss_seidel'])
@pytest.mark.parametrize('seed', WITHOUT_PEGS)
def test_they_have_the_path_of_newton(seed, method):
    # As test_solvers_of_one_step_have_one_path says; sweeps that give up say so.
    solver = Solver(residual_tolerance=1e-9, tolerance=1e-11, iteration_limit=20000)
    expected, _ = path(seed, 'newton', 480, solver=solver)
    places, unconverged = path(seed, method, 480, solver=solver)
    assert not unconverged or method != 'newton_dense'
    assert unconverged or np.abs(places - expected).max() < 1e-6


def test_they_have_no_planar_level():
    for method in ('newton_dense', 'gauss_seidel'):
        assert METHODS[method].planar is None
