"""Moving pictures: how many, of what length, and what is where in them."""

from dataclasses import replace
from itertools import pairwise
import sys

import numpy as np
from PIL import Image
from PIL import ImageSequence
import pytest

from snake_sim_ros import animation
from snake_sim_ros.animation import animate
from snake_sim_ros.animation import BAND
from snake_sim_ros.animation import cameras
from snake_sim_ros.animation import Film
from snake_sim_ros.animation import FINE
from snake_sim_ros.animation import frame_samples
from snake_sim_ros.animation import SIZE
from snake_sim_ros.orthographic import best_camera
from snake_sim_ros.orthographic import empty_floor
from snake_sim_ros.orthographic import FLOOR
from snake_sim_ros.orthographic import SHADE
from snake_sim_ros.parameters import Ground
from snake_sim_ros.parameters import Pegs
from snake_sim_ros.parameters import Robot
from snake_sim_ros.parameters import Scene
from snake_sim_ros.records import ParameterError
from snake_sim_ros.rotations import FLAT
from snake_sim_ros.stepping import Report
from snake_sim_ros.trajectory import Trajectory

RADIUS = 0.0525  # m, of a link of Aiko
START = 7.0  # s


def glide(n=3, samples=51, way=0.3, up=0.0, **scene):
    """Return a straight robot along e_x, head first, that glides along -e_x at 50 samples a s."""
    x = 0.122 * np.arange(n) - np.linspace(0.0, way, samples)[:, None]
    lift = RADIUS + np.broadcast_to(up, x.shape)
    joints = np.zeros((samples, n - 1, 2))
    return Trajectory(
        scene=Scene(robot=Robot(link_count=n), **scene),
        time=START + np.arange(samples) / 50,
        position=np.stack([x, np.zeros(x.shape), lift], axis=-1),
        orientation=np.broadcast_to(FLAT, (samples, n, 4)),
        joint_angle=joints,
        joint_velocity=joints,
        joint_torque=joints,
        contact_sample=np.arange(samples),
        contact_number=np.zeros(samples, dtype=int),
        contact_point=np.stack([x[:, 0], np.zeros(samples), np.zeros(samples)], axis=-1),
        contact_force=np.tile([0.0, 3.0, 5.0], (samples, 1)),
        level=np.full(samples, 'spatial'),
        report=Report(),
        seconds=0.0,
        interrupted=False,
    )


def color_at(film, image, k, point):
    """Return the color of the pixel where a point is in the picture of sample k."""
    column, row = film.cameras[k % len(film.cameras)].pixels(np.array(point)) // FINE
    return np.array(image.getpixel((int(column), int(row))), dtype=float)


def looks(color, paint):
    """Return whether a color is a paint in some light: its hue, not its brightness."""
    return np.abs(color / color.max() - np.array(paint[:3]) / max(paint[:3])).max() < 0.2


HEAD, ODD = (0.80, 0.25, 0.10), (0.93, 0.69, 0.13)  # as in the URDF: links 1 and 3


# ---- files --------------------------------------------------------------------------------------


def test_gif(tmp_path):
    path = tmp_path / 'run.gif'
    animate(glide(), path, title='a run', speed=2.0)
    with Image.open(path) as image:
        frames = [np.array(frame.convert('RGB')) for frame in ImageSequence.Iterator(image)]
        assert image.size == SIZE
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
    assert (meta['size'], meta['fps'], meta['codec']) == (SIZE, 40.0, 'h264')
    assert len(frames) == 9  # at 0, 25, ... 200 ms
    # A video is not exact, the floor in it is.
    assert np.abs(np.median(frames[0].reshape(-1, 3), axis=0) - FLOOR).max() <= 4
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
        # The points of the head and of link 3 that are nearest to the viewer, along the ray
        # through their centers.
        for i, paint in ((0, HEAD), (2, ODD)):
            center = film.trajectory.position[k, i]
            assert looks(color_at(film, image, k, center), paint)
    # Where the head has come to, the floor was.
    ahead = color_at(film, images[0], 0, film.trajectory.position[50, 0] - [0.1, 0.0, 0.0])
    assert np.abs(ahead - FLOOR).max() < 25


def test_a_capsule_is_as_wide_as_it_is():
    film = Film(glide(), '', 1.0)
    camera = film.cameras[0]
    picture = film.frame(0)
    center = film.trajectory.position[0, 2]
    across = np.cross(camera.axes[2], [1.0, 0.0, 0.0])  # in the picture, at right angles to it
    across /= np.linalg.norm(across)
    edge = 2 / camera.scale * FINE  # m, two pixels
    for side in (1, -1):
        inside = center + side * (RADIUS - edge) * across
        outside = center + side * (RADIUS + edge) * across
        assert looks(color_at(film, picture, 0, inside), ODD)
        assert not looks(color_at(film, picture, 0, outside), ODD)


