# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
What contact laws that are not set-valued change besides the accuracy of a path.

An artefact is a quantity whose exact value is known, measured in a scene of one link: creep on a
slope on which the link should rest, lifting while it slides, a wrong direction of sliding, sinking
into the floor, rebound of an inelastic impact, and energy out of nothing. All contenders take the
same time steps.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import partial
import math
from typing import Any

from scipy.integrate import quad

from snake_sim_benchmarks.comparison.baselines.integrators import (
    make_pyramid,
    make_semi_implicit,
    Penalty,
)
from snake_sim_benchmarks.comparison.mujoco_model import MujocoSettings
from snake_sim_benchmarks.comparison.mujoco_runs import mujoco_trajectory
from snake_sim_benchmarks.energy import mechanical_energy
from snake_sim_ros import Friction, ParameterError, Robot, Scene, Simulation, State
from snake_sim_ros.scene.posture import gaps
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import sample
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.trajectory import Trajectory

DT = 1 / 4000  # s
G = 9.81
MU = 0.5
SLOPE_ANGLE = math.radians(10.0)  # of the slope; the friction angle is 26.6 deg
SLIDING_SPEED = 6.0  # m/s
ORTHOTROPIC = Friction(longitudinal=0.1, transversal=0.5)
DROP_HEIGHT = 0.1  # m, of the drop
SPIN_RATES = (1.0, 2.0, 30.0)  # rad/s
LINK = Scene(
    robot=Robot(link_count=1),
    friction=Friction(longitudinal=MU, transversal=MU),
    dt=DT,
    level='spatial',
)
# This robot rolls and pitches by at most 1e-4 rad while friction acts on it.
NEEDLE = replace(LINK.robot, contact_radius=1e-3, inertia_axial=10.0, inertia_transversal=10.0)
PENALTY = Penalty(law='tanh', sliding_velocity=1e-2, stiffness=1e5)

# The arguments are scene, start, number of steps and steps between two samples. The trajectory of
# a run that fails ends early.
Run = Callable[[Scene, State, int, int], Trajectory]


