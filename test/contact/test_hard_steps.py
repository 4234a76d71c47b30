# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The hardest steps of curled, wedged and jammed robots: nearly all of them converge."""

from hard_contacts import load_hard_steps
import numpy as np
import pytest

from snake_sim_ros.stepping.methods import make_stepper

pytestmark = pytest.mark.long

STEPS = load_hard_steps()


def test_there_are_300_of_them():
    assert sum(map(len, STEPS.values())) == 300


@pytest.mark.parametrize('name', ['friction 1.5', 'wedged, friction 1.5', 'curled, friction 1.5'])
def test_steps_with_much_friction_converge(name):
    stepper = make_stepper(STEPS[name][0].scene)
    for _, state, history, angle, rate in STEPS[name]:
        end, _, report = stepper.advance(state, history, angle[None], rate[None])
        assert not report.failure
        assert report.unconverged == 0
        assert report.residual_max <= 1e-9
        assert np.isfinite(end.u).all()
