# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Paths: nearest places in closed form, and paths that are none."""

import math

import numpy as np
import pytest

from snake_sim_ros import Following, ParameterError, PlanarPath
from snake_sim_ros.controllers.paths import places_along, SAG

pytestmark = pytest.mark.fast


@pytest.mark.parametrize('seed', range(5))
def test_a_line_goes_on_beyond_its_ends(seed):
    rng = np.random.default_rng(seed)
    begin, direction, length = rng.uniform(-3, 3, 2), rng.uniform(-math.pi, math.pi), 2.0
    along = np.array([math.cos(direction), math.sin(direction)])
    left = np.array([-along[1], along[0]])
    path = PlanarPath.line(begin, begin + length * along)
    assert path.length == pytest.approx(length, abs=1e-14)
    for arc, off in rng.uniform(-5, 5, (20, 2)):
        for before in (None, arc + 0.2):
            place = path.nearest(begin + arc * along + off * left, before)
            assert place == pytest.approx((arc, off, direction, 0.0), abs=1e-12)


@pytest.mark.parametrize('turn', [2 * math.pi, -2 * math.pi])
def test_a_circle_is_met_within_the_sag_of_its_pieces(turn):
    center, radius = np.array([0.5, -1.0]), 1.3
    path = PlanarPath.circle(center, radius, 0.4, turn)
    way, piece = math.copysign(1.0, turn), math.sqrt(8 * radius * SAG)
    assert path.length == pytest.approx(2 * math.pi * radius, rel=SAG)
    for angle, off in np.random.default_rng(2).uniform([0.01, -0.5], [6.27, 0.5], (30, 2)):
        # Counterclockwise, the left side is inside.
        at = 0.4 + way * angle
        point = center + (radius - way * off) * np.array([math.cos(at), math.sin(at)])
        place = path.nearest(point)
        assert place.arc == pytest.approx(radius * angle, abs=piece)
        assert place.cross_track == pytest.approx(off, abs=1.01 * SAG)
        assert place.direction == pytest.approx(at + way * math.pi / 2, abs=piece / radius)
        assert place.curvature == pytest.approx(way / radius, rel=SAG)


def test_a_closed_path_is_followed_round_and_round():
    path, arc, arcs = PlanarPath.circle((0.0, 0.0), 1.0), None, []
    for angle in np.arange(0.0, 15.0, 0.1):
        arc = path.nearest((1.1 * math.cos(angle), 1.1 * math.sin(angle)), arc).arc
        arcs.append(arc)
    assert np.remainder(arcs, path.length) == pytest.approx(
        np.remainder(np.arange(0.0, 15.0, 0.1), 2 * math.pi), abs=1e-3
    )


def test_where_a_path_crosses_itself_the_way_goes_on():
    s = np.linspace(0.0, 2 * math.pi, 60)
    path = PlanarPath.spline(np.column_stack([3 * np.sin(s), 1.5 * np.sin(2 * s)]), closed=True)
    arc, arcs = None, []
    for s in np.linspace(0.2, 6.2, 400):
        arc = path.nearest((3 * math.sin(s), 1.5 * math.sin(2 * s) + 0.02), arc).arc
        arcs.append(arc)
    assert (np.diff(arcs) > 0.0).all()


@pytest.mark.parametrize('closed', [False, True])
def test_what_is_far_along_the_path_need_not_be_looked_at(closed):
    rng = np.random.default_rng(3)
    path = PlanarPath.spline(rng.normal(0.0, 1.5, (7, 2)), closed=closed)
    for arc in rng.uniform(-0.5, path.length + 0.5, 200):
        k = min(max(np.searchsorted(path.arc, arc), 0), len(path.points) - 1)
        point = path.points[k] + rng.normal(0.0, 0.2, 2)
        everywhere = path.course._replace(reach=math.inf)
        place = np.empty((1, 4))
        places_along(everywhere, point[None], arc, place)
        assert path.nearest(point, arc) == tuple(place[0])


def test_a_spline_has_the_curvature_of_its_curve():
    # Points of a circle: the spline is off by the fourth power of their distance.
    s = np.linspace(0.0, 2 * math.pi, 80)[:-1]
    path = PlanarPath.spline(2.0 * np.column_stack([np.cos(s), np.sin(s)]), closed=True)
    for angle in np.linspace(0.1, 6.1, 17):
        place = path.nearest((2.3 * math.cos(angle), 2.3 * math.sin(angle)))
        assert place.cross_track == pytest.approx(-0.3, abs=1e-5)
        assert place.curvature == pytest.approx(0.5, rel=1e-2)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'points': [[0.0, 0.0]]}, 'two or more, each x and y, got 1 of [2] numbers'),
        ({'points': [[0, 0, 0], [1, 0, 0]]}, 'two or more, each x and y, got 2 of [3] numbers'),
        ({'points': [[0, 0], [0, 0], [1, 0]]}, 'apart from each other, got [0.0, 0.0] twice'),
        ({'points': [[0, 0], [1, 0]], 'center': [0, 0]}, 'points or a center, got both'),
        ({'center': [0, 0, 1]}, 'center must have 2 components, got 3'),
        ({'center': [0, 0], 'radius': 0.0}, 'radius of a circle must not be 0 m'),
        ({'lookahead': 0.0}, 'lookahead must be above 0'),
        ({'heading_gain': math.nan}, 'heading_gain must be'),
    ],
)
def test_what_is_no_path_is_named(values, message):
    with pytest.raises(ParameterError) as error:
        Following(**values)
    assert message in str(error.value)


@pytest.mark.parametrize(
    'numbers', [{'radius': math.inf}, {'radius': 0.0}, {'radius': 1.0, 'turn': 0.0}]
)
def test_a_circle_has_a_size(numbers):
    with pytest.raises(ParameterError, match='of a circle must be'):
        PlanarPath.circle((0, 0), **numbers)


def test_the_path_of_a_scene():
    line = PlanarPath.of(Following(points=((0.0, 0.0), (1.0, 1.0))))
    assert line.length == pytest.approx(math.sqrt(2))
    clockwise = PlanarPath.of(Following(center=(0.0, 0.0), radius=-2.0))
    assert clockwise.nearest((0.0, 3.0)).cross_track == pytest.approx(1.0, abs=1e-4)
    assert not Following()
