# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Random scenes: robots, surroundings, solvers, where a robot starts, and what happens to it.

A case is a mapping of plain numbers, which YAML can hold:

- ``scene``: the scene, as in its file, without what is left at its default. Meshes of a world
  are those in the folder MESHES.
- ``start``: ``angle`` of the joints [rad], ``turn`` of the whole robot (Euler parameters),
  ``height`` of its lowest sphere above the highest ground, or above where it is in no solid of
  a world [m], ``velocity`` [m/s] and ``spin`` [rad/s] of the robot as one rigid body; all may be
  left out.
- ``parts``: of the run. Each has ``steps``, and may have a ``push``, link and impulse [N s], or a
  ``change`` of the scene, dotted names and values, before its first step.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from snake_sim_ros import ParameterError, Scene, State
from snake_sim_ros.contact.placing import lift_out_of_world
from snake_sim_ros.dynamics.force_directions import scene_gaps
from snake_sim_ros.scene.checked_records import from_mapping
from snake_sim_ros.scene.parameters import Array, PD_SCHEMES
from snake_sim_ros.scene.posture import chain_coordinates, gaps
from snake_sim_ros.scene.rotations import product, rotation_matrices
from snake_sim_ros.scene.world import in_folder
from snake_sim_ros.stepping.bdf2.step import IMPLICIT_SCHEMES

Case = dict[str, Any]
Generator = np.random.Generator

FLAT, OBSTACLES, WORLDS = 'flat', 'obstacles', 'worlds'
MESHES = Path(__file__).parent / 'meshes'
DEEPEST_START = 2e-3  # penetration up to which a start is tried [m]


def random_case(rng: Generator, surroundings: str, method: str) -> Case:
    """
    Return a random case on a flat floor, with cells, pegs, patches and self-contact, or solids.

    Where there is more than a flat floor, friction may differ forward and backward. In a world
    steps are short, runs are long, and friction is at most 1.5.
    """
    n = int(rng.choice([1, 2, 3, 4, 5, 6, 8, 11], p=[0.05, 0.15, 0.2, 0.2, 0.15, 0.1, 0.1, 0.05]))
    scene: Case = {
        'robot': _robot(rng, n),
        'friction': _friction(rng),
        'gait': random_gait(rng),
        'solver': {'iteration_limit': int(rng.choice([200, 500, 5000], p=[0.3, 0.65, 0.05]))},
        'dt': _between(rng, 1e-5, float(rng.choice([2e-3, 2e-2, 0.1]))),
        'method': method,
        'level': str(rng.choice(['auto', 'spatial'])) if surroundings == FLAT else 'spatial',
        'drift_correction': str(
            rng.choice(['center_of_mass', 'paper', 'none'], p=[0.8, 0.1, 0.1])
        ),
        'pd_scheme': str(rng.choice(IMPLICIT_SCHEMES if method == 'bdf2' else PD_SCHEMES)),
    }
    if rng.random() < 0.5:
        scene['gravity'] = _gravity(rng)
    most = 40
    if surroundings == OBSTACLES:
        scene |= _surroundings(rng, n, scene['robot']['link_length'])
    if surroundings == WORLDS:
        scene |= _world(rng, n, scene['robot']['link_length'], method)
        most = 200
    if surroundings != FLAT and rng.random() < 0.5:
        scene['friction']['backward'] = _coefficient(rng)
    parts: list[Case] = [{'steps': int(rng.integers(1, most))} for _ in range(rng.integers(1, 4))]
    for part in parts[1:]:
        if rng.random() < 0.5:
            part['push'] = [int(rng.integers(n)), *_numbers(rng.uniform(-1.0, 1.0, 3))]
        else:
            part['change'] = _change(rng)
    start = _start(rng, n)
    if surroundings == WORLDS:
        start['height'] = abs(start['height'])
    return {'scene': scene, 'start': start, 'parts': parts}


def _between(rng: Generator, low: float, high: float) -> float:
    """Return a number between two, evenly spread over their logarithms."""
    return _short(float(np.exp(rng.uniform(np.log(low), np.log(high)))))


def _short(value: float) -> float:
    """Return a number with four digits, as it will stand in a file."""
    return float(f'{value:.4g}')


