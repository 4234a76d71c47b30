# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What stands on the floor of a scene: boxes, stairs, ramps, poles, pipes, height fields, meshes.

The records are the section `world` of a scene. `solids_of` makes of them the four kinds of solids
that detection and pictures know: boxes, poles, pipes and triangles. The floor z = 0 goes on below
all of them, so that nothing in a world is lower. `contact.surroundings` finds the contacts.
"""

from dataclasses import dataclass
from functools import lru_cache
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from snake_sim_ros.scene.chain import Array, roll_pitch_yaw
from snake_sim_ros.scene.checked_records import (
    check_components,
    CheckedRecord,
    cut,
    LONGEST_PATH,
    LONGEST_REASON,
    ParameterError,
    quantity,
)
from snake_sim_ros.scene.files import is_file
from snake_sim_ros.scene.gait import Numbers

FOUNDATION = 0.01  # how far solids that stand on the floor reach into it [m]
THINNEST = 1e-4  # least size of a solid [m]
FLATTEST = 1e-12  # twice the area of a triangle that counts [m^2]
MOST_POINTS = 4e6  # of an egg crate
NOWHERE = (0.0, 0.0, 0.0)


def _grip() -> Any:
    return quantity(1.0, '1', 'factor of the friction of the floor', minimum=0, maximum=1e6)


@dataclass(frozen=True, kw_only=True)
class Box(CheckedRecord):
    """A box in any place and orientation, given by the lengths of its sides."""

    center: Numbers = quantity(NOWHERE, 'm', 'center of the box')
    size: Numbers = quantity((0.1, 0.1, 0.1), 'm', 'lengths of its sides', minimum=THINNEST)
    rpy: Numbers = quantity(NOWHERE, 'rad', 'roll, pitch and yaw of the box, as in URDF')
    grip: float = _grip()

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        for name in ('center', 'size', 'rpy'):
            check_components(name, getattr(self, name), 3)


@dataclass(frozen=True, kw_only=True)
class Pole(CheckedRecord):
    """A round bar in any direction, with half balls as its ends."""

    start: Numbers = quantity(NOWHERE, 'm', 'one end of its axis')
    end: Numbers = quantity((0.0, 0.0, 1.0), 'm', 'the other end')
    radius: float = quantity(0.05, 'm', 'its radius', minimum=THINNEST)
    grip: float = _grip()

    def __post_init__(self) -> None:
        """Check every field, and that it has a length."""
        super().__post_init__()
        _check_axis(self.start, self.end)


@dataclass(frozen=True, kw_only=True)
class Pipe(CheckedRecord):
    """A round tube in any direction, open at both ends, to climb outside or to creep inside."""

    start: Numbers = quantity(NOWHERE, 'm', 'middle of one end')
    end: Numbers = quantity((0.0, 0.0, 1.0), 'm', 'middle of the other end')
    radius: float = quantity(0.15, 'm', 'outer radius', minimum=THINNEST)
    inner: float = quantity(0.14, 'm', 'inner radius', minimum=THINNEST)
    grip: float = _grip()

    def __post_init__(self) -> None:
        """Check every field, that it has a length, and a wall."""
        super().__post_init__()
        _check_axis(self.start, self.end)
        if self.radius - self.inner < THINNEST:
            raise ParameterError(
                f'inner must be at least {THINNEST:g} m below radius, {self.radius:g} m, '
                f'got {self.inner:g} m'
            )


def _check_axis(start: Numbers, end: Numbers) -> None:
    """Raise an error if the ends of an axis are no points or not apart."""
    check_components('start', start, 3)
    check_components('end', end, 3)
    if math.dist(start, end) < THINNEST:
        raise ParameterError(
            f'start and end must be at least {THINNEST:g} m apart, got {math.dist(start, end):g} m'
        )


@dataclass(frozen=True, kw_only=True)
class Stairs(CheckedRecord):
    """Steps of one height, which lead up from `start` in the direction `heading`."""

    count: int = quantity(5, '1', 'number of steps', minimum=1, maximum=10_000)
    rise: float = quantity(0.1, 'm', 'height of a step', minimum=THINNEST)
    run: float = quantity(0.3, 'm', 'depth of a step', minimum=THINNEST)
    width: float = quantity(1.0, 'm', 'width of the stairs', minimum=THINNEST)
    start: Numbers = quantity(NOWHERE, 'm', 'middle of the lower edge of the first step')
    heading: float = quantity(0.0, 'rad', 'direction in which they lead up, from the x axis')
    landing: float = quantity(0.0, 'm', 'by how much the last step is deeper', minimum=0)
    grip: float = _grip()

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        check_components('start', self.start, 3)


@dataclass(frozen=True, kw_only=True)
class Ramp(CheckedRecord):
    """A wedge, which leads up from `start` in the direction `heading`."""

    run: float = quantity(1.0, 'm', 'its length, seen from above', minimum=THINNEST)
    rise: float = quantity(0.2, 'm', 'its height at the end', minimum=THINNEST)
    width: float = quantity(1.0, 'm', 'its width', minimum=THINNEST)
    start: Numbers = quantity(NOWHERE, 'm', 'middle of its lower edge')
    heading: float = quantity(0.0, 'rad', 'direction in which it leads up, from the x axis')
    grip: float = _grip()

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        check_components('start', self.start, 3)


@dataclass(frozen=True, kw_only=True)
class HeightField(CheckedRecord):
    """
    Ground whose heights are given on a grid of points, with two triangles between four of them.

    The heights are nested lists, or those of a file: an .npz with an array `heights`, or a .png,
    whose white is `white` high and whose first row has the largest y.
    """

    heights: tuple[Numbers, ...] = quantity(
        (), 'm', 'heights of the points: along x in a row, the rows along y', minimum=0
    )
    file: str = quantity('', '', 'file of the heights, .npz or .png, instead of `heights`')
    white: float = quantity(0.1, 'm', 'height of white in a .png', minimum=0)
    cell: float = quantity(0.05, 'm', 'distance of neighboring points', minimum=THINNEST)
    origin: Numbers = quantity((0.0, 0.0), 'm', 'x and y of the first point')
    grip: float = _grip()

    def __post_init__(self) -> None:
        """Check every field, and that heights are a grid of four points at least."""
        super().__post_init__()
        check_components('origin', self.origin, 2)
        if self.heights and self.file:
            raise ParameterError('heights and file cannot both be given')
        lengths = sorted({len(row) for row in self.heights})
        if len(lengths) > 1:
            raise ParameterError(
                f'heights must be rows of one length, got rows of {lengths[0]} and of '
                f'{lengths[-1]} numbers'
            )
        if self.heights and min(len(self.heights), lengths[0]) < 2:
            raise ParameterError(
                f'heights must be 2 rows of 2 numbers at least, got {len(self.heights)} of '
                f'{lengths[0]}'
            )
        if self.file and Path(self.file).suffix.lower() not in ('.npz', '.png'):
            raise ParameterError(f'file must end in .npz or .png, got {cut(self.file)}')

    def points(self) -> Array:
        """Return the heights of the points, shape (rows, columns) [m]."""
        if not self.file:
            return np.array(self.heights, dtype=float).reshape(len(self.heights), -1)
        heights = _heights_of(Path(self.file), self.white)
        if heights.ndim != 2 or min(heights.shape) < 2:
            raise ParameterError(
                f'{cut(self.file, LONGEST_PATH)}: heights must have the shape (rows, columns) of '
                f'2 at least, got {heights.shape}'
            )
        if not (np.isfinite(heights).all() and heights.min() >= 0.0):
            raise ParameterError(
                f'{cut(self.file, LONGEST_PATH)}: heights must be at least 0 m, got '
                f'{heights.min():g} m'
            )
        return heights


@dataclass(frozen=True, kw_only=True)
class EggCrate(CheckedRecord):
    """
    Ground of waves along x and y, ``a (1 + sin(2 pi x/l) sin(2 pi y/l))``, as a height field.

    It has its lowest places on the floor, and walls around it.
    """

    amplitude: float = quantity(0.02, 'm', 'amplitude a', minimum=0, maximum=10)
    wavelength: float = quantity(0.4, 'm', 'wavelength l', minimum=0.01)
    center: Numbers = quantity((0.0, 0.0), 'm', 'x and y of its center')
    size: Numbers = quantity((4.0, 4.0), 'm', 'lengths along x and y', minimum=0.01, maximum=1e3)
    cell: float = quantity(0.05, 'm', 'distance of neighboring points', minimum=0.001)
    grip: float = _grip()

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        check_components('center', self.center, 2)
        check_components('size', self.size, 2)
        points = (self.size[0] / self.cell + 1) * (self.size[1] / self.cell + 1)
        if points > MOST_POINTS:
            raise ParameterError(
                f'an egg crate must have at most {MOST_POINTS:g} points, got {points:.3g}'
            )


def _heights_of(path: Path, white: float) -> Array:
    """Return the heights in a file [m]."""
    name = cut(str(path), LONGEST_PATH)
    try:
        if path.suffix.lower() == '.npz':
            with np.load(path, allow_pickle=False) as file:
                return np.asarray(file['heights'], dtype=float)
        from PIL import Image
    except ImportError:
        raise ParameterError(f"{name} needs pillow: pip install 'snake_sim_ros[plots]'") from None
    except Exception as error:  # whatever NumPy raises for broken files
        raise ParameterError(f'{name}: {cut(str(error), LONGEST_REASON)}') from None
    try:
        with Image.open(path) as image:
            deep = image.mode.startswith('I')
            gray = np.asarray(image if deep else image.convert('L'), dtype=float)
    except Exception as error:  # whatever pillow raises for broken files
        raise ParameterError(f'{name}: {cut(str(error), LONGEST_REASON)}') from None
    return gray[::-1] * (white / (65535.0 if deep else 255.0))


@dataclass(frozen=True, kw_only=True)
class TriangleMesh(CheckedRecord):
    """
    A solid of triangles from a file, such as .stl or .obj; its normals point outward.

    An open mesh is a sheet that is touched from the side of its normals.
    """

    file: str = quantity('', '', 'file of the mesh')
    scale: float = quantity(1.0, '1', 'factor of its coordinates', above=0)
    position: Numbers = quantity(NOWHERE, 'm', 'where the origin of its coordinates is')
    rpy: Numbers = quantity(NOWHERE, 'rad', 'roll, pitch and yaw of the mesh, as in URDF')
    grip: float = _grip()

    def __post_init__(self) -> None:
        """Check every field."""
        super().__post_init__()
        check_components('position', self.position, 3)
        check_components('rpy', self.rpy, 3)
        if not self.file:
            raise ParameterError('file must be that of a mesh, got none')


@dataclass(frozen=True, kw_only=True)
class World(CheckedRecord):
    """Solids on the floor. Each has a factor of the friction of the floor, its `grip`."""

    boxes: tuple[Box, ...] = quantity((), '', 'boxes')
    stairs: tuple[Stairs, ...] = quantity((), '', 'stairs')
    ramps: tuple[Ramp, ...] = quantity((), '', 'ramps')
    poles: tuple[Pole, ...] = quantity((), '', 'round bars')
    pipes: tuple[Pipe, ...] = quantity((), '', 'tubes')
    height_fields: tuple[HeightField, ...] = quantity((), '', 'ground given by heights on a grid')
    egg_crates: tuple[EggCrate, ...] = quantity((), '', 'ground of waves')
    meshes: tuple[TriangleMesh, ...] = quantity((), '', 'solids of triangles from files')

    def __bool__(self) -> bool:
        """Return whether there is any solid."""
        return bool(
            self.boxes or self.stairs or self.ramps or self.poles or self.pipes
            or self.height_fields or self.egg_crates or self.meshes
        )  # fmt: skip


# ---- solids -------------------------------------------------------------------------------------


class Triangles(NamedTuple):
    """A solid of triangles, whose corners are counterclockwise as seen from outside."""

    vertices: Array  # (v, 3) [m, frame I]
    faces: Array  # (t, 3) numbers of the corners
    grip: float


class Solids(NamedTuple):
    """The solids of a world as arrays, in axes of I."""

    box_center: Array  # (b, 3) [m]
    box_half: Array  # (b, 3) half of the sides [m]
    box_axes: Array  # (b, 3, 3) the directions of the sides, in rows
    box_grip: Array  # (b,)
    poles: Array  # (p, 8) start, end, radius [m], grip
    pipes: Array  # (q, 9) start, end, outer and inner radius [m], grip
    meshes: tuple[Triangles, ...]  # of ramps, height fields and meshes


@lru_cache(maxsize=8)
def solids_of(world: World) -> Solids:
    """
    Return the solids of a world; their arrays must not be changed.

    Raises
    ------
    ParameterError
        If a file is missing or unreadable.

    """
    boxes = [
        (np.array(box.center), np.array(box.size) / 2, roll_pitch_yaw(box.rpy).T, box.grip)
        for box in world.boxes
    ]
    for stairs in world.stairs:
        boxes += _steps(stairs)
    centers, halves, axes, grips = zip(*boxes, strict=True) if boxes else ((), (), (), ())
    return Solids(
        box_center=np.array(centers, dtype=float).reshape(-1, 3),
        box_half=np.array(halves, dtype=float).reshape(-1, 3),
        box_axes=np.array(axes, dtype=float).reshape(-1, 3, 3),
        box_grip=np.array(grips, dtype=float),
        poles=np.array([(*p.start, *p.end, p.radius, p.grip) for p in world.poles]).reshape(-1, 8),
        pipes=np.array(
            [(*p.start, *p.end, p.radius, p.inner, p.grip) for p in world.pipes]
        ).reshape(-1, 9),
        meshes=(
            *map(_wedge, world.ramps),
            *(
                _ground(field.points(), field.origin, field.cell, field.grip)
                for field in world.height_fields
                if field.heights or field.file
            ),
            *map(_crate, world.egg_crates),
            *map(_mesh, world.meshes),
        ),
    )


def _steps(stairs: Stairs) -> list[tuple[Array, Array, Array, float]]:
    """Return the boxes of stairs, one a step."""
    R, steps = roll_pitch_yaw((0.0, 0.0, stairs.heading)), []
    for k in range(stairs.count):
        depth = stairs.run + (stairs.landing if k == stairs.count - 1 else 0.0)
        top = (k + 1) * stairs.rise
        half = np.array([depth, stairs.width, top + FOUNDATION]) / 2
        middle = np.array([k * stairs.run + depth / 2, 0.0, (top - FOUNDATION) / 2])
        steps.append((np.array(stairs.start) + R @ middle, half, R.T, stairs.grip))
    return steps


def _wedge(ramp: Ramp) -> Triangles:
    """Return a ramp as triangles."""
    half, deep = ramp.width / 2, -FOUNDATION
    side = [(0.0, deep), (ramp.run, deep), (ramp.run, ramp.rise), (0.0, 0.0)]
    corners = np.array([(x, y, z) for y in (-half, half) for x, z in side])
    faces = np.array([
        (0, 1, 2), (0, 2, 3), (4, 6, 5), (4, 7, 6), (3, 2, 6), (3, 6, 7), (1, 5, 6), (1, 6, 2),
        (0, 3, 7), (0, 7, 4), (0, 4, 5), (0, 5, 1),
    ])  # fmt: skip
    R = roll_pitch_yaw((0.0, 0.0, ramp.heading))
    return Triangles(corners @ R.T + ramp.start, faces, ramp.grip)


def _crate(crate: EggCrate) -> Triangles:
    """Return an egg crate as triangles."""
    wide, deep = (max(1, round(length / crate.cell)) for length in crate.size)
    x, y = (
        crate.cell * (np.arange(wide + 1) - wide / 2),
        crate.cell * (np.arange(deep + 1) - deep / 2),
    )
    waves = (np.sin(2.0 * math.pi / crate.wavelength * along) for along in (y, x))
    heights = crate.amplitude * (1.0 + np.multiply.outer(*waves))
    return _ground(
        heights, (crate.center[0] + x[0], crate.center[1] + y[0]), crate.cell, crate.grip
    )


def _ground(heights: Array, origin: Numbers, cell: float, grip: float) -> Triangles:
    """Return heights of points as triangles, with walls around them down into the floor."""
    rows, columns = heights.shape
    row, column = np.indices(heights.shape)
    x, y = origin[0] + cell * column, origin[1] + cell * row
    number = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]
    top = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))]
    around = np.concatenate([number[0, :-1], number[:-1, -1], number[-1, :0:-1], number[:0:-1, 0]])
    base = rows * columns + np.arange(len(around))
    after, base_after = np.roll(around, -1), np.roll(base, -1)
    walls = [np.column_stack([base, base_after, after]), np.column_stack([base, after, around])]
    vertices = np.column_stack([x.ravel(), y.ravel(), heights.ravel()])
    foot = vertices[around] * (1.0, 1.0, 0.0) - (0.0, 0.0, FOUNDATION)
    return Triangles(np.concatenate([vertices, foot]), np.concatenate(top + walls), grip)


def _mesh(mesh: TriangleMesh) -> Triangles:
    """Return the triangles of a file."""
    name, path = cut(mesh.file, LONGEST_PATH), Path(mesh.file)
    if not is_file(path):
        raise ParameterError(f'world.meshes: no file {name}')
    try:
        import trimesh
    except ImportError:
        raise ParameterError(f"{name} needs trimesh: pip install 'snake_sim_ros[urdf]'") from None
    try:
        read: Any = trimesh.load(path, force='mesh')
        read.merge_vertices(merge_tex=True, merge_norm=True)
        vertices, faces = np.asarray(read.vertices), np.array(read.faces)
        inside_out = read.is_watertight and read.volume < 0.0
    except Exception as error:  # whatever readers of a dozen formats raise for broken files
        raise ParameterError(f'{name}: {cut(str(error), LONGEST_REASON)}') from None
    vertices = np.asarray(mesh.scale * vertices @ roll_pitch_yaw(mesh.rpy).T + mesh.position)
    if inside_out:
        faces = faces[:, ::-1]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > FLATTEST]
    if not (len(faces) and np.isfinite(vertices).all()):
        raise ParameterError(f'{name}: a mesh must have triangles with finite corners')
    return Triangles(vertices, faces, mesh.grip)


def in_folder(world: Any, folder: Path) -> Any:
    """Return the mapping of a world whose files are in a folder, with their absolute paths."""
    if not isinstance(world, dict):
        return world
    found = dict(world)
    for key in ('height_fields', 'meshes'):
        if isinstance(listed := found.get(key), list):
            found[key] = [
                {**each, 'file': str((folder / each['file']).resolve())}
                if isinstance(each, dict) and isinstance(each.get('file'), str) and each['file']
                else each
                for each in listed
            ]
    return found
