# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Functions that only compiled functions call."""

import numpy as np
import pytest

from snake_sim_ros.dynamics.compilation import compiled, COMPILES, inlined


@inlined
def tripled(x: float) -> float:
    return 3.0 * x


@compiled
def total(x):
    sum_ = 0.0
    for value in x:
        sum_ += tripled(value)
    return sum_


def test_they_are_linked_into_their_callers():
    assert total(np.array([1.0, 2.0])) == 9.0


@pytest.mark.skipif(not COMPILES, reason='nothing is compiled')
def test_a_call_from_python_is_an_error():
    with pytest.raises(TypeError):
        tripled(2.0)
    total(np.array([1.0]))  # now there is code of it
    with pytest.raises(TypeError):
        tripled(2.0)


@pytest.mark.skipif(not COMPILES, reason='nothing is compiled')
def test_what_they_call_is_not_compiled_into_them_for_that():
    from snake_sim_ros.dynamics.compiler import dispatcher_of

    factor = 0.5

    @compiled
    def part(x):  # it has a closure, so that no code of it is kept on disk
        return factor * x

    @inlined
    def both(x):
        return tripled(x) + part(1.0)

    @compiled
    def sum_of(x):
        return both(x[0])

    assert sum_of(np.array([1.0])) == 3.5
    for function, expected in ((part, False), (both, True)):
        (found,) = dispatcher_of(function).overloads.values()
        assert ('alwaysinline' in str(found.library._get_module_for_linking())) == expected
