"""
Pictures of robots, pegs and ground from obliquely above, in parallel projection.

A ray goes through every pixel, and is cut with spheres, cylinders and boxes in closed form: what
is nearer hides what is farther, and shadows fall where they fall. All of it is NumPy on the few
pixels around each body. Camera coordinates are right, up, and toward the viewer [m].
"""

from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from snake_sim_ros.parameters import Array
from snake_sim_ros.parameters import Ground
from snake_sim_ros.scenery import height

ELEVATION = math.radians(38.0)
SUN = (-0.55, 0.45, 1.0)  # to the right, away from the viewer, upward: where the light is from
AMBIENT, DIFFUSE, GLOSS = 0.50, 0.58, 0.32
SHADE = 0.42  # what a shadow takes away
PENUMBRA = 0.15  # width of the edge of a shadow over the radius of what casts it
FLOOR, GROUT, BOX, PEG = (
    np.array(color, dtype=np.float32)
    for color in [(242, 239, 232), (222, 218, 209), (214, 206, 192), (110, 140, 165)]
)
TILE = 0.5  # m, squares of the floor, with thin lines at every fifth of it
Window = tuple[slice, slice]  # rows and columns of a picture


@dataclass(frozen=True)
class Camera:
    """
    Where a picture is taken from.

    Attributes
    ----------
    azimuth : float
        From e_x of I to what is to the right in the picture, about e_z [rad].
    center : tuple of float
        What is in the middle of the picture, to the right and up from the origin of I [m].
    scale : float
        Pixels to a meter.
    size : tuple of int
        Width and height [pixels].

    """

    azimuth: float
    center: tuple[float, float]
    scale: float
    size: tuple[int, int]

    @cached_property
    def axes(self) -> Array:
        """Directions to the right, up, and toward the viewer, in I, shape (3, 3)."""
        c, s = math.cos(self.azimuth), math.sin(self.azimuth)
        ce, se = math.cos(ELEVATION), math.sin(ELEVATION)
        return np.array([[c, s, 0.0], [-s * se, c * se, ce], [s * ce, -c * ce, se]])

    @cached_property
    def sun(self) -> Array:
        """Direction to the light, in camera coordinates, shape (3,)."""
        right, away, up = SUN
        c, s = math.cos(self.azimuth), math.sin(self.azimuth)
        direction = self.axes @ [right * c - away * s, right * s + away * c, up]
        toward_sun: Array = direction / np.linalg.norm(direction)
        return toward_sun

    def pixels(self, points: Array) -> Array:
        """Return columns and rows of points in I, shape (..., 2)."""
        return self._pixels(points @ self.axes.T)

    def window(self, points: Array, margin: float) -> Window:
        """Return the pixels around points in camera coordinates, with a margin [m]."""
        pixels = self._pixels(points)
        low = np.floor(pixels.min(axis=0) - margin * self.scale).astype(int)
        high = np.ceil(pixels.max(axis=0) + margin * self.scale).astype(int) + 1
        low, high = (np.clip(end, 0, self.size) for end in (low, high))
        return slice(low[1], high[1]), slice(low[0], high[0])

    def rays(self, window: Window) -> tuple[Array, Array]:
        """Return where the rays of pixels are: to the right, shape (1, m), and up, (k, 1) [m]."""
        rows, columns = window
        width, tall = self.size
        u = (np.arange(columns.start, columns.stop) + 0.5 - width / 2) / self.scale
        v = (tall / 2 - np.arange(rows.start, rows.stop) - 0.5) / self.scale
        u, v = u + self.center[0], v + self.center[1]
        return u[None, :].astype(np.float32), v[:, None].astype(np.float32)

    def _pixels(self, points: Array) -> Array:
        across = (points[..., :2] - self.center) * self.scale
        return np.array(self.size) / 2 + across * [1.0, -1.0]


@dataclass(frozen=True)
class Picture:
    """
    What a camera sees.

    Attributes
    ----------
    camera : Camera
    color : ndarray of uint8, shape (height, width, 3)
    depth : ndarray, shape (height, width)
        How far toward the viewer what is seen is [m].

    """

    camera: Camera
    color: Array
    depth: Array

    def copy(self) -> 'Picture':
        """Return another picture of the same, to draw on."""
        return Picture(self.camera, self.color.copy(), self.depth.copy())

    def paint(self, window: Window, depth: Array, normal: Array, color: Array) -> None:
        """Draw a surface where it is nearer; colors as light falls on it, shape (..., 3)."""
        nearer = depth > self.depth[window]
        half = self.camera.sun + np.array([0.0, 0.0, 1.0])
        shine = np.clip(normal @ (half / np.linalg.norm(half)).astype(np.float32), 0.0, 1.0) ** 24
        light = AMBIENT + DIFFUSE * np.clip(normal @ self.camera.sun.astype(np.float32), 0.0, 1.0)
        shaded = color * light[..., None] + 255.0 * GLOSS * shine[..., None]
        self.depth[window][nearer] = depth[nearer]
        self.color[window][nearer] = np.clip(shaded, 0.0, 255.0)[nearer].astype(np.uint8)

    def darken(self, dark: Array) -> None:
        """Draw a shadow, from 0 to 1 on each pixel."""
        rows, columns = (np.flatnonzero(np.any(dark, axis=axis)) for axis in (1, 0))
        if len(rows):
            window = slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)
            light = 1.0 - SHADE * dark[window][..., None]
            self.color[window] = (self.color[window] * light).astype(np.uint8)


