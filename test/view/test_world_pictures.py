# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Worlds in pictures: surfaces of solids, the viewer, and films."""

import inspect
import math

from gliding import glide
import numpy as np
import pytest

from snake_sim_ros import Scene
from snake_sim_ros.scene.surfaces import surfaces_of
from snake_sim_ros.scene.world import Box, EggCrate, Pipe, Pole, Ramp, World
from snake_sim_ros.view.animation import BOX, camera_axes, Film, Tops, UP, world_faces
from snake_sim_ros.view.stage import SEE_THROUGH, Stage

LENGTH = 1.1  # m, of poles and pipes below
WORLD = World(
    boxes=(Box(center=(0.3, 0.0, 0.1), size=(0.4, 1.0, 0.2), rpy=(0.0, 0.0, 0.3)),),
    ramps=(Ramp(run=0.6, rise=0.2, width=0.5, start=(1.0, 0.0, 0.0), heading=1.0),),
    poles=(Pole(start=(0.0, 1.0, 0.1), end=(0.0, 1.0, 0.1 + LENGTH), radius=0.1),),
    pipes=(Pipe(start=(0.0, 2.0, 0.2), end=(LENGTH, 2.0, 0.2), radius=0.15, inner=0.1),),
)


def volume(vertices, faces):
    """Return the volume of a closed surface [m^3], positive if it is seen from outside."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.einsum('ij,ij->i', a, np.cross(b, c)).sum() / 6


def test_surfaces_have_the_volumes_of_the_solids():
    box, pole, pipe, ramp = (volume(*surface) for surface in surfaces_of(WORLD))
    assert box == pytest.approx(0.4 * 1.0 * 0.2)
    # The ramp reaches 10 mm into the floor. Round solids have facets.
    assert ramp == pytest.approx(0.6 * 0.5 * (0.2 / 2 + 0.01))
    assert pole == pytest.approx(math.pi * 0.1**2 * (LENGTH + 4 / 3 * 0.1), rel=0.02)
    assert pipe == pytest.approx(math.pi * (0.15**2 - 0.1**2) * LENGTH, rel=0.01)


def test_the_viewer_shows_each_solid():
    viser = pytest.importorskip('viser')
    drawn = {}

    class Canvas:
        def add_mesh_simple(self, name, *arguments, **how):
            inspect.signature(viser.SceneApi.add_mesh_simple).bind(self, name, *arguments, **how)
            drawn[name] = how.get('opacity')

        def __getattr__(self, name):
            return lambda *arguments, **how: Canvas()

    Stage(Canvas(), Scene(world=WORLD))
    opacity = [shade for name, shade in drawn.items() if 'solids' in name]
    assert opacity == [None, None, SEE_THROUGH, None]  # box, pole, pipe, ramp


def test_films_show_boxes_and_poles_beside_the_robot():
    box = Box(center=(0.0, 0.35, 0.05), size=(2.0, 0.3, 0.1))
    film = Film(glide(world=World(boxes=(box,), poles=(Pole(radius=0.03),))), '', 1.0)
    image = film.frame(0)
    x, y = (film.seen(np.array([0.0, 0.35, 0.1])) - film.middle[0]) * film.scale * [1.0, -1.0]
    color = np.array(image.getpixel((int(x + image.width / 2), int(y + image.height / 2))))
    assert np.abs(color / color.max() - np.array(BOX) / max(BOX)).max() < 0.05
    assert len(film.pegs) == round(1.0 / 0.06) and (film.radius[-len(film.pegs) :] == 0.03).all()


def test_films_cut_pipes_open():
    camera = camera_axes(0.0)
    faces, _ = world_faces(World(pipes=(Pipe(radius=0.15, inner=0.1),)), camera, UP)
    assert np.hypot(*faces[..., :2].T).min() == pytest.approx(0.1)
    outside = (np.hypot(faces[..., 0], faces[..., 1]) > 0.14).all(axis=1)
    assert not outside.any()


def test_shadows_lie_on_what_is_below():
    tops = Tops(World(boxes=WORLD.boxes, egg_crates=(EggCrate(center=(5.0, 0.0)),)))
    points = np.array([[0.3, 0.0, 1.0], [0.3, 0.0, 0.1], [2.0, 2.0, 1.0], [5.1, 0.1, 1.0]])
    assert tops.below(points) == pytest.approx([0.2, 0.0, 0.0, 0.04], abs=2e-3)
