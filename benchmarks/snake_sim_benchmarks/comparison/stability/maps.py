# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The maps of `stability`: quantities, methods, scenes, limits of theory."""

from collections.abc import Callable, Sequence
from dataclasses import replace
import math
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.mujoco_model import MujocoSettings
from snake_sim_benchmarks.comparison.mujoco_runs import run_mujoco
from snake_sim_benchmarks.comparison.paths import SAMPLING_PERIOD
from snake_sim_benchmarks.comparison.stability.problems import (
    AIKO,
    angle_error,
    CASE_A,
    control_limit,
    dropped_flat,
    dropped_precisely,
    dropped_tilted,
    heavy,
    in_flight,
    landing_error,
    landing_limit,
    on_the_ground,
    position_error,
    prox_limit,
    pushed_along,
    pushed_down,
    rod,
    rod_error,
    rod_limit,
    sinking,
    smooth_limit,
    speed,
    spin_limit,
    spinning,
    spring_limit,
    sticking,
    transverse_gain,
    undulating,
    upright,
)
from snake_sim_benchmarks.comparison.stability.runs import Axis, Case, Run, simulate, StabilityMap

SCHEMES = ('newton start', 'newton midpoint', 'newton average', 'newton end', 'bdf2')
SOLVERS = ('newton', 'newton_dense', 'gauss_seidel', 'paper', 'bdf2')
MUJOCO_LIMIT = 10.0  # s of wall time for a run of MuJoCo
FINE_DT = SAMPLING_PERIOD / 6400


def time_steps(first: float, last: float, count: int) -> Axis:
    """Return time steps that divide SAMPLING_PERIOD, evenly spaced on a logarithmic axis [s]."""
    counts = np.unique(np.round(SAMPLING_PERIOD / np.geomspace(first, last, count)))[::-1]
    return Axis('dt', 's', tuple((SAMPLING_PERIOD / counts).tolist()))


def spaced(name: str, unit: str, first: float, last: float, count: int) -> Axis:
    """Return values that are evenly spaced on a logarithmic axis."""
    return Axis(name, unit, tuple(np.geomspace(first, last, count).tolist()))


def no_limit(method: str, y: float) -> float:
    """Return nan: theory names none."""
    return math.nan


def run_case(method: str, case: Case) -> Run:
    """Run a case with a method: one of `methods.METHODS`, a baseline or `mujoco`."""
    if method != 'mujoco':
        return simulate(case)
    scene = replace(case.scene, duration=case.duration)
    found = run_mujoco(scene, MujocoSettings(), MUJOCO_LIMIT)
    v = np.diff(found.trajectory.position, axis=0) / SAMPLING_PERIOD
    mass = scene.robot.per_link('link_mass')
    energy = float((0.5 * mass * (v**2).sum(axis=-1)).sum(axis=-1).max(initial=0.0))
    complete = found.simulated > case.duration - SAMPLING_PERIOD / 2
    return Run(found.trajectory, energy, complete)


def control_map(
    name: str, title: str, y: Axis, gains: Sequence[str],
    case: Callable[..., Case], error: Callable[..., float], measure: str, tolerance: float,
) -> StabilityMap:  # fmt: skip
    """Return a map of joint control: over the time step and y, the value of some gains of Aiko."""

    def with_gains(K: float) -> dict[str, Any]:
        return dict.fromkeys(gains, K)

    return StabilityMap(
        name, title, time_steps(1e-4, 1e-2, 16), y, SCHEMES,
        lambda method, dt, K: case(method, dt, **with_gains(K)),
        error, measure, tolerance,
        lambda method, K: control_limit(method, replace(AIKO, **with_gains(K))),
        'newton average', FINE_DT,
    )  # fmt: skip


def with_default_tolerances(
    case: Callable[[str, float, float], Case],
) -> Callable[[str, float, float], Case]:
    """Return cases that are solved with the tolerances that a scene has by default."""

    def found(method: str, x: float, y: float) -> Case:
        chosen = case(method, x, y)
        return replace(chosen, scene=replace(chosen.scene, solver=CASE_A.solver))

    return found


