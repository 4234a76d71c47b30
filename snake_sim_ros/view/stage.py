# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The 3-D part of the viewer: floor, obstacles, robot, contacts and paths of one scene."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from snake_sim_ros.scene.obstacles import cell_centers, FOUNDATION, PEG_HEIGHT
from snake_sim_ros.scene.parameters import Array, Scene
from snake_sim_ros.scene.robot_description import color_name, COLORS
from snake_sim_ros.scene.surfaces import Surface, surfaces_of
from snake_sim_ros.view.frames import (
    arrows,
    bodies_of,
    capsule,
    force_scale,
    Frame,
    own_frames,
    seen_meshes,
    turned_to,
)

# Of Okabe and Ito, as in `charts`; red, green and blue.
FRICTION, NORMAL, PATH, POINT = (213, 94, 0), (86, 180, 233), (0, 114, 178), (0, 158, 115)
GUIDE, DRAWN = (204, 121, 167), (230, 159, 0)
FLOOR, LINES, PEG, GROUND = (246, 247, 249), (205, 209, 214), (89, 115, 166), (176, 178, 184)
FLOOR_SIZE = 60.0  # m
CLEARANCE = 2e-3  # m, between the floor and a path on it
PATH_RADIUS = 0.08  # of lines and arrows, in contact radii
SEE_THROUGH = 0.35  # opacity


class Stage:
    """
    The 3-D objects of one scene, under one node that moves so that the camera follows the robot.

    Parameters
    ----------
    canvas : Any
        A `viser.SceneApi`.
    scene : Scene
    solids : sequence of Surface, optional
        Further ones, besides those of the world of the scene.

    """

    def __init__(self, canvas: Any, scene: Scene, solids: Sequence[Surface] = ()) -> None:
        self.canvas, self.robot = canvas, scene.robot
        self.scale = force_scale(scene.robot)
        self.size = max(float(scene.robot.per_link('contact_radius').max()), 0.01)
        self.follow = self.see_through = False
        self._add_lights()
        self.root = canvas.add_frame('/world', show_axes=False)
        self._add_floor()
        self._add_obstacles(scene, [*surfaces_of(scene.world), *solids])
        self._add_links()
        none, width = np.zeros((0, 2, 3)), PATH_RADIUS * self.size
        thick = {'shaft_radius': width, 'head_radius': 2.5 * width, 'head_length': 5 * width}
        thin = {'shaft_radius': width / 2, 'head_radius': 1.5 * width, 'head_length': 3 * width}
        self.friction = canvas.add_arrows('/world/friction', none, linear(FRICTION), **thick)
        self.normal = canvas.add_arrows('/world/normal', none, linear(NORMAL), **thin)
        self.path = canvas.add_line_segments('/world/path', none, PATH, thickness=2 * width)
        thick_line = {'thickness': 4 * width}
        self.guide = canvas.add_line_segments('/world/guide', none, GUIDE, **thick_line)
        self.drawn = canvas.add_line_segments('/world/drawn', none, DRAWN, **thick_line)
        self.mark_size = 8 * width
        marks = {'point_size': self.mark_size, 'point_shape': 'circle'}
        self.clicked = canvas.add_point_cloud('/world/clicked', np.zeros((0, 3)), DRAWN, **marks)
        self.points = canvas.add_point_cloud(
            '/world/contacts', np.zeros((0, 3)), POINT, point_size=3 * width, point_shape='circle'
        )

    def show(self, frame: Frame) -> None:
        """Move the robot and its contacts to their places."""
        centers = frame.position, frame.orientation
        frames = own_frames(self.robot, *centers) if self.robot.links else centers
        for links, is_mesh, mesh in self.links:
            position, orientation = frames if is_mesh else centers
            mesh.batched_positions = position[links].astype(np.float32)
            mesh.batched_wxyzs = orientation[links].astype(np.float32)
        along, upward = arrows(frame.points, frame.forces, self.scale)
        self.friction.points = along.astype(np.float32)
        self.normal.points = upward.astype(np.float32)
        self.points.points = frame.points.astype(np.float32)
        if self.follow:
            center = frame.position.mean(axis=0)
            self.root.position = (-center[0], -center[1], 0.0)

    def show_path(self, path: Array) -> None:
        """Draw a path of shape (k, 3) [m] on the floor below it."""
        self.path.points = on_floor(path, CLEARANCE)

    def show_guide(self, guide: Array, drawn: Array, clicked: Array) -> None:
        """Draw the path to follow, one that is drawn, and clicked points, (k, 2) [m] each."""
        self.guide.points = on_floor(guide, CLEARANCE / 2)
        self.drawn.points = on_floor(drawn, CLEARANCE / 2)
        marks = np.column_stack([clicked, np.full(len(clicked), self.mark_size)])
        self.clicked.points = marks.astype(np.float32)

    def set_see_through(self, on: bool) -> None:
        """Make the links transparent or not, since they hide the contacts below them."""
        for _, _, mesh in self.links:
            mesh.opacity = SEE_THROUGH if on else None

    def _add_lights(self) -> None:
        """Light the robot from the side of the first view, whether it is followed or not."""
        self.canvas.configure_default_lights(False)
        self.canvas.configure_environment_map('warehouse', environment_intensity=0.4)
        self.canvas.add_light_ambient('/lights/sky', intensity=0.7)
        self.canvas.add_light_directional(
            '/lights/sun', intensity=2.2, cast_shadow=True, position=(-2.0, -1.0, 4.0)
        )

    def _add_floor(self) -> None:
        self.canvas.add_grid(
            '/world/floor',
            FLOOR_SIZE,
            FLOOR_SIZE,
            cell_size=0.1,
            cell_color=(228, 231, 235),
            section_size=0.5,
            section_color=LINES,
            section_thickness=1.2,
            plane_color=FLOOR,
            plane_opacity=1.0,
            shadow_opacity=0.25,
            fade_distance=25.0,
        )

    def _add_obstacles(self, scene: Scene, solids: Sequence[Surface]) -> None:
        height = PEG_HEIGHT * self.size
        for k, (x, y, radius) in enumerate(scene.pegs.axes):
            place = (float(x), float(y), height / 2)
            self.canvas.add_cylinder(
                f'/world/pegs/{k}', float(radius), height, color=PEG, position=place
            )
        for k, (vertices, faces) in enumerate(solids):
            shade = SEE_THROUGH if has_a_hole(faces) else None
            self.canvas.add_mesh_simple(
                f'/world/solids/{k}', vertices, faces, color=GROUND, opacity=shade,
                flat_shading=True,
            )  # fmt: skip
        ground = scene.ground
        if not ground.heights:
            return
        heights = np.array(ground.heights)
        bottom = min(0.0, float(heights.min())) - FOUNDATION
        centers = np.dstack([cell_centers(ground), (heights + bottom) / 2]).reshape(-1, 3)
        sizes = np.stack([np.full(heights.shape, ground.cell)] * 2 + [heights - bottom], axis=-1)
        vertices, faces = box()
        self.canvas.add_batched_meshes_simple(
            '/world/ground',
            vertices,
            faces,
            np.tile([1.0, 0.0, 0.0, 0.0], (heights.size, 1)),
            centers,
            batched_scales=sizes.reshape(-1, 3),
            batched_colors=linear(GROUND),
            lod='off',
            flat_shading=True,
        )

    def _add_links(self) -> None:
        """Add the meshes of the links, and the bodies of those without; those alike as one."""
        looks = [(True, *mesh) for mesh in seen_meshes(self.robot)]
        seen = {i for _, links, _, _ in looks for i in links.tolist()}
        bodies = bodies_of(self.robot)
        shapes = np.column_stack([bodies.radius, bodies.half, bodies.center, bodies.axis])
        kinds, kind = np.unique(shapes, axis=0, return_inverse=True)
        for k, (radius, half, *place) in enumerate(kinds.tolist()):
            links = bodies.link[kind.ravel() == k]
            vertices, faces = capsule(radius or self.size, half)
            vertices = vertices @ turned_to(np.array(place[3:])).T + place[:3]
            links = links[[i not in seen for i in links.tolist()]]
            looks.append((False, links, vertices, faces))
        colors = np.array([color_of(i) for i in range(self.robot.link_count)])
        self.links = []
        for k, (is_mesh, links, vertices, faces) in enumerate(looks):
            if not len(links):
                continue
            mesh = self.canvas.add_batched_meshes_simple(
                f'/world/links/{k}',
                vertices,
                faces,
                np.tile([1.0, 0.0, 0.0, 0.0], (len(links), 1)),
                np.zeros((len(links), 3)),
                batched_colors=linear(colors[links]),
                lod='off',
            )
            self.links.append((links, is_mesh, mesh))