def _numbers(values: Array) -> list[float]:
    return [_short(float(value)) for value in values]


def _robot(rng: Generator, n: int) -> Case:
    length, mass = _between(rng, 0.03, 0.5), _between(rng, 0.02, 5.0)
    radius = length * float(rng.uniform(0.1, 0.45))
    across = mass * (3 * radius**2 + length**2) / 12
    robot: Case = {
        'link_count': n,
        'link_length': length,
        'link_mass': mass,
        'inertia_transversal': _short(across),
        'inertia_axial': _short(across * float(rng.uniform(0.1, 1.5))),
        'contact_offset': _short(length * float(rng.uniform(0.0, 0.35))),
        'contact_radius': _short(radius),
        'yaw_stiffness': float(rng.choice([0.0, _between(rng, 0.1, 2000.0)], p=[0.1, 0.9])),
        'yaw_damping': float(rng.choice([0.0, _between(rng, 1e-3, 5.0)], p=[0.2, 0.8])),
        'pitch_stiffness': float(rng.choice([0.0, _between(rng, 0.1, 2000.0)], p=[0.1, 0.9])),
        'pitch_damping': float(rng.choice([0.0, _between(rng, 1e-3, 5.0)], p=[0.2, 0.8])),
    }
    if rng.random() < 0.2:
        spread = np.exp(rng.uniform(-0.7, 0.7, n))
        for name in ('link_mass', 'inertia_transversal', 'inertia_axial'):
            robot[name] = _numbers(spread * robot[name])
    laws = {
        'joint_stop': True,
        'joint_friction': _between(rng, 1e-3, 3.0),
        'joint_viscous_friction': _between(rng, 1e-3, 1.0),
        'yaw_torque_limit': _between(rng, 0.01, 20.0),
        'pitch_torque_limit': _between(rng, 0.01, 20.0),
    }
    if rng.random() < 0.3:
        robot |= {name: value for name, value in laws.items() if rng.random() < 0.5}
    return robot


def _coefficient(rng: Generator) -> float:
    return float(rng.choice([0.0, _short(rng.uniform(0.0, 1.0)), _between(rng, 0.1, 10.0)]))


def _friction(rng: Generator) -> Case:
    rolling = float(rng.choice([0.0, _between(rng, 1e-3, 0.3)], p=[0.8, 0.2]))
    friction = {
        'longitudinal': _coefficient(rng), 'transversal': _coefficient(rng), 'rolling': rolling
    }  # fmt: skip
    if rng.random() < 0.15:
        for axis in ('longitudinal', 'transversal'):
            friction[f'viscous_{axis}'] = float(rng.choice([0.0, _between(rng, 1e-2, 10.0)]))
    if rolling == 0.0 and rng.random() < 0.15:
        friction['kinetic_ratio'] = _short(rng.uniform(0.3, 1.0))
        friction['stribeck_speed'] = _between(rng, 1e-3, 0.1)
    return friction


def random_gait(rng: Generator) -> Case:
    """Return waves of yaw and pitch, or none."""

    def wave(amplitude: float) -> Case:
        return {
            'amplitude': _short(rng.uniform(0.0, amplitude)),
            'angular_frequency': _short(rng.uniform(0.0, 8.0)),
            'phase_lag': _short(rng.uniform(-1.5, 1.5)),
        }

    gait = {}
    if rng.random() < 0.6:
        gait['yaw'] = wave(0.7)
    if rng.random() < 0.3:
        gait['pitch'] = wave(0.4)
    return gait


def _gravity(rng: Generator) -> list[float]:
    direction = rng.standard_normal(3) * [0.5, 0.5, 1.0] - [0.0, 0.0, 1.0]
    size = float(rng.choice([0.0, rng.uniform(0.0, 30.0)], p=[0.1, 0.9]))
    return _numbers(size * direction / np.linalg.norm(direction))


