"""
Runs as moving pictures: a GIF or an MP4 of the robot from obliquely above.

Pillow, which comes with matplotlib, draws lines and text and writes GIFs; matplotlib has the font.
An MP4 needs the program ffmpeg, of the system or of the package imageio-ffmpeg.
"""

from io import BytesIO
from itertools import chain
import math
from pathlib import Path
import shutil
import subprocess
from subprocess import PIPE
from tempfile import TemporaryDirectory
from tempfile import TemporaryFile

from matplotlib import get_data_path
import numpy as np
from PIL import Image
from PIL import ImageDraw
from PIL import ImageFont

from snake_sim_ros import orthographic
from snake_sim_ros.orthographic import best_camera
from snake_sim_ros.orthographic import Camera
from snake_sim_ros.orthographic import Picture
from snake_sim_ros.parameters import Array
from snake_sim_ros.parameters import Scene
from snake_sim_ros.records import ParameterError
from snake_sim_ros.robot_description import COLORS
from snake_sim_ros.rotations import rotation_matrices
from snake_sim_ros.trajectory import Trajectory

SIZE = 640, 360  # pixels, both even: MP4 has one value of color for four pixels
FINE = 2  # drawn larger, so that edges are smooth
DELAYS = {'.gif': 60, '.mp4': 25}  # ms from frame to frame; whole 1/100 s in a GIF
PALETTE = 64  # colors of a GIF
FARTHEST = 3.0  # widths of a robot that a picture shows, beyond that it follows the robot
PATH_COLOR, FORCE_COLOR, TEXT_COLOR = (0, 114, 178), (213, 94, 0), (70, 70, 70)
LONGEST = 0.2  # lengths of the robot, arrow of a force that few forces exceed
ARROWS = 24  # at most; of more contacts every second, third... has one
BAND = 28  # pixels at the lower edge, for text
BAR = 0.5  # m, the scale