def on_floor(path: Array, height: float) -> Array:
    """Return the pieces of a path (k, 2) or (k, 3) at a height above the floor, (k - 1, 2, 3)."""
    flat = np.column_stack([path[:, :2], np.full(len(path), height)])
    return np.stack([flat[:-1], flat[1:]], axis=1).astype(np.float32)


def has_a_hole(faces: Array) -> bool:
    """Return whether a closed surface of triangles is that of a tube: V - E + F = 0."""
    return 2 * len(np.unique(faces)) == len(faces)  # as E = 3/2 F


def linear(color: ArrayLike) -> Array:
    """Return colors of a screen as linear ones up to 255, as viser takes them for batches."""
    part = np.asarray(color) / 255
    part = np.where(part <= 0.04045, part / 12.92, ((part + 0.055) / 1.055) ** 2.4)
    return np.round(255 * part).astype(np.uint8)


def color_of(link: int) -> tuple[int, ...]:
    """Return the color of a link as in its URDF: red, green and blue up to 255."""
    return tuple(round(255 * part) for part in COLORS[color_name(link)][:3])


def box() -> tuple[Array, Array]:
    """Return vertices (8, 3) and triangles (12, 3) of a box of size 1 around the origin."""
    vertices = np.stack(np.meshgrid(*[[-0.5, 0.5]] * 3, indexing='ij'), axis=-1).reshape(-1, 3)
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in sides for triangle in ((a, b, c), (a, c, d))]
    return vertices, np.array(faces)