STIFFNESS = spaced('robot.pitch_stiffness', 'N m/rad', 50, 3200, 7)
MAPS = (
    control_map(
        'stiffness_in_flight', 'Joint control in flight: stiffness',
        STIFFNESS, ('pitch_stiffness',), in_flight, angle_error, 'joint angle, relative', 0.05,
    ),
    control_map(
        'stiffness_on_the_ground',
        'The same on the ground, whose contacts hold the modes; lines as in flight',
        STIFFNESS, ('pitch_stiffness',), on_the_ground, position_error, 'path, relative', 0.02,
    ),
    control_map(
        'damping_in_flight', 'Joint control in flight: damping',
        spaced('damping', 'N m s/rad', 0.02, 5.12, 9), ('yaw_damping', 'pitch_damping'),
        in_flight, angle_error, 'joint angle, relative', 0.05,
    ),
    StabilityMap(
        'friction', 'Friction across the links, case A',
        time_steps(2.5e-4, 5e-2, 10), spaced('friction.transversal', '1', 0.05, 3.2, 7),
        (*SOLVERS, 'regularized', 'mujoco'),
        undulating, position_error, 'path, relative', 0.02, no_limit, 'newton', FINE_DT,
    ),
    StabilityMap(
        'friction_default', 'The same with default tolerances',
        time_steps(2.5e-4, 5e-2, 10), spaced('friction.transversal', '1', 0.05, 3.2, 7), SOLVERS,
        with_default_tolerances(undulating), position_error, 'path, relative', 0.02, no_limit,
        'newton', FINE_DT,
    ),
    StabilityMap(
        'prox_parameters', 'Prox parameters, sticking on a slope',
        spaced('factor on r', '1', 0.25, 16, 19),
        Axis('inertia radius/link radius', '1', (0.5, 0.6, 0.7, 0.85, 1.0)),
        ('paper', 'gauss_seidel', 'newton', 'bdf2'),
        sticking, speed, 'speed, m/s', 1e-3, prox_limit,
    ),
    StabilityMap(
        'painleve', "Painlevé's rod in its first step: it jams beyond the line",
        spaced('mu', '1', 0.8, 2.0, 16),
        spaced('dt', 's', 1e-6, 1e-2, 5), SOLVERS,
        rod, rod_error, 'sliding speed, m/s', 5e-3, rod_limit,
    ),
    StabilityMap(
        'mass_ratio', 'A heavy middle link at rest',
        spaced('mass ratio', '1', 1, 1e4, 9), Axis('link_count', '1', (2, 5, 11)),
        SOLVERS, heavy, sinking, 'speed over that of a fall', 0.01, no_limit,
    ),
    StabilityMap(
        'contact_stiffness', 'Contact springs',
        time_steps(1e-5, 1e-2, 13), spaced('stiffness', 'N/m', 1e3, 1e7, 9),
        ('regularized',), pushed_down, speed, 'speed, m/s', 1e-6, spring_limit,
    ),
    StabilityMap(
        'sliding_velocity', 'Smooth friction',
        time_steps(1e-5, 1e-2, 13), spaced('sliding_velocity', 'm/s', 1e-5, 1e-1, 9),
        ('regularized',), pushed_along, speed, 'speed, m/s', 1e-6, smooth_limit,
    ),
    StabilityMap(
        'drop_flat', 'Dropped flat: the floor is noticed less than a step late',
        time_steps(1e-4, 2.5e-2, 12), spaced('height', 'm', 1e-3, 1, 7),
        (*SOLVERS, 'regularized'),
        dropped_flat, landing_error, 'gap over radius', 0.01, landing_limit,
    ),
    StabilityMap(
        'drop_tilted', 'Dropped, tilted by 30 deg',
        time_steps(1e-4, 2.5e-2, 12), spaced('height', 'm', 1e-3, 1, 7),
        (*SOLVERS, 'regularized'),
        dropped_tilted, landing_error, 'gap over radius', 0.01, no_limit,
    ),
    StabilityMap(
        'drop_default', 'The same with default tolerances',
        time_steps(1e-4, 2.5e-2, 12), spaced('height', 'm', 1e-3, 1, 7), SOLVERS,
        with_default_tolerances(dropped_tilted), landing_error, 'gap over radius', 0.01, no_limit,
    ),
    StabilityMap(
        'residual_tolerance', 'Dropped, tilted: what the solvers reach, 1/4000 s',
        spaced('residual_tolerance', 'm/s', 1e-12, 1e-3, 10), spaced('height', 'm', 1e-3, 1, 7),
        SOLVERS, dropped_precisely, landing_error, 'gap over radius', math.inf, no_limit,
    ),
    StabilityMap(
        'spin', 'Free spin: energy from explicit gyroscopic terms',
        time_steps(1e-5, 1e-1, 13), spaced('omega_z', 'rad/s', 1, 100, 7), ('newton', 'bdf2'),
        spinning, transverse_gain, 'energy across the axis, relative', 0.1, spin_limit,
    ),
    StabilityMap(
        'upright', 'A link that stands upright, slides and spins',
        time_steps(1e-4, 2e-2, 10), spaced('tilt', 'rad', 1e-8, 1, 9), SOLVERS,
        upright, position_error, 'path, relative', 0.05, no_limit, 'newton', FINE_DT,
    ),
)  # fmt: skip
