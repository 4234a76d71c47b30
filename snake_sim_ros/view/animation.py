# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Runs as moving pictures: a GIF or an MP4 of the robot from obliquely above, by matplotlib.

The projection is parallel, so that a link looks like a thick line with round ends and a peg like
an upright one. Nearer bodies are drawn later. The ground is drawn before everything on it.
"""

from collections.abc import Callable, Iterable
import math
from pathlib import Path
import shutil
from subprocess import CalledProcessError
from typing import Any

from matplotlib import rc_context
from matplotlib.animation import FFMpegWriter
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
import numpy as np
from PIL import Image
from scipy.ndimage import uniform_filter1d

from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.files import whole_file
from snake_sim_ros.scene.obstacles import cell_at, cell_height
from snake_sim_ros.scene.parameters import Array, Ground
from snake_sim_ros.scene.robot_description import color_name, COLORS
from snake_sim_ros.scene.rotations import rotation_matrices
from snake_sim_ros.scene.surfaces import AROUND, surfaces_of
from snake_sim_ros.scene.world import solids_of, World
from snake_sim_ros.stepping.trajectory import Trajectory
from snake_sim_ros.view.frames import bodies_of

Bar = Callable[[Array], Iterable[int]]  # returns the samples, and shows how many are left
SIZE = np.array([640, 360])  # pixels; both are even, since four pixels of an MP4 share a color
DPI = 100
BAND, GAP = 28, 12  # pixels: height of the text at the lower edge, margin of texts
DELAYS = {'.gif': 60, '.mp4': 25}  # ms between two frames; a GIF needs whole 1/100 s
PALETTE = 48  # colors of a GIF
UP = np.array([0.0, 0.0, 1.0])
ELEVATION = math.radians(38.0)
SUN = np.array([-0.55, 0.45, 1.0])  # toward the light: right, away from the viewer, up
WIDEST_VIEW = 3.0  # largest width of a picture, in widths of the robot; wider runs are followed
FLOOR, GROUT, SHADE = '#f2efe8', '#dedad1', '#a3a09a'
BOX, PEG = (0.84, 0.81, 0.75), (0.43, 0.55, 0.65)
PATH_COLOR, FORCE_COLOR, TEXT_COLOR = '#0072b2', '#d55e00', '#464646'
STRIPS = np.linspace(0.0, 0.85, 5)  # of a body, from its edge to its brightest line
LIGHT = 0.55 + 0.6 * STRIPS**0.8
SHADE_CELL = 0.02  # m, squares in which shadows on a world have one height
TILE, BAR = 0.5, 0.5  # m, sizes of the squares of the floor and of the scale
LONGEST_ARROW = 0.2  # in lengths of the robot, for a force that few forces exceed
MOST_ARROWS = 24  # of more contacts, every second, third, ... has an arrow
SHORTEST_ARROW = 8  # pixels


def animate(
    trajectory: Trajectory,
    path: Path,
    title: str = '',
    speed: float = 1.0,
    bar: Bar = iter,
) -> None:
    """
    Write a run as a GIF or an MP4, whole or not at all.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
        Its suffix, .gif or .mp4, selects the format.
    title : str, optional
        Text beside the time.
    speed : float, optional
        Seconds of the run in a second of the animation.
    bar : callable, optional
        Returns the samples that become frames, one after the other, and shows that.

    Raises
    ------
    ParameterError
        If the suffix is another one, speed is not above 0, or there is no ffmpeg for an MP4.

    """
    delay = DELAYS.get(path.suffix)
    if delay is None:
        raise ParameterError(f'an animation must be a .gif or an .mp4 file, got {path.name!r}')
    if not 0.0 < speed < math.inf:
        raise ParameterError(f'speed of an animation must be above 0, got {speed:g}')
    samples = frame_samples(trajectory.time, speed * delay / 1000)
    write = _write_gif if path.suffix == '.gif' else _write_mp4
    with whole_file(path) as part:
        write(part, Film(trajectory, title, speed), samples, bar)


def _write_gif(path: Path, film: 'Film', samples: Array, bar: Bar) -> None:
    """Write an endless GIF whose frames share one palette, which halves its size."""
    some = samples[np.unique(np.linspace(0, len(samples) - 1, 5).astype(int))]
    sheet = Image.fromarray(np.concatenate([np.asarray(film.frame(k)) for k in some]))
    palette = sheet.quantize(PALETTE, method=Image.Quantize.MAXCOVERAGE, kmeans=1)
    frames = (
        film.frame(k).quantize(palette=palette, dither=Image.Dither.NONE) for k in bar(samples)
    )
    rest: dict[str, Any] = {'append_images': frames, 'duration': DELAYS['.gif'], 'loop': 0}
    next(frames).save(path, save_all=True, disposal=1, **rest)


def _write_mp4(path: Path, film: 'Film', samples: Array, bar: Bar) -> None:
    """Write an MP4 that all browsers can play."""
    options = ['-crf', '20', '-movflags', '+faststart']
    writer = FFMpegWriter(1000 // DELAYS['.mp4'], codec='h264', extra_args=options)
    program = ffmpeg()
    try:
        with (
            rc_context({'animation.ffmpeg_path': program}),
            writer.saving(film.canvas.figure, str(path), DPI),
        ):
            for k in bar(samples):
                film.draw(k)
                writer.grab_frame()
    except CalledProcessError as error:
        reason = (error.stderr or '').strip().partition('\n')[0] or f'status {error.returncode}'
        raise ParameterError(f'{program} could not make an MP4: {reason}') from None


def frame_samples(time: Array, period: float) -> Array:
    """Return the samples that are nearest to whole periods [s] after the first sample."""
    times = np.arange(time[0], time[-1] + 1e-6 * period, period)
    nearest: Array = np.rint(np.interp(times, time, np.arange(len(time)))).astype(int)
    return nearest


def ffmpeg() -> str:
    """Return the program that writes an MP4: ffmpeg of imageio-ffmpeg or of the system."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        found = shutil.which('ffmpeg')
    if found is None:
        raise ParameterError('an .mp4 needs ffmpeg, which is not here: pip install imageio-ffmpeg')
    return found


