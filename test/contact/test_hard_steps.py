# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The hardest steps of curled, wedged and jammed robots.

They are stored with a limit of 5000 iterations, with which nearly all of them converge.
"""

from hard_contacts import load_hard_steps
import numpy as np
import pytest

from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.stepping.methods import make_stepper

pytestmark = pytest.mark.long

LEFT_OPEN = {  # steps
    'friction 1.5': 0,
    'wedged, friction 1.5': 0,
    'curled, friction 1.5': 0,
    'joint friction': 0,
}


def test_there_are_300_of_them():
    assert sum(map(len, load_hard_steps().values())) == 300


@pytest.mark.parametrize('name', LEFT_OPEN)
def test_steps_with_much_friction_converge(name):
    steps = load_hard_steps()[name]
    stepper, left = make_stepper(steps[0].scene), 0
    for _, state, history, angle, rate in steps:
        end, _, report = stepper.advance(state, history, angle[None], rate[None])
        assert not report.failure
        assert report.unconverged == (report.residual_max > 1e-9)
        assert np.isfinite(end.u).all()
        left += report.unconverged
    assert left <= LEFT_OPEN[name]


def test_steps_that_are_cut_take_the_best_of_their_rounds():
    residuals = []
    for steps in load_hard_steps().values():
        cut = {'solver.iteration_limit': 60}  # fewer than a path needs
        stepper = make_stepper(with_settings(steps[0].scene, cut))
        for _, state, history, angle, rate in steps:
            _, _, report = stepper.advance(state, history, angle[None], rate[None])
            assert report.unconverged == (report.residual_max > 1e-9)
            residuals += [report.residual_max] * report.unconverged
    assert len(residuals) > 50
    assert np.median(residuals) < 0.01  # 0.1 m/s if they took their last impulses
