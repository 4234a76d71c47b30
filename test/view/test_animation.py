# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Moving pictures: how many, of what length, and what is where in them."""

from dataclasses import replace
from itertools import pairwise
import sys

from gliding import glide, RADIUS, START
from matplotlib.colors import to_rgb
import numpy as np
from PIL import Image, ImageSequence
import pytest

from snake_sim_ros import Ground, ParameterError, Pegs, Scene
from snake_sim_ros.view import animation
from snake_sim_ros.view.animation import (
    animate,
    BAND,
    camera_axes,
    Film,
    FLOOR,
    frame_samples,
    ground_faces,
    SHADE,
    SIZE,
)


def pixels(film, k, points):
    """Return columns and rows of points in I in the picture of sample k."""
    return SIZE / 2 + (film.seen(np.array(points)) - film.middle[k]) * film.scale * [1.0, -1.0]


def color_at(film, image, k, point):
    """Return the color of the pixel where a point is in the picture of sample k."""
    return np.array(image.getpixel(tuple(pixels(film, k, point).astype(int))), dtype=float)


def changed(before, after):
    """Return which pixels of two pictures differ."""
    return np.abs(np.asarray(before, dtype=float) - np.asarray(after)).max(axis=-1) > 20


def paint(color):
    """Return red, green and blue of a color of matplotlib, up to 255."""
    return 255 * np.array(to_rgb(color))


def looks(color, hue):
    """Return whether a color is another in some light: its hue, not its brightness."""
    return np.abs(color / color.max() - np.array(hue) / max(hue)).max() < 0.2


HEAD, ODD = (0.80, 0.25, 0.10), (0.93, 0.69, 0.13)  # as in the URDF: links 1 and 3
PEG = (0.43, 0.55, 0.65)


# ---- files --------------------------------------------------------------------------------------


def test_gif(tmp_path):
    path = tmp_path / 'run.gif'
    animate(glide(), path, title='a run', speed=2.0)
    with Image.open(path) as image:
        frames = [np.array(frame.convert('RGB')) for frame in ImageSequence.Iterator(image)]
        assert image.size == tuple(SIZE)
        assert (image.info['duration'], image.info['loop']) == (60, 0)
    # 1 s, which lasts 0.5 s: at 0, 60, ... 480 ms.
    assert len(frames) == 9
    assert all((a != b).any() for a, b in pairwise(frames))


def test_mp4(tmp_path):
    imageio_ffmpeg = pytest.importorskip('imageio_ffmpeg')
    path = tmp_path / 'run.mp4'
    animate(glide(samples=11), path)
    reader = imageio_ffmpeg.read_frames(str(path))
    meta = next(reader)
    frames = [np.frombuffer(frame, dtype=np.uint8) for frame in reader]
    assert (meta['size'], meta['fps'], meta['codec']) == (tuple(SIZE), 40.0, 'h264')
    assert len(frames) == 9  # at 0, 25, ... 200 ms
    # A video is not exact, the floor in it is.
    assert np.abs(np.median(frames[0].reshape(-1, 3), axis=0) - paint(FLOOR)).max() <= 4
    assert (frames[0] != frames[-1]).any()


def test_frames_are_those_nearest_in_time():
    time = START + np.array([0.0, 0.1, 0.2, 0.3, 0.4])
    assert frame_samples(time, 0.06).tolist() == [0, 1, 1, 2, 2, 3, 4]
    assert frame_samples(time, 1.0).tolist() == [0]
    assert frame_samples(time[:1], 0.06).tolist() == [0]


@pytest.mark.parametrize('name', ['run.avi', 'run', 'run.gif.txt'])
def test_other_files_are_refused(tmp_path, name):
    with pytest.raises(ParameterError, match=rf"must be a \.gif or an \.mp4 file, got '{name}'"):
        animate(glide(), tmp_path / name)


@pytest.mark.parametrize('speed', [0.0, -1.0, np.inf, np.nan])
def test_speeds_without_an_end_are_refused(tmp_path, speed):
    with pytest.raises(
        ParameterError, match=f'speed of an animation must be above 0, got {speed:g}'
    ):
        animate(glide(), tmp_path / 'run.gif', speed=speed)