def camera_axes(azimuth: float) -> Array:
    """Return the directions to the right, up, and toward the viewer, in I, shape (3, 3)."""
    c, s = math.cos(azimuth), math.sin(azimuth)
    ce, se = math.cos(ELEVATION), math.sin(ELEVATION)
    return np.array([[c, s, 0.0], [-s * se, c * se, ce], [s * ce, -c * ce, se]])


def best_view(ends: Array, radius: float) -> tuple[Array, Array, float]:
    """
    Return the camera that shows a run largest, with a robot that moves to the right.

    Parameters
    ----------
    ends : ndarray, shape (m, n, 2, 3)
        Ends of the axes of all links [m, frame I].
    radius : float
        Largest radius of a link [m].

    Returns
    -------
    camera : ndarray, shape (3, 3)
        See `camera_axes`.
    middle : ndarray, shape (m, 2)
        Middle of the picture at every sample [m].
    scale : float
        Pixels in a meter.

    """
    few = np.unique(np.linspace(0, len(ends) - 1, 200).round().astype(int))
    center = ends.mean(axis=(1, 2))
    found = []
    for azimuth in np.radians(np.arange(0.0, 360.0, 5.0)):
        camera = camera_axes(azimuth)
        seen = ends[few].reshape(-1, 3) @ camera[:2].T
        low, high = seen.min(axis=0) - 2 * radius, seen.max(axis=0) + 2 * radius
        scale = float(((SIZE - [0, BAND]) / (high - low)).min())
        right = camera[0] @ (center[-1] - center[0]) >= -1e-9
        found.append((right, scale, azimuth, (low + high) / 2 - [0.0, BAND / scale / 2]))
    _, scale, azimuth, middle = max(found, key=lambda item: item[:2])
    camera = camera_axes(azimuth)
    widest = WIDEST_VIEW * (np.ptp(ends, axis=1).max() + 2 * radius)
    if SIZE[0] / scale <= widest:
        return camera, np.tile(middle, (len(ends), 1)), scale
    smooth = uniform_filter1d(center @ camera[:2].T, max(1, len(ends) // 8), 0, mode='nearest')
    return camera, smooth, SIZE[0] / widest


def ground_faces(ground: Ground, camera: Array, sun: Array) -> tuple[Array, Array]:
    """Return the visible faces of cells in I, the farthest first, and their colors."""
    shape = len((ground.heights or ((),))[0]), len(ground.heights)
    pits = min(map(min, ground.heights), default=0.0) < 0.0
    near = np.diag(np.sign(camera[2, :2])).astype(int)  # to neighbors toward the viewer
    square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    light = 0.5 + 0.58 * (np.append(near.diagonal(), 1) * sun / np.linalg.norm(sun)).clip(0.0)
    paints = np.multiply.outer(light, BOX).clip(0.0, 1.0)
    faces, colors = [], []
    # The cells have a flat border.
    cells = [(i - 1, j - 1) for i, j in np.ndindex(shape[0] + 2, shape[1] + 2)]
    for cell in sorted(cells, key=lambda cell: float(camera[2, :2] @ cell)):
        top = cell_height(ground, *cell)
        corners = ground.origin + ground.cell * (np.array(cell) + 0.5 + square / 2)
        for step, paint in zip(near, paints[:2], strict=True):
            below = cell_height(ground, *(cell + step))
            if below < top:
                edge = corners[square @ step > 0]
                faces.append(np.column_stack([edge[[0, 1, 1, 0]], [top, top, below, below]]))
                colors.append(paint)
        if top or pits:  # flat cells hide pits behind them
            faces.append(np.column_stack([corners, np.full(4, top)]))
            colors.append(paints[2] if top else np.array(to_rgb(FLOOR)))
    return np.reshape(faces, (-1, 4, 3)), np.reshape(colors, (-1, 3))


def world_faces(world: World, camera: Array, sun: Array) -> tuple[Array, Array]:
    """
    Return the triangles of a world that look at the viewer, the farthest first, and their colors.

    Poles are left out: they are drawn as bodies, since links may be before and behind them. Pipes
    are cut open: the half of the wall that is nearer to the viewer would hide what is inside.
    """
    solids, surfaces = solids_of(world), surfaces_of(world)
    boxes, poles = len(solids.box_center), len(solids.poles)
    seen = surfaces[:boxes] + surfaces[boxes + poles :]
    for k in range(boxes, boxes + len(solids.pipes)):
        vertices, faces = seen[k]
        seen[k] = vertices, faces[2 * AROUND :]  # the first ones are those of the outside
    if not seen:
        return np.zeros((0, 3, 3)), np.zeros((0, 3))
    corners = np.concatenate([vertices[faces] for vertices, faces in seen])
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    front = (normals @ camera[2] > 1e-9) & (corners[:, :, 2].max(axis=1) > 1e-6)
    corners, normals = corners[front], normals[front]
    order = np.argsort(corners.mean(axis=1) @ camera[2], kind='stable')
    light = 0.5 + 0.58 * (normals @ sun / np.linalg.norm(sun)).clip(0.0)
    return corners[order], np.multiply.outer(light, BOX).clip(0.0, 1.0)[order]


class Tops:
    """How high the world is at places seen from above, without poles and pipes, for shadows."""

    def __init__(self, world: World) -> None:
        solids, surfaces = solids_of(world), surfaces_of(world)
        boxes, meshes = len(solids.box_center), len(solids.meshes)
        kept = surfaces[:boxes] + surfaces[len(surfaces) - meshes :]
        corners = np.concatenate([
            np.zeros((0, 3, 3)), *(vertices[faces] for vertices, faces in kept)
        ])  # fmt: skip
        a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        corners = corners[np.cross(a, b)[:, 2] > 0.0]
        ends = corners[..., :2].reshape(-1, 2)
        self.low = ends.min(axis=0) if len(ends) else np.zeros(2)
        wide, deep = np.floor((np.ptp(ends, axis=0) if len(ends) else np.zeros(2)) / SHADE_CELL)
        self.height = np.zeros((int(wide) + 1, int(deep) + 1))
        longest = np.ptp(corners[..., :2], axis=1).max(axis=1, initial=0.0)
        parts = np.maximum(1, np.ceil(2.0 * longest / SHADE_CELL).astype(int))
        for count in np.unique(parts):
            i, j = np.indices((count + 1, count + 1)).reshape(2, -1)
            i, j = i[i + j <= count] / count, j[i + j <= count] / count
            weights = np.stack([1.0 - i - j, i, j], axis=1)
            points = np.einsum('wk,tkx->twx', weights, corners[parts == count]).reshape(-1, 3)
            column, row = ((points[:, :2] - self.low) / SHADE_CELL).astype(int).T
            np.maximum.at(self.height, (column, row), points[:, 2])

    def below(self, points: Array) -> Array:
        """Return the height below points (k, 3), 0 beside the world and above points [m]."""
        cells = np.floor((points[:, :2] - self.low) / SHADE_CELL).astype(int)
        inside = ((cells >= 0) & (cells < self.height.shape)).all(axis=1)
        heights = np.zeros(len(points))
        heights[inside] = self.height[tuple(cells[inside].T)]
        return np.where(heights <= points[:, 2], heights, 0.0)


def pole_pieces(world: World) -> tuple[Array, Array]:
    """Return the poles of a world in pieces: their ends (k, 2, 3), and their radii (k,) [m]."""
    ends, radii = [np.zeros((0, 2, 3))], [np.zeros(0)]
    for row in solids_of(world).poles:
        start, end, radius = row[:3], row[3:6], row[6]
        count = max(1, round(float(np.linalg.norm(end - start)) / (2.0 * radius)))
        points = start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)
        ends.append(np.stack([points[:-1], points[1:]], axis=1))
        radii.append(np.full(count, radius))
    return np.concatenate(ends), np.concatenate(radii)


class Film:
    """The pictures of a run; their caption has a title, and the speed if it is not 1."""

    def __init__(self, trajectory: Trajectory, title: str, speed: float) -> None:
        robot, center = trajectory.scene.robot, trajectory.position
        self.trajectory = trajectory
        self.caption = [title] * bool(title) + [f'{speed:g}x'] * (speed != 1.0)
        bodies = bodies_of(robot)
        R = rotation_matrices(trajectory.orientation)[:, bodies.link]
        middle = center[:, bodies.link] + np.einsum('maij,aj->mai', R, bodies.center)
        # Lines without length are not drawn.
        arm = np.maximum(bodies.half, 1e-6)[:, None] * np.einsum('maij,aj->mai', R, bodies.axis)
        self.ends = np.stack([middle + arm, middle - arm], axis=2)
        # Links without extent are drawn thin.
        thin = 0.05 * robot.per_link('link_length')[bodies.link]
        radius = np.maximum(bodies.radius, thin)
        self.camera, self.middle, self.scale = best_view(self.ends, float(radius.max()))
        self.sun = SUN @ np.stack([self.camera[0], np.cross(UP, self.camera[0]), UP])
        x, y, wide = trajectory.scene.pegs.axes.T
        ends = [
            np.column_stack([x, y, z])
            for z in (wide / 2, np.maximum(2.2 * radius.max(), 2 * wide) - wide)
        ]
        self.tops = Tops(trajectory.scene.world)
        pieces, piece_radius = pole_pieces(trajectory.scene.world)
        self.pegs = np.concatenate([np.stack(ends, axis=1), pieces])
        wide = np.append(wide, piece_radius)
        self.radius = np.append(radius, wide)
        links = [COLORS[color_name(i)][:3] for i in bodies.link]
        paints = np.array(links + [PEG] * len(wide))
        self.paints = np.clip(paints[:, None] * LIGHT[:, None], 0.0, 1.0)
        low = float(radius[bodies.link == robot.middle_link].max())
        self.path = self.seen(center[:, robot.middle_link] - low * UP)
        friction = np.hypot(*trajectory.contact_force[:, :2].T)
        strong = float(np.quantile(friction, 0.95)) if len(friction) else 0.0
        self.arrow = LONGEST_ARROW * robot.per_link('link_length').sum() / max(strong, 1e-9)  # m/N
        self._set_stage()
        self._set_text()

    def seen(self, points: Array) -> Array:
        """Return points in I as seen by the camera: to the right and up from the origin [m]."""
        flat: Array = points @ self.camera[:2].T
        return flat

    def _set_stage(self) -> None:
        """Draw everything that stands still, and make the layers of everything that moves."""
        figure = Figure((SIZE[0] / DPI, SIZE[1] / DPI), DPI, facecolor=FLOOR)
        self.canvas, self.axes = FigureCanvasAgg(figure), figure.add_axes((0.0, 0.0, 1.0, 1.0))
        self.axes.set_axis_off()
        low, high = self.ends.min(axis=(0, 1, 2))[:2], self.ends.max(axis=(0, 1, 2))[:2]
        beyond = 2 * SIZE[0] / self.scale
        (x0, y0), (x1, y1) = (TILE * np.rint(at / TILE) for at in (low - beyond, high + beyond))
        tiles = [[(x, y0, 0.0), (x, y1, 0.0)] for x in np.arange(x0, x1, TILE)]
        tiles += [[(x0, y, 0.0), (x1, y, 0.0)] for y in np.arange(y0, y1, TILE)]
        faces, paints = ground_faces(self.trajectory.scene.ground, self.camera, self.sun)
        solids, of_solids = world_faces(self.trajectory.scene.world, self.camera, self.sun)
        round_lines: dict[str, Any] = {'segments': [], 'capstyle': 'round', 'snap': False}
        self.shadows = LineCollection(colors=SHADE, zorder=2, **round_lines)
        self.bodies = LineCollection(zorder=5, **round_lines)
        for layer in (
            LineCollection(list(self.seen(np.array(tiles))), colors=GROUT, lw=0.8, zorder=0),
            PolyCollection(list(self.seen(faces)), fc=paints, ec=paints, lw=0.5, zorder=1),
            PolyCollection(list(self.seen(solids)), fc=of_solids, ec=of_solids, lw=0.5, zorder=1),
            self.shadows,
            self.bodies,
        ):
            self.axes.add_collection(layer, autolim=False)
        (self.track,) = self.axes.plot([], [], color=PATH_COLOR, lw=1.5, zorder=3)
        self.arrows = self.axes.quiver([], [], [], [])

    def _set_text(self) -> None:
        """Draw the scale at the lower right, and make an empty caption at the lower left."""
        style: dict[str, Any] = {'xycoords': 'figure pixels', 'color': TEXT_COLOR, 'size': 9.4}
        right, left = SIZE[0] - GAP, SIZE[0] - GAP - BAR * self.scale
        bar = {'arrowstyle': '|-|,widthA=0.25,widthB=0.25', 'shrinkA': 0, 'shrinkB': 0}
        bar['color'] = TEXT_COLOR
        self.axes.annotate('', (left, GAP), (right, GAP), arrowprops=bar, **style)
        self.axes.annotate(f'{BAR:g} m', ((left + right) / 2, GAP + 5), ha='center', **style)
        self.text = self.axes.annotate('', (GAP, GAP), **style)

    def frame(self, k: int) -> Image.Image:
        """Return the picture of sample k."""
        self.draw(k)
        self.canvas.draw()
        return Image.fromarray(np.asarray(self.canvas.buffer_rgba())).convert('RGB')

    def draw(self, k: int) -> None:
        """Draw sample k in the figure."""
        (left, low), (right, high) = self.middle[k] + np.outer([-0.5, 0.5], SIZE / self.scale)
        self.axes.set(xlim=(left, right), ylim=(low, high))
        self.track.set_data(*self.path[: k + 1].T)
        bodies = np.concatenate([self.ends[k], self.pegs])
        self._draw_shadows(bodies)
        self._draw_bodies(bodies)
        self._draw_forces(*self.trajectory.contacts(k))
        self.text.set_text('   '.join([f't = {self.trajectory.time[k]:4.1f} s', *self.caption]))

    def _draw_bodies(self, bodies: Array) -> None:
        """Draw links and pegs, the farthest first, as strips from dark edges to bright lines."""
        order = np.argsort(bodies.mean(axis=1) @ self.camera[2])
        at, radius = bodies[order] @ self.camera.T, self.radius[order]
        along = at[:, 1] - at[:, 0]
        along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        half = self.camera @ self.sun / np.linalg.norm(self.sun) + [
            0.0,
            0.0,
            1.0,
        ]  # between light and viewer
        bright = half - (along @ half)[:, None] * along
        bright *= (radius / np.linalg.norm(bright, axis=1))[:, None]
        strips = at[:, None, :, :2] + STRIPS[:, None, None] * bright[:, None, None, :2]
        width = 2 * np.multiply.outer(radius, 1.0 - STRIPS) * self.scale * 72 / DPI
        colors = self.paints[order].reshape(-1, 3)
        self.bodies.set(segments=strips.reshape(-1, 2, 2), linewidths=width.ravel(), color=colors)

    def _draw_shadows(self, bodies: Array) -> None:
        """Draw shadows on the ground below each link and peg."""
        ground = self.trajectory.scene.ground
        floor = [cell_height(ground, *cell_at(ground, x, y)) for x, y, _ in bodies.mean(axis=1)]
        if self.trajectory.scene.world:
            floor = self.tops.below(bodies.mean(axis=1)).tolist()
        fall = np.eye(3) - np.outer(UP, self.sun)  # along the light, to z = 0
        lift = np.multiply.outer(floor, UP)[:, None]
        strips = self.seen((bodies - lift) @ fall + lift)
        # The shadow of a sphere is an ellipse: its width across the strip.
        along = strips[:, 1] - strips[:, 0]
        across = along[:, ::-1] * [-1.0, 1.0]
        across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
        width = 2 * self.radius * np.linalg.norm(across @ self.seen(fall).T, axis=1)
        self.shadows.set(segments=strips, linewidths=width * self.scale * 72 / DPI)

    def _draw_forces(self, points: Array, forces: Array) -> None:
        """Draw friction at the contacts as arrows: the horizontal part of the forces."""
        every = slice(None, None, 1 + len(points) // (MOST_ARROWS + 1))
        arrows = self.seen(forces[every] * [1.0, 1.0, 0.0] * self.arrow)
        long = np.linalg.norm(arrows, axis=1) * self.scale >= SHORTEST_ARROW
        self.arrows.remove()
        self.arrows = self.axes.quiver(
            *self.seen(points[every][long]).T, *arrows[long].T,
            angles='xy', scale_units='xy', scale=1, units='dots', width=2, headwidth=3.5,
            headlength=3.5, headaxislength=3.5, color=FORCE_COLOR, zorder=4,
        )  # fmt: skip
