# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Distances of shapes are those of the library coal, where it is installed."""

import pytest

from snake_sim_benchmarks.reliability.oracle_of_shapes import (
    difference_of_links,
    largest_difference,
)


@pytest.mark.parametrize('kind', ['box', 'pole', 'wedge'])
@pytest.mark.parametrize('capsules', [False, True])
def test_distances_are_those_of_coal(kind, capsules):
    pytest.importorskip('coal')
    # Coordinates of 100 m have 1.4e-14 m of rounding, and the search of coal ends at 1e-12 m.
    worst, met = largest_difference(kind, capsules, 2000, 7)
    assert worst < 1e-9 and met > 1500


def test_distances_of_links_are_those_of_coal():
    pytest.importorskip('coal')
    worst, met = difference_of_links(2000, 7)
    assert worst < 1e-9 and met > 1500
