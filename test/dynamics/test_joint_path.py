# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Laws of joints that are round over a rate, without the compiler."""

import math

import numpy as np
import pytest

from snake_sim_ros import Scene
from snake_sim_ros.dynamics.joint_laws import make_axis_laws, resolvent
from snake_sim_ros.dynamics.joint_path import round_clamp, round_resolvent

EPS = np.finfo(float).eps


def random_axes(rng):
    """Return laws whose first axis has some of friction, limit, stops and viscous friction."""
    axes = make_axis_laws(Scene().robot)
    axes.torque[0, 0] = rng.normal()
    for array in (axes.damping, axes.friction, axes.viscous):
        array[0, 0] = rng.uniform(0.05, 1.0) * rng.integers(2)
    axes.limit[0, 0] = rng.uniform(0.1, 1.0) if rng.integers(2) else math.inf
    low, high = rng.uniform(-2.0, 0.0), rng.uniform(0.0, 2.0)
    axes.low[0, 0], axes.high[0, 0] = (low, high) if rng.integers(2) else (-math.inf, math.inf)
    return axes


@pytest.mark.parametrize('seed', range(50))
def test_a_resolvent_that_is_hardly_round_is_that_of_the_law(seed):
    rng = np.random.default_rng(seed)
    axes, r = random_axes(rng), rng.uniform(0.1, 3.0)
    for z in rng.normal(scale=3.0, size=10):
        w, _, _ = resolvent(axes, 0, 0, r, z)
        for s in (1e-3, 1e-6):
            # Each part of a clamp is s/2 off at its corner at most; there are six.
            assert abs(round_resolvent(axes, 0, 0, (r, z), s).value - w) <= 3 * s + 100 * EPS


@pytest.mark.parametrize('seed', range(50))
def test_derivatives_are_those_of_the_value(seed):
    rng = np.random.default_rng(seed)
    axes, r = random_axes(rng), rng.uniform(0.1, 3.0)
    z, s, d = rng.normal(scale=3.0), rng.uniform(0.1, 1.0), 1e-5
    found = round_resolvent(axes, 0, 0, (r, z), s)
    assert -10 * EPS <= found.slope <= 1.0

    def value(dz, ds):
        return round_resolvent(axes, 0, 0, (r, z + dz), s + ds).value

    # Central differences: third derivatives are below 10/s^2, and corners may be 100 away.
    near = d**2 * 10.0 / s**2 + 1000 * EPS / d
    assert abs((value(d, 0.0) - value(-d, 0.0)) / (2 * d) - found.slope) < near
    assert abs((value(0.0, d) - value(0.0, -d)) / (2 * d) - found.change) < near


def test_a_clamp_keeps_far_bounds_apart():
    value, slope, change, reach = round_clamp(0.3, -math.inf, math.inf, 1.0)
    assert (value, slope, change, reach) == (0.3, 1.0, 0.0, math.inf)
    value, slope, _, reach = round_clamp(2.0, 0.0, 1.0, 1e-8)
    assert value == pytest.approx(1.0, abs=1e-15)
    assert 0.0 <= slope < 1e-15
    assert reach == pytest.approx(1.0)