def _surroundings(rng: Generator, n: int, length: float) -> Case:
    """Return cells, patches, pegs and self-contact; all are there, so that code is shared."""
    span, count = n * length, int(rng.integers(0, 4))
    cell = _short(max(0.3 * span, 1.1 * length))
    corner = [_short(-1.5 * cell)] * 2
    return {
        'ground': {
            'heights': [_numbers(rng.uniform(0.0, 0.2 * length, 3)) for _ in range(3)],
            'cell': cell,
            'origin': corner,
        },
        'patches': {
            'factors': [_numbers(rng.uniform(0.0, 3.0, 3)) for _ in range(3)],
            'cell': cell,
            'origin': corner,
        },
        'pegs': {
            'x': _numbers(rng.uniform(-span, span, count)),
            'y': _numbers(rng.uniform(-span, span, count)),
            'radius': _short(length * float(rng.uniform(0.1, 0.6))),
            'friction': _coefficient(rng),
        },
        'self_contact': True,
        'self_contact_friction': _coefficient(rng),
    }


def random_world(rng: Generator, n: int, length: float) -> Case:
    """Return one to ten solids around the origin, for n links of a length [m]."""
    span, world = (0.3 * n + 1.0) * length, dict[str, Any]()
    for kind in rng.choice(list(_SOLIDS), rng.integers(1, 11)).tolist():
        solid = _SOLIDS[kind](rng, span, length)
        world.setdefault(kind, []).append({**solid, 'grip': _between(rng, 0.2, 3.0)})
    return world


def _world(rng: Generator, n: int, length: float, method: str) -> Case:
    """Return a world, self-contact, and a step for them."""
    world = random_world(rng, n, length)
    low, high = (5e-4, 1e-2) if method == 'bdf2' else (1e-4, 2e-3)
    return {
        'world': world,
        'self_contact': bool(rng.random() < 0.3),
        'dt': _between(rng, low, high),
    }


def _place(rng: Generator, span: float, height: float) -> list[float]:
    """Return a point around the origin, up to a height [m]."""
    return _numbers(rng.uniform((-span, -span, 0.0), (span, span, height)))


def _box(rng: Generator, span: float, length: float) -> Case:
    size, turn = rng.uniform(0.1, 4.0, 3) * length, rng.uniform(-np.pi, np.pi, 3)
    upright = rng.choice([0.0, 1.0])  # boxes that lie on the floor, flush with each other
    center = _place(rng, span, 1.5 * length)
    if upright:
        center, turn = [*np.round(np.divide(center[:2], length)) * length, size[2] / 2], 0.0 * turn
    return {'center': _numbers(np.array(center)), 'size': _numbers(size), 'rpy': _numbers(turn)}


def _bar(rng: Generator, span: float, length: float) -> Case:
    start = np.array(_place(rng, span, length))
    way = rng.standard_normal(3) * rng.choice([1.0, 0.0, 0.0], 3) + rng.choice([0.0, 1.0], 3)
    way[2] += not way.any()
    end = start + span * way / np.linalg.norm(way)
    return {'start': _numbers(start), 'end': _numbers(end)}


def _pole(rng: Generator, span: float, length: float) -> Case:
    return {**_bar(rng, span, length), 'radius': _between(rng, 0.02 * length, 2.0 * length)}


def _pipe(rng: Generator, span: float, length: float) -> Case:
    inner = _between(rng, 0.3 * length, 3.0 * length)
    wall = _between(rng, 0.01 * length, 0.5 * length)
    return {**_bar(rng, span, length), 'inner': inner, 'radius': _short(inner + wall)}


def _slope(rng: Generator, span: float, length: float) -> Case:
    return {
        'start': [*_place(rng, span, 0.0)[:2], 0.0],
        'heading': _short(rng.uniform(-np.pi, np.pi)),
        'width': _between(rng, length, 2.0 * span),
        'run': _between(rng, 0.2 * length, span),
        'rise': _between(rng, 0.02 * length, length),
    }


def _stairs(rng: Generator, span: float, length: float) -> Case:
    return {**_slope(rng, span, length), 'count': int(rng.integers(1, 6))}


def _heights(rng: Generator, span: float, length: float) -> Case:
    rows, columns = rng.integers(2, 9, 2)
    steepness = float(rng.choice([0.0, _between(rng, 0.01, 1.0)]))
    heights = length * (0.1 + steepness * rng.uniform(0.0, 1.0, (rows, columns)))
    return {
        'heights': [_numbers(row) for row in heights],
        'cell': _between(rng, 0.1 * length, span / 2),
        'origin': _place(rng, span, 0.0)[:2],
    }