def empty_floor(camera: Camera) -> Picture:
    """Return a picture of the floor z = 0, with tiles."""
    whole = slice(0, camera.size[1]), slice(0, camera.size[0])
    u, v = camera.rays(whole)
    up, toward = camera.axes[1], camera.axes[2]
    depth = np.broadcast_to(-v * np.float32(up[2] / toward[2]), (v.size, u.size)).copy()
    strength = np.zeros_like(depth)
    for side, width, dark in ((TILE / 5, 0.7, 0.35), (TILE, 1.4, 1.0)):
        for axis in (0, 1):
            slope = up[axis] - toward[axis] * up[2] / toward[2]
            tiles = u * np.float32(camera.axes[0, axis] / side) + v * np.float32(slope / side)
            off = np.abs(tiles - np.rint(tiles)) * np.float32(side * camera.scale)
            np.maximum(strength, dark * np.clip(width + 0.5 - off, 0.0, 1.0), out=strength)
    color = FLOOR + strength[..., None] * (GROUT - FLOOR)
    return Picture(camera, color.astype(np.uint8), depth)


def draw_ground(picture: Picture, ground: Ground) -> None:
    """Draw the cells of a ground as boxes."""
    lowest = min([0.0, *(min(row) for row in ground.heights)])
    for row, column in np.ndindex(len(ground.heights), len((ground.heights or ((),))[0])):
        top = height(ground, column, row)
        if top:
            x, y = np.array(ground.origin) + ground.cell * np.array([column, row])
            low = np.array([x, y, min(lowest, 0.0) - ground.cell])
            _draw_box(picture, low, np.array([x + ground.cell, y + ground.cell, top]))


def _draw_box(picture: Picture, low: Array, high: Array) -> None:
    camera = picture.camera
    corners = np.array(np.meshgrid(*zip(low, high, strict=True))).reshape(3, 8).T
    window = camera.window(corners @ camera.axes.T, 0.0)
    u, v = camera.rays(window)
    # Sides that face the viewer: a ray enters through the one it meets last, and leaves after it.
    toward = camera.axes[2]
    foot = u[..., None] * camera.axes[0] + v[..., None] * camera.axes[1]
    slabs = np.where(np.abs(toward) < 1e-9, 1e-9, toward)
    ends = np.stack([(low - foot) / slabs, (high - foot) / slabs])
    first, last = ends.max(axis=0), ends.min(axis=0)
    side = first.argmin(axis=-1)
    depth = first.min(axis=-1)
    depth = np.where(depth >= last.max(axis=-1), depth, -np.inf).astype(np.float32)
    normal = (np.sign(toward)[:, None] * camera.axes.T)[side].astype(np.float32)
    picture.paint(window, depth, normal, BOX)


def draw_peg(picture: Picture, x: float, y: float, radius: float, top: float) -> None:
    """Draw a peg as a cylinder that ends at a height [m]."""
    camera = picture.camera
    foot, head = (np.array([x, y, z]) @ camera.axes.T for z in (0.0, top))
    window = camera.window(np.stack([foot, head]), radius)
    u, v = camera.rays(window)
    depth, normal = _tube(u, v, foot, head, radius)
    picture.paint(window, depth, normal, PEG)
    upward = camera.axes[:, 2]
    disk = head[2] - ((u - head[0]) * upward[0] + (v - head[1]) * upward[1]) / upward[2]
    apart = (u - head[0]) ** 2 + (v - head[1]) ** 2 + (disk - head[2]) ** 2
    disk = np.where(apart <= radius**2, disk, -np.inf).astype(np.float32)
    flat = np.broadcast_to(upward.astype(np.float32), (*disk.shape, 3))
    picture.paint(window, disk, flat, PEG)