def test_without_ffmpeg_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'imageio_ffmpeg', None)
    monkeypatch.setattr(animation.shutil, 'which', lambda name: None)
    with pytest.raises(ParameterError, match='pip install imageio-ffmpeg'):
        animate(glide(), tmp_path / 'run.mp4')
    assert not list(tmp_path.iterdir())


def test_ffmpeg_that_fails_is_quoted(tmp_path, monkeypatch):
    program = tmp_path / 'ffmpeg'
    program.write_text('#!/bin/sh\necho no such encoder >&2\nexit 3\n')
    program.chmod(0o755)
    monkeypatch.setattr(animation, 'ffmpeg', lambda: str(program))
    with pytest.raises(ParameterError, match='could not make an MP4: no such encoder'):
        animate(glide(samples=11), tmp_path / 'run.mp4')
    assert not (tmp_path / 'run.mp4').exists()


# ---- what is where ------------------------------------------------------------------------------


def test_links_are_where_they_are_seen_from_the_camera():
    film = Film(glide(), '', 1.0)
    images = [film.frame(k) for k in (0, 50)]
    for k, image in zip((0, 50), images, strict=True):
        for i, hue in ((0, HEAD), (2, ODD)):
            assert looks(color_at(film, image, k, film.trajectory.position[k, i]), hue)
    # Where the head has come to, the floor was.
    ahead = color_at(film, images[0], 0, film.trajectory.position[50, 0] - [0.1, 0.0, 0.0])
    assert np.abs(ahead - paint(FLOOR)).max() < 25


def test_a_link_is_as_wide_as_it_is():
    film = Film(glide(), '', 1.0)
    image = film.frame(0)
    center = film.trajectory.position[0, 2]
    across = np.cross(film.camera[2], [1.0, 0.0, 0.0])  # in the picture, at right angles to it
    across /= np.linalg.norm(across)
    edge = 2 / film.scale  # m, two pixels
    for side in (1, -1):
        inside = center + side * (RADIUS - edge) * across
        outside = center + side * (RADIUS + edge) * across
        assert looks(color_at(film, image, 0, inside), ODD)
        assert not looks(color_at(film, image, 0, outside), ODD)


@pytest.mark.parametrize('floor', [0.0, 0.04])
def test_the_shadow_of_a_lifted_link_is_apart(floor):
    ground = Ground(heights=((floor,),), cell=4.0, origin=(-2.0, -2.0))
    film = Film(glide(up=0.1 + floor, ground=ground), '', 1.0)
    center = film.trajectory.position[25, 1]
    shaded = center - film.sun * (center[2] - floor) / film.sun[2]
    assert np.abs(color_at(film, film.frame(25), 25, shaded) - paint(SHADE)).max() < 2
    # The ray through the shadow does not meet the link.
    off = film.seen(shaded) - film.seen(center)
    assert np.linalg.norm(off) > RADIUS


def test_a_shadow_is_as_wide_as_it_is():
    # Of the points of a sphere, along the light, on the floor, and across the shadow of the link.
    film = Film(glide(up=0.1), '', 1.0)
    film.draw(0)
    angle = np.linspace(0.0, np.pi, 181)
    ball = np.stack([np.outer(np.cos(angle), np.cos(2 * angle)),
                     np.outer(np.cos(angle), np.sin(2 * angle)),
                     np.outer(np.sin(angle), np.ones(181))], axis=-1)  # fmt: skip
    ball = RADIUS * np.concatenate([ball, -ball])
    cast = film.seen(ball - ball[..., 2:] * film.sun / film.sun[2])
    along = film.seen(np.array([1.0, 0.0, 0.0]))
    wide = np.ptp(cast @ [-along[1], along[0]]) / np.linalg.norm(along)
    drawn = film.shadows.get_linewidths()[0] * 100 / 72 / film.scale
    assert drawn == pytest.approx(wide, rel=1e-3)  # a degree from point to point