def states_of_stepper(
    make: Callable[[Scene], Stepper], scene: Scene, start: State, steps: int, every: int
) -> Trajectory:
    """Return what a robot does with a stepper; see `mujoco_runs.mujoco_trajectory`."""
    simulation = Simulation(scene, make(scene))
    simulation.state = start
    return sample(simulation, every, steps // every)


# ---- artefacts ----------------------------------------------------------------------------------


def creep(run: Run) -> list[float]:
    """Return the velocity after a second on a slope that holds the link."""
    scene = replace(LINK, gravity=(G * math.sin(SLOPE_ANGLE), 0.0, -G * math.cos(SLOPE_ANGLE)))
    per_second = round(1 / DT)
    x = run(scene, initial_state(scene), 2 * per_second, per_second).position[:, 0, 0]
    return [x[2] - x[1]]


def lifting(run: Run) -> list[float]:
    """Return how far a link lifts off that slides along its axis."""
    start = initial_state(LINK)
    start.u[0, 0] = SLIDING_SPEED
    return [gaps(LINK.robot, run(LINK, start, round(1 / DT), 1).coordinates).max()]


def direction(run: Run) -> list[float]:
    """Return how far from its exact end point a link stops, and in which direction [deg]."""
    scene = replace(LINK, robot=NEEDLE, friction=ORTHOTROPIC)
    start = initial_state(scene)
    start.u[0, :2] = 1.0
    steps = round(1.2 / DT)
    center = run(scene, start, steps, steps).position[:, 0]
    x, y = center[1, :2] - center[0, :2]
    expected = stopping_point(scene.friction)
    turned = math.degrees(math.atan2(y, x) - math.atan2(expected[1], expected[0]))
    return [math.hypot(x - expected[0], y - expected[1]), turned]


def stopping_point(friction: Friction) -> tuple[float, float]:
    """
    Return where a body stops that starts at (1, 1) m/s, with orthotropic friction and no turning.

    ``a = -g D^2 v/|D v|``, D = diag(mu_x, mu_y), keeps v_y/v_x^p with p = (mu_y/mu_x)^2. So
    v_y = v_x^p, and ``dx = v_x dv_x/a_x``.
    """
    mu_x, mu_y = friction.longitudinal, friction.transversal
    p = (mu_y / mu_x) ** 2

    def dx(v: float) -> float:
        return math.hypot(mu_x * v, mu_y * v**p) / (G * mu_x**2)

    return quad(dx, 0.0, 1.0)[0], quad(lambda v: v ** (p - 1) * dx(v), 0.0, 1.0)[0]


def rest(run: Run) -> list[float]:
    """Return how far a link has sunk into the floor a second after it was laid down."""
    steps = round(1 / DT)
    end = run(LINK, initial_state(LINK), steps, steps).coordinates[-1]
    return [-gaps(LINK.robot, end).min()]


def drop(run: Run) -> list[float]:
    """Return the largest penetration and the height of rebound of a link that is dropped flat."""
    start = initial_state(LINK)
    start.q[0, 2] += DROP_HEIGHT
    gap = gaps(LINK.robot, run(LINK, start, round(1 / DT), 1).coordinates).min(axis=1)
    return [-gap.min(), max(0.0, gap[gap.argmin() :].max())]


def spin(run: Run) -> list[float]:
    """Return by how many percent the energy of a link grows that spins in flight for 10 s."""
    scene = replace(LINK, gravity=(0.0, 0.0, 0.0))
    start = initial_state(scene)
    start.q[0, 2] += 1.0
    start.u[0, 3:] = SPIN_RATES
    steps = round(10 / DT)
    states = run(scene, start, steps, steps)
    before, after = mechanical_energy(scene, states.coordinates[:2], states.velocity[:2])
    return [100 * (after / before - 1)]


@dataclass(frozen=True)
class Artefact:
    """
    The quantities that are measured in one run.

    Attributes
    ----------
    quantities : tuple of (str, str)
        Names, in words, and units.
    measure : callable
        ``measure(run)`` returns their values, which are 0 if the contact laws hold.

    """

    quantities: tuple[tuple[str, str], ...]
    measure: Callable[[Run], list[float]]


ARTEFACTS = (
    Artefact((('creep on a slope of 10 deg, mu 0.5', 'm/s'),), creep),
    Artefact((('lifting while sliding at 6 m/s', 'm'),), lifting),
    Artefact(
        (
            ('sliding with mu 0.1 and 0.5, end point off by', 'm'),
            ('sliding with mu 0.1 and 0.5, direction off by', 'deg'),
        ),
        direction,
    ),
    Artefact((('penetration at rest', 'm'),), rest),
    Artefact(
        (('penetration after a drop of 0.1 m', 'm'), ('rebound after a drop of 0.1 m', 'm')),
        drop,
    ),
    Artefact((('energy gained by spinning for 10 s', '%'),), spin),
)


# ---- table --------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class Row:
    """One quantity of one contender; the value is empty if it could not be measured."""

    artefact: str
    method: str
    setting: str
    dt: float = DT  # s
    unit: str
    exact: float = 0.0
    value: float | None = None
    message: str = ''


COLUMNS = tuple(item.name for item in fields(Row))
KEY = ('artefact', 'method', 'setting')


def make_second_order(scene: Scene) -> Stepper:
    """Return a stepper of method bdf2."""
    return make_stepper(replace(scene, method='bdf2'))


def contenders() -> dict[tuple[str, str], Run]:
    """Return the function that runs each contender, by method and setting."""
    regularized = f'tanh {PENALTY.sliding_velocity:g} m/s, {PENALTY.stiffness:g} N/m'
    defaults = MujocoSettings(
        drive='torque', integrator='Euler', cone='pyramidal', contact='default'
    )
    return {
        ('newton', ''): partial(states_of_stepper, make_stepper),
        ('bdf2', ''): partial(states_of_stepper, make_second_order),
        ('semi_implicit_euler', regularized): partial(
            states_of_stepper, partial(make_semi_implicit, penalty=PENALTY)
        ),
        ('pyramid', ''): partial(states_of_stepper, make_pyramid),
        ('mujoco', 'default'): _of_mujoco(defaults),
        ('mujoco', 'accurate'): _of_mujoco(MujocoSettings(contact='accurate')),
        ('mujoco', 'fast'): _of_mujoco(MujocoSettings(contact='fast')),
    }


def _of_mujoco(settings: MujocoSettings) -> Run:
    def run(scene: Scene, start: State, steps: int, every: int) -> Trajectory:
        return mujoco_trajectory(scene, settings, start, steps, every)

    return run


def measurements(done: Iterable[Mapping[str, Any]]) -> Iterator[Callable[[], list[Row]]]:
    """Yield a function for each measurement that is not done yet; it returns the rows."""
    there = {tuple(row[name] for name in KEY) for row in done}
    for (method, setting), run in contenders().items():
        for artefact in ARTEFACTS:
            rows = [
                Row(artefact=name, unit=unit, method=method, setting=setting)
                for name, unit in artefact.quantities
            ]
            if not there.issuperset((row.artefact, method, setting) for row in rows):
                yield partial(measured, artefact, run, rows)


class _EndedEarly(Exception):
    """A run failed before all of its steps were done."""


def measured(artefact: Artefact, run: Run, rows: list[Row]) -> list[Row]:
    """Return the rows of an artefact with their values, or with the reason why they have none."""

    def complete(scene: Scene, start: State, steps: int, every: int) -> Trajectory:
        trajectory = run(scene, start, steps, every)
        if len(trajectory.time) <= steps // every:
            raise _EndedEarly('the run failed before its end')
        return trajectory

    try:
        values = artefact.measure(complete)
    except (ParameterError, _EndedEarly) as error:
        return [replace(row, message=str(error)) for row in rows]
    return [replace(row, value=float(x)) for row, x in zip(rows, values, strict=True)]


def text_table(rows: Iterable[Row]) -> str:
    """Return a table in Markdown with a line for each artefact and a column for each contender."""
    cells: dict[tuple[str, str], dict[str, str]] = {}
    columns: dict[str, None] = {}
    for row in rows:
        column = ', '.join(filter(None, (f'`{row.method}`', row.setting)))
        columns[column] = None
        name = f'{row.artefact} [{row.unit}]', f'{row.exact:g}'
        cells.setdefault(name, {})[column] = '-' if row.value is None else f'{row.value:.2g}'
    lines = [
        ['artefact', 'exact', *columns],
        *([*name, *(values.get(c, '-') for c in columns)] for name, values in cells.items()),
    ]
    widths = [max(map(len, entries)) for entries in zip(*lines, strict=True)]
    lines.insert(1, ['-' * width for width in widths])
    return ''.join(f'| {" | ".join(map(str.ljust, line, widths))} |\n' for line in lines)