def draw_capsule(picture: Picture, ends: Array, radius: float, color: Array) -> None:
    """Draw a cylinder with round ends between two points in I, shape (2, 3)."""
    camera = picture.camera
    first, last = ends @ camera.axes.T
    window = camera.window(np.stack([first, last]), radius)
    u, v = camera.rays(window)
    depth, normal = _tube(u, v, first, last, radius)
    for center in (first, last):
        apart = radius**2 - (u - center[0]) ** 2 - (v - center[1]) ** 2
        ball = center[2] + np.sqrt(np.where(apart >= 0.0, apart, np.nan))
        nearer = ball > depth
        out = np.stack(np.broadcast_arrays(u - center[0], v - center[1], ball - center[2]), -1)
        normal[nearer] = out[nearer] / radius
        depth[nearer] = ball[nearer]
    picture.paint(window, depth, normal, color)


def _tube(u: Array, v: Array, first: Array, last: Array, radius: float) -> tuple[Array, Array]:
    """Return depths and normals of a cylinder without ends; -inf where a ray misses it."""
    length = float(np.linalg.norm(last - first))
    d = ((last - first) / length if length > 0.0 else np.array([0.0, 0.0, 1.0])).astype(np.float32)
    a, b = u - np.float32(first[0]), v - np.float32(first[1])
    along = a * d[0] + b * d[1]
    square = max(1.0 - float(d[2]) ** 2, 1e-9)
    half = along * d[2]
    inside = half**2 - square * (a**2 + b**2 - along**2 - np.float32(radius) ** 2)
    c = (half + np.sqrt(np.maximum(inside, 0.0))) / np.float32(square)
    s = along + c * d[2]
    hit = (inside >= 0.0) & (s >= 0.0) & (s <= length)
    normal = np.stack([a - s * d[0], b - s * d[1], c - s * d[2]], axis=-1) / np.float32(radius)
    return np.where(hit, c + np.float32(first[2]), -np.inf).astype(np.float32), normal


def shadow(still: Picture, floor: float, links: Array, radius: Array) -> Array:
    """
    Return how much shadow of capsules falls on each pixel of what stands still, from 0 to 1.

    Parameters
    ----------
    still : Picture
    floor : float
        Height of the deepest ground [m].
    links : ndarray, shape (n, 2, 3)
        Ends of their axes, in I [m].
    radius : ndarray, shape (n,)
        [m]

    """
    camera = still.camera
    dark = np.zeros(still.depth.shape, dtype=np.float32)
    sun = camera.sun
    e_1 = np.cross(sun, [1.0, 0.0, 0.0])
    e_1 /= np.linalg.norm(e_1)
    plane = np.stack([e_1, np.cross(sun, e_1)]).astype(np.float32)  # seen from the sun
    steep = sun @ camera.axes[:, 2]
    for ends, r in zip(links, radius, strict=True):
        at = ends @ camera.axes.T
        dropped = at - ((ends[:, 2:] - floor) / steep) * sun
        window = camera.window(np.concatenate([at, dropped]), r / steep)
        u, v = camera.rays(window)
        points = np.stack(np.broadcast_arrays(u, v, still.depth[window]), axis=-1)
        p, (a, b) = points @ plane.T, (at @ plane.T).astype(np.float32)
        axis = b - a
        s = np.clip((p - a) @ axis / max(float(axis @ axis), 1e-12), 0.0, 1.0)
        apart = np.hypot(*np.moveaxis(p - a - s[..., None] * axis, -1, 0))
        mask = np.clip((r - apart) / (PENUMBRA * r) + 0.5, 0.0, 1.0)
        mask[points @ sun.astype(np.float32) > (at @ sun).max()] = 0.0  # above what casts it
        dark[window] = np.maximum(dark[window], mask)
    return dark


def best_camera(
    points: Array, forward: Array, size: tuple[int, int], margin: float, band: int
) -> Camera:
    """
    Return the camera that sees points largest, with what moves going to the right.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
    forward : ndarray, shape (3,)
        Where everything goes.
    size : tuple of int
    margin : float
        Around the points [m].
    band : int
        Pixels at the lower edge that the points are kept out of.

    """
    found = []
    for azimuth in np.radians(np.arange(0.0, 360.0, 5.0)):
        camera = Camera(float(azimuth), (0.0, 0.0), 1.0, size)
        seen = points @ camera.axes[:2].T
        low, high = seen.min(axis=0) - margin, seen.max(axis=0) + margin
        scale = float(((np.array(size) - [0, band]) / (high - low)).min())
        u, v = ((low + high) / 2 - [0.0, band / scale / 2]).tolist()
        right = float(camera.axes[0] @ forward)
        found.append((right >= -1e-9, scale, Camera(float(azimuth), (u, v), scale, size)))
    return max(found, key=lambda item: item[:2])[2]