def test_what_is_nearer_is_drawn_over_what_is_farther():
    # Pegs on both sides of a straight robot, that touch it.
    side = RADIUS + 0.03
    film = Film(glide(pegs=Pegs(x=(0.122, 0.122), y=(side, -side), radius=0.03)), '', 1.0)
    image, toward = film.frame(0), film.camera[2]
    near, far = sorted(film.pegs, key=lambda ends: -ends.mean(axis=0) @ toward)
    assert looks(color_at(film, image, 0, near.mean(axis=0)), PEG)
    # The foot of the other is hidden, not its top.
    assert looks(color_at(film, image, 0, far[1]), PEG)
    assert not looks(color_at(film, image, 0, far[0] - [0.0, 0.0, 0.01]), PEG)


def test_cells_are_drawn():
    empty = Film(glide(), '', 1.0).frame(0)
    heights = ((0.02, -0.05), (0.1, 0.0))
    film = Film(glide(ground=Ground(heights=heights, cell=0.15, origin=(-0.2, 0.06))), '', 1.0)
    different = changed(empty, film.frame(0))
    column, row = pixels(film, 0, [-0.1, 0.12, 0.02]).astype(int)
    assert different[row, column]
    # Not the whole picture, and not its other end.
    assert different.mean() < 0.25
    assert not different[:, : SIZE[0] // 4].any() or not different[:, -SIZE[0] // 4 :].any()


@pytest.mark.parametrize('azimuth', np.radians([30.0, 120.0, 210.0, 300.0]))
def test_sides_of_cells_face_the_viewer(azimuth):
    camera = camera_axes(azimuth)
    up = np.array([0.0, 0.0, 1.0])
    faces, colors = ground_faces(Ground(heights=((0.1,),), cell=0.3), camera, up)
    # Two sides, then the top.
    assert np.isin(faces[:2, :, 2], [0.0, 0.1]).all()
    assert (faces[2, :, 2] == 0.1).all()
    for face in faces[:2]:
        assert (face[:, :2].mean(axis=0) - 0.15) @ camera[2, :2] > 0.0
    # A pit: two inner walls of its neighbors, in front of which is its bottom, and a border.
    faces, colors = ground_faces(Ground(heights=((-0.1,),), cell=0.3), camera, up)
    assert len(faces) == len(colors) == 9 + 2
    walls = [face for face in faces if np.ptp(face[:, 2])]
    assert all((wall[:, :2].mean(axis=0) - 0.15) @ camera[2, :2] < 0.0 for wall in walls)


def test_forces_are_drawn_in_their_direction():
    trajectory = glide()
    film = Film(trajectory, '', 1.0)
    none = replace(trajectory, contact_force=np.zeros((51, 3)))
    rows, columns = changed(Film(none, '', 1.0).frame(25), film.frame(25)).nonzero()
    foot = np.array([trajectory.position[25, 0, 0], 0.0, 0.0])
    start, end = pixels(film, 25, foot + np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    off, along = np.array([columns.mean(), rows.mean()]) - start, end - start
    assert off @ along > 0.9 * np.linalg.norm(off) * np.linalg.norm(along)


@pytest.mark.parametrize(('n', 'offset'), [(1, 0.04), (200, 0.04), (1, 0.0)])
def test_any_number_of_links_and_spheres(n, offset):
    trajectory = glide(n=n, samples=1)
    robot = replace(trajectory.scene.robot, contact_offset=offset)
    film = Film(replace(trajectory, scene=Scene(robot=robot)), '', 1.0)
    assert looks(color_at(film, film.frame(0), 0, trajectory.position[0, 0]), HEAD)


# ---- cameras ------------------------------------------------------------------------------------


@pytest.mark.parametrize('way', [0.0, 1.0, 30.0])
def test_all_links_are_in_every_picture(way):
    film = Film(glide(n=11, way=way), '', 1.0)
    assert (len(np.unique(film.middle, axis=0)) > 1) == (way > 10.0)
    for k in range(51):
        at = pixels(film, k, film.ends[k].reshape(-1, 3))
        assert at.min() >= 0.0
        assert (at <= [SIZE[0], SIZE[1] - BAND]).all()


def test_what_goes_ahead_goes_to_the_right():
    film = Film(glide(n=11, way=1.0), '', 1.0)
    first, last = pixels(film, 0, film.ends[[0, -1]].mean(axis=(1, 2)))
    assert last[0] > first[0]