def _crate(rng: Generator, span: float, length: float) -> Case:
    wavelength = _between(rng, max(length, 0.04), 4.0 * max(length, 0.04))
    return {
        'wavelength': wavelength,
        'amplitude': _short(wavelength * rng.uniform(0.0, 0.2)),
        'cell': _short(wavelength / rng.uniform(4.0, 12.0)),
        'center': _place(rng, span / 2, 0.0)[:2],
        'size': _numbers(wavelength * rng.uniform(1.0, 6.0, 2)),
    }


def _mesh(rng: Generator, span: float, length: float) -> Case:
    return {
        'file': str(rng.choice(sorted(path.name for path in MESHES.iterdir()))),
        'scale': _between(rng, 0.3 * length, 3.0 * length),
        'position': _place(rng, span, length),
        'rpy': _numbers(rng.uniform(-np.pi, np.pi, 3)),
    }


_SOLIDS = {
    'boxes': _box, 'stairs': _stairs, 'ramps': _slope, 'poles': _pole, 'pipes': _pipe,
    'height_fields': _heights, 'egg_crates': _crate, 'meshes': _mesh,
}  # fmt: skip


def _change(rng: Generator) -> Case:
    """Return values that may change while a scene runs."""
    return {
        'friction.longitudinal': _coefficient(rng),
        'gravity': _gravity(rng),
        'robot.yaw_stiffness': _between(rng, 0.1, 2000.0),
    }


def _start(rng: Generator, n: int) -> Case:
    start: Case = {'height': float(rng.choice([0.0, -1e-3, _between(rng, 1e-4, 0.3)]))}
    if rng.random() < 0.7:
        pitch = float(rng.choice([0.0, 0.4]))
        angle = rng.uniform(-1.0, 1.0, (n - 1, 2)) * [0.8, pitch]
        start['angle'] = [_numbers(row) for row in angle]
    if rng.random() < 0.4:
        start['turn'] = _numbers(rng.standard_normal(4))
    if rng.random() < 0.6:
        start['velocity'] = _numbers(rng.uniform(-2.0, 2.0, 3))
    if rng.random() < 0.5:
        start['spin'] = _numbers(rng.uniform(-5.0, 5.0, 3))
    return start


def scene_of(case: Case) -> Scene:
    """Return the scene of a case."""
    values = dict(case['scene'])
    if 'world' in values:
        values['world'] = in_folder(values['world'], MESHES)
    scene: Scene = from_mapping(Scene, values, 'scene')
    return scene


def start_of(case: Case, scene: Scene) -> State:
    """
    Return where the robot of a case starts.

    Raises
    ------
    ParameterError
        If it would start inside of something.

    """
    start: Mapping[str, Any] = case.get('start', {})
    n = scene.robot.link_count
    angle = np.array(start.get('angle', np.zeros((n - 1, 2)))).reshape(-1, 2)
    if len(angle) != n - 1:
        raise ParameterError(f'start must have {n - 1} joints, got {len(angle)}')
    q = chain_coordinates(scene.robot, angle)
    q[:, :3] -= q[:, :3].mean(axis=0)
    turn = np.array(start.get('turn', (1.0, 0.0, 0.0, 0.0)))
    turn = turn / np.linalg.norm(turn)
    q[:, :3] = q[:, :3] @ rotation_matrices(turn).T
    q[:, 3:] = product(turn, q[:, 3:])
    highest = max((max(row) for row in scene.ground.heights), default=0.0)
    q[:, 2] += max(highest, 0.0) + start.get('height', 0.0) - gaps(scene.robot, q).min()
    if scene.world:
        q[:, 2] += lift_out_of_world(scene, q)
    omega = np.array(start.get('spin', (0.0, 0.0, 0.0)))
    u = np.zeros((n, 6))
    u[:, :3] = np.array(start.get('velocity', (0.0, 0.0, 0.0))) + np.cross(omega, q[:, :3])
    u[:, 3:] = np.einsum('iab,a->ib', rotation_matrices(q[:, 3:]), omega)
    depth = -float(scene_gaps(scene, q).min())
    if depth > DEEPEST_START:
        raise ParameterError(f'the robot must start outside of everything, got {depth:.3g} m')
    return State(q, u)