def animate(trajectory: Trajectory, path: Path, title: str = '', speed: float = 1.0) -> None:
    """
    Write a run as a GIF or an MP4, whole or not at all.

    Parameters
    ----------
    trajectory : Trajectory
    path : Path
        Its suffix, .gif or .mp4, says which of them.
    title : str, optional
        What is written beside the time.
    speed : float, optional
        Seconds of the run in a second of the animation.

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
    shown = frame_samples(trajectory.time, speed * delay / 1000)
    if path.suffix == '.gif':
        _write_gif(path, Film(trajectory, title, speed), shown)
    else:
        program = ffmpeg()
        _write_mp4(path, Film(trajectory, title, speed), shown, program)


def frame_samples(time: Array, period: float) -> Array:
    """Return the samples nearest to the times that are whole periods [s] after the first."""
    times = time[0] + period * np.arange(math.floor((time[-1] - time[0]) / period + 1e-6) + 1)
    after = np.searchsorted(time, times).clip(1, max(len(time) - 1, 1))
    earlier = times - time[after - 1] <= time[after % len(time)] - times
    nearest: Array = after - earlier.astype(int)
    return nearest


class Film:
    """
    The pictures of a run.

    Parameters
    ----------
    trajectory : Trajectory
    title : str
    speed : float

    """

    def __init__(self, trajectory: Trajectory, title: str, speed: float) -> None:
        robot = trajectory.scene.robot
        self.trajectory = trajectory
        self.caption = [title] * bool(title) + [f'{speed:g}x'] * (speed != 1.0)
        arm = (
            robot.per_link('contact_offset')[:, None]
            * (rotation_matrices(trajectory.orientation)[..., 2])
        )
        center = trajectory.position
        self.ends = np.stack([center + arm, center - arm], axis=2)
        # Links without extent are drawn thin.
        thin = 0.05 * robot.per_link('link_length')
        self.radius = np.maximum(robot.per_link('contact_radius'), thin)
        kinds = ['head'] + [('odd', 'even')[i % 2] for i in range(1, robot.link_count)]
        self.colors = [255 * np.array(COLORS[kind][:3], dtype=np.float32) for kind in kinds]
        below = robot.per_link('contact_radius')[robot.middle_link] * np.array([0.0, 0.0, 1.0])
        self.path = center[:, robot.middle_link] - below
        friction = np.hypot(*trajectory.contact_force[:, :2].T)
        strong = float(np.quantile(friction, 0.95)) if len(friction) else 0.0
        length = float(robot.per_link('link_length').sum())
        self.arrow = LONGEST * length / max(strong, 1e-9)  # m/N
        self.cameras = cameras(self.ends, float(self.radius.max()))
        file = Path(get_data_path()) / 'fonts' / 'ttf' / 'DejaVuSans.ttf'
        self.font = ImageFont.truetype(str(file), 13 * FINE)
        self._still: Picture | None = None
        self._pegs = np.zeros(0, dtype=bool)

    def frame(self, k: int) -> Image.Image:
        """Return the picture of sample k."""
        still = self._stage(self.cameras[k % len(self.cameras)])
        picture, camera = still.copy(), still.camera
        image = Image.fromarray(picture.color)
        draw = ImageDraw.Draw(image)
        track = camera.pixels(self.path[: k + 1])
        draw.line(list(map(tuple, track)), fill=PATH_COLOR, width=2 * FINE, joint='curve')
        self._draw_forces(draw, camera, k)
        picture.color[:] = np.where(self._pegs[..., None], still.color, np.asarray(image))
        floor = min([0.0, *chain.from_iterable(self.trajectory.scene.ground.heights)])
        picture.darken(orthographic.shadow(still, floor, self.ends[k], self.radius))
        for ends, radius, color in zip(self.ends[k], self.radius, self.colors, strict=True):
            orthographic.draw_capsule(picture, ends, radius, color)
        image = Image.fromarray(picture.color)
        self._draw_text(ImageDraw.Draw(image), camera, float(self.trajectory.time[k]))
        return image.reduce(FINE)

    def _stage(self, camera: Camera) -> Picture:
        """Return what stands still, drawn anew only for another camera."""
        if self._still is None or self._still.camera != camera:
            top = 2.2 * float(self.radius.max())
            self._still, self._pegs = stage(camera, self.trajectory.scene, top)
        return self._still

    def _draw_forces(self, draw: ImageDraw.ImageDraw, camera: Camera, k: int) -> None:
        """Draw friction at the contacts as arrows: the horizontal part of the forces."""
        points, forces = self.trajectory.contacts(k)
        every = slice(None, None, 1 + len(points) // (ARROWS + 1))
        for point, force in zip(points[every], forces[every], strict=True):
            along = np.array([force[0], force[1], 0.0]) * self.arrow
            tail, tip = camera.pixels(np.stack([point, point + along]))
            length = float(np.linalg.norm(tip - tail))
            if length < 8 * FINE:
                continue
            ahead = (tip - tail) / length
            side = np.array([-ahead[1], ahead[0]])
            neck = tip - 7 * FINE * ahead
            draw.line([*tail, *neck], fill=FORCE_COLOR, width=2 * FINE)
            corners = [tip, neck + 3.5 * FINE * side, neck - 3.5 * FINE * side]
            draw.polygon([tuple(corner) for corner in corners], fill=FORCE_COLOR)

    def _draw_text(self, draw: ImageDraw.ImageDraw, camera: Camera, time: float) -> None:
        """Draw time and title at the lower left, and the scale at the lower right."""
        (width, tall), gap = camera.size, 12 * FINE
        text = '   '.join([f't = {time:4.1f} s', *self.caption])
        draw.text((gap, tall - gap), text, fill=TEXT_COLOR, font=self.font, anchor='ls')
        bar = BAR * camera.scale
        left, right, y = width - gap - bar, width - gap, tall - gap
        draw.line([left, y, right, y], fill=TEXT_COLOR, width=FINE)
        for x in (left, right):
            draw.line([x, y - 3 * FINE, x, y + 3 * FINE], fill=TEXT_COLOR, width=FINE)
        middle = ((left + right) / 2, y - 5 * FINE)
        draw.text(middle, f'{BAR:g} m', fill=TEXT_COLOR, font=self.font, anchor='ms')


def cameras(ends: Array, radius: float) -> list[Camera]:
    """
    Return one camera that sees a whole run, or one for each sample that follows the robot.

    Parameters
    ----------
    ends : ndarray, shape (m, n, 2, 3)
        Of the axes of all links, in I [m].
    radius : float
        Largest of a link [m].

    """
    size = SIZE[0] * FINE, SIZE[1] * FINE
    middle = ends.mean(axis=(1, 2))
    forward = middle[-1] - middle[0]
    few = np.unique(np.linspace(0, len(ends) - 1, 200).round().astype(int))
    points = ends[few].reshape(-1, 3)
    camera = best_camera(points, forward, size, 2 * radius, BAND * FINE)
    spans = np.ptp(ends, axis=1).max(axis=(1, 2))
    widest = FARTHEST * (float(spans.max()) + 2 * radius)
    if size[0] / camera.scale <= widest:
        return [camera]
    seen = middle @ camera.axes[:2].T
    k = min(len(seen), max(1, len(seen) // 8))
    padded = np.pad(seen, ((k // 2, k - 1 - k // 2), (0, 0)), mode='edge')
    total = np.cumsum(np.pad(padded, ((1, 0), (0, 0))), axis=0)
    smooth = (total[k:] - total[:-k]) / k
    scale = size[0] / widest
    return [Camera(camera.azimuth, (float(u), float(v)), scale, size) for u, v in smooth]


def stage(camera: Camera, scene: Scene, top: float) -> tuple[Picture, Array]:
    """
    Return a picture of what stands still, and which of its pixels are of pegs.

    What lies on the floor is behind pegs wherever both are on one pixel.

    Parameters
    ----------
    camera : Camera
    scene : Scene
    top : float
        Height of the pegs [m].

    """
    picture = orthographic.empty_floor(camera)
    orthographic.draw_ground(picture, scene.ground)
    pegs = [(np.array([[x, y, 0.0], [x, y, top - r]]), r) for x, y, r in scene.pegs.axes]
    if pegs:
        axes, radii = map(np.array, zip(*pegs, strict=True))
        picture.darken(orthographic.shadow(picture, 0.0, axes, radii))
    before = picture.depth.copy()
    for x, y, radius in scene.pegs.axes:
        orthographic.draw_peg(picture, x, y, radius, top)
    return picture, picture.depth > before


def _write_gif(path: Path, film: Film, samples: Array) -> None:
    """Write an endless GIF, all of its frames in the same colors."""
    some = samples[np.unique(np.linspace(0, len(samples) - 1, 4).astype(int))]
    paints = [np.multiply(color[:3], 255) for color in COLORS.values()]
    paints += [np.array(PATH_COLOR), np.array(FORCE_COLOR)]
    ramps = [(np.linspace(0.4, 1.2, 16)[:, None] * paint).clip(0, 255) for paint in paints]
    swatch = np.repeat(np.concatenate(ramps)[:, None], SIZE[0], axis=1).astype(np.uint8)
    sheet = np.concatenate([swatch, *(np.asarray(film.frame(k)) for k in some)])
    palette = Image.fromarray(sheet).quantize(PALETTE, kmeans=1, dither=Image.Dither.NONE)
    frames = (film.frame(k).quantize(palette=palette, dither=Image.Dither.NONE) for k in samples)
    buffer = BytesIO()
    next(frames).save(
        buffer,
        format='GIF',
        save_all=True,
        append_images=frames,
        duration=DELAYS['.gif'],
        loop=0,
        disposal=1,
    )
    path.write_bytes(buffer.getvalue())


def ffmpeg() -> str:
    """Return the program that makes an MP4: that of imageio-ffmpeg, or of the system."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        return str(get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        found = shutil.which('ffmpeg')
    if found is None:
        raise ParameterError('an .mp4 needs ffmpeg, which is not here: pip install imageio-ffmpeg')
    return found


def _write_mp4(path: Path, film: Film, samples: Array, program: str) -> None:
    """Write an MP4 that every browser plays."""
    width, tall = SIZE
    command = [program, '-loglevel', 'error', '-f', 'rawvideo', '-pix_fmt', 'rgb24']
    command += ['-s', f'{width}x{tall}', '-r', str(1000 // DELAYS['.mp4']), '-i', '-']
    command += ['-c:v', 'libx264', '-crf', '20', '-pix_fmt', 'yuv420p', '-movflags', '+faststart']
    with TemporaryDirectory() as folder, TemporaryFile() as said:
        whole = Path(folder) / 'animation.mp4'
        with subprocess.Popen([*command, str(whole)], stdin=PIPE, stderr=said) as process:
            assert process.stdin is not None
            try:
                for k in samples:
                    process.stdin.write(film.frame(k).tobytes())
                process.stdin.close()
            except BrokenPipeError:
                pass  # it says why, see below
        if process.returncode:
            said.seek(0)
            reason = said.read().decode(errors='replace').strip().partition('\n')[0]
            raise ParameterError(f'{program} could not make an MP4: {reason}')
        shutil.move(whole, path)