def test_the_shadow_of_a_lifted_link_is_apart():
    film = Film(glide(up=0.1), '', 1.0)
    camera = film.cameras[0]
    direction = camera.axes.T @ camera.sun  # in I
    center = film.trajectory.position[25, 1]
    ground = center - direction * center[2] / direction[2]
    image = film.frame(25)
    shaded = color_at(film, image, 25, ground)
    assert np.abs(shaded - (1 - SHADE) * FLOOR).max() < 15  # lines between tiles are darker
    # The ray through the shadow does not meet the link.
    off = camera.pixels(ground) - camera.pixels(center)
    assert np.linalg.norm(off) > RADIUS * camera.scale


def test_pegs_and_cells_are_drawn():
    empty = np.asarray(Film(glide(), '', 1.0).frame(0), dtype=float)
    for scene in (
        {'pegs': Pegs(x=(-0.1,), y=(0.12,), radius=0.03)},
        {'ground': Ground(heights=((0.02, -0.05), (0.1, 0.0)), cell=0.15, origin=(-0.2, 0.06))},
    ):
        film = Film(glide(**scene), '', 1.0)
        changed = np.abs(np.asarray(film.frame(0)) - empty).max(axis=-1) > 20
        column, row = (film.cameras[0].pixels(np.array([-0.1, 0.12, 0.05])) // FINE).astype(int)
        assert changed[row, column]
        # Not the whole picture, and not its other end.
        assert changed.mean() < 0.25
        assert not changed[:, : SIZE[0] // 4].any() or not changed[:, -SIZE[0] // 4 :].any()


def test_forces_are_drawn_in_their_direction():
    trajectory = glide()
    film = Film(trajectory, '', 1.0)
    none = replace(trajectory, contact_force=np.zeros((51, 3)))
    without = np.asarray(Film(none, '', 1.0).frame(25), dtype=float)
    image = film.frame(25)
    rows, columns = (np.abs(np.asarray(image) - without).max(axis=-1) > 60).nonzero()
    drawn = FINE * np.array([columns.mean(), rows.mean()])
    foot = np.array([trajectory.position[25, 0, 0], 0.0, 0.0])
    start, end = film.cameras[0].pixels(np.array([foot, foot + np.array([0.0, 1.0, 0.0])]))
    off, along = drawn - start, end - start
    assert off @ along > 0.9 * np.linalg.norm(off) * np.linalg.norm(along)


@pytest.mark.parametrize('n', [1, 200])
def test_any_number_of_links(n):
    trajectory = glide(n=n, samples=1)
    film = Film(trajectory, '', 1.0)
    assert looks(color_at(film, film.frame(0), 0, trajectory.position[0, 0]), HEAD)


# ---- cameras ------------------------------------------------------------------------------------


@pytest.mark.parametrize('way', [0.0, 1.0, 30.0])
def test_all_links_are_in_every_picture(way):
    film = Film(glide(n=11, way=way), '', 1.0)
    assert len(film.cameras) == (51 if way > 10.0 else 1)
    for k in range(51):
        at = film.cameras[k % len(film.cameras)].pixels(film.ends[k].reshape(-1, 3)) / FINE
        assert at.min() >= 0.0
        assert (at <= [SIZE[0], SIZE[1] - BAND]).all()


def test_what_goes_ahead_goes_to_the_right():
    ends = Film(glide(n=11, way=1.0), '', 1.0).ends
    (camera,) = cameras(ends, RADIUS)
    first, last = camera.pixels(ends[[0, -1]].mean(axis=(1, 2)))
    assert last[0] > first[0]


def test_the_floor_is_at_its_depth():
    # What is seen at a pixel, put together from its ray and its depth, has z = 0.
    points = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.3]])
    camera = best_camera(points, np.array([1.0, 0.0, 0.0]), (64, 36), 0.1, 0)
    picture = empty_floor(camera)
    u, v = camera.rays((slice(0, 36), slice(0, 64)))
    seen = np.stack(np.broadcast_arrays(u, v, picture.depth), axis=-1) @ camera.axes
    # Single precision of coordinates of some meters.
    assert np.abs(seen[..., 2]).max() < 8 * np.finfo(np.float32).eps * np.abs(seen).max()
