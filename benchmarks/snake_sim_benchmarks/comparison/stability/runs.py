# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Maps over two quantities of where methods are accurate, inaccurate, unconverged, or blow up.

A cell of a map is one short run. `outcome` classifies it by one rule for all maps, from the
report of the run and from its error against a fine run or a closed form. A cell also has the limit
of theory if there is one. Cells are written to a CSV file one after the other, and cells that the
file already has are not run again.
"""

from collections.abc import Callable, Container, Iterator, Mapping
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import product
import math
from typing import Any

import numpy as np

from snake_sim_benchmarks.comparison.csv_tables import records_of, Table
from snake_sim_benchmarks.comparison.paths import SAMPLING_PERIOD
from snake_sim_benchmarks.energy import mechanical_energy
from snake_sim_ros import ParameterError, Report, Scene, Simulation, State
from snake_sim_ros.scene.parameters import steps_in
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.sampling import Keep, Limits
from snake_sim_ros.stepping.simulation import sample
from snake_sim_ros.stepping.trajectory import Trajectory

OUTCOMES = ('converged', 'inaccurate', 'unconverged', 'blown_up')  # or failed: it raised
BLOWN_UP_ENERGY = 2.0  # over the largest possible one
DRIVEN_ENERGY = 5.0  # possible for a driven robot, over the largest of the fine run
UNCONVERGED_LIMIT = 20  # so many steps end a run: more would not change its outcome


@dataclass(frozen=True)
class Case:
    """
    The run of a cell.

    The energy that is available is nan if joints drive the robot; then it is DRIVEN_ENERGY times
    the energy of the fine run.
    """

    scene: Scene  # its gait is the joint reference
    start: State
    duration: float  # a multiple of SAMPLING_PERIOD, or below it [s]
    available: float = math.nan  # largest energy that is physically possible [J], see Run
    make: Callable[[Scene], Stepper] | None = None  # default: the stepper of the scene's method


@dataclass(frozen=True)
class Run:
    """
    The result of a case, sampled every SAMPLING_PERIOD, or at the end if it is shorter.

    The energy is the largest sum of the kinetic energy and of the potential energy above that of
    the start, at the samples and in the last state. Potential energy below that of the start
    counts 0.
    """

    trajectory: Trajectory
    energy: float  # [J]
    complete: bool  # whether it lasted for the whole duration


@dataclass(frozen=True)
class Axis:
    """Values of a quantity, its name and unit ('1' for none)."""

    name: str
    unit: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class StabilityMap:
    """
    A grid of runs for some methods.

    Attributes
    ----------
    name, title : str
    x, y : Axis
    methods : tuple of str
        Rows of the picture: a method of `methods.METHODS`, maybe with the scheme of its
        joint controller, or a baseline or `mujoco`, see `maps.run_case`.
    case : callable
        ``case(method, x, y)`` returns the case of a cell.
    error : callable
        ``error(case, trajectory, fine)`` returns the error that is compared with the tolerance.
        The fine trajectory is None without `fine_dt`.
    measure : str
        Name of the error, with its unit.
    tolerance : float
    limit : callable
        ``limit(method, y)`` returns the largest x that theory allows; nan if there is no limit.
    fine_method : str
        Method of a fine run at every y, one of `methods`; empty if there is no fine run.
    fine_dt : float
        Its time step, which divides SAMPLING_PERIOD [s].

    """

    name: str
    title: str
    x: Axis
    y: Axis
    methods: tuple[str, ...]
    case: Callable[[str, float, float], Case]
    error: Callable[[Case, Trajectory, Trajectory | None], float]
    measure: str
    tolerance: float
    limit: Callable[[str, float], float]
    fine_method: str = ''
    fine_dt: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Cell:
    """
    A row of the file: the place of a cell in its map, its outcome, and the numbers behind it.

    Attributes
    ----------
    limit : float
        Largest x that theory allows at this y; nan if there is no limit.
    value, tolerance : float
        Error of the run, and the largest error that counts as accurate. The error is nan if the
        run ended early.
    measure : str
        Name of the error, with its unit.
    energy : float
        Largest energy, over the largest that is physically possible.
    residual_max : float
        [m/s]
    iterations : float
        Mean number in a step.
    seconds : float
        Wall time of the run [s].
    message : str
        Reason why a run failed.

    """

    map: str
    method: str
    x_name: str
    x: float
    y_name: str
    y: float
    limit: float
    outcome: str = 'failed'
    value: float = math.nan
    tolerance: float
    measure: str
    energy: float = math.nan
    steps: int = 0
    iterations: float = math.nan
    unconverged: int = 0
    residual_max: float = math.nan
    seconds: float = math.nan
    message: str = ''


COLUMNS = tuple(item.name for item in fields(Cell))


def outcome(report: Report, energy: float, value: float, tolerance: float) -> str:
    """
    Return the outcome of a run: the worst one of OUTCOMES that applies.

    Parameters
    ----------
    report : Report
    energy : float
        Largest energy, over the largest that is physically possible. Close to a limit, discrete
        energies oscillate around the true one; BLOWN_UP_ENERGY allows for that.
    value, tolerance : float
        Error of the run, and the largest that counts as accurate.

    """
    if report.failure or not energy <= BLOWN_UP_ENERGY:
        return 'blown_up'
    if report.unconverged:
        return 'unconverged'
    return 'converged' if value <= tolerance else 'inaccurate'


def simulate(case: Case) -> Run:
    """Run a case until its end, a failure, or too many unconverged steps."""
    scene = case.scene
    period = min(SAMPLING_PERIOD, case.duration)
    steps = steps_in(period, scene.dt, 'sampling period')
    samples = steps_in(case.duration, period, 'duration')
    simulation = Simulation(scene, case.make and case.make(scene))
    simulation.state = case.start
    none = np.zeros((0, scene.robot.link_count - 1, 2))
    simulation.stepper.advance(case.start, simulation.history, none, none)  # compiles
    limits = Limits(unconverged=UNCONVERGED_LIMIT, times_references=True)
    keep = Keep(impulses=True)
    trajectory = sample(simulation, steps, samples, keep=keep, limits=limits)
    last = simulation.state
    q = np.concatenate([trajectory.coordinates, last.q[None]])
    u = np.concatenate([trajectory.velocity, last.u[None]])
    kinetic = mechanical_energy(replace(scene, gravity=(0.0, 0.0, 0.0)), q, u)
    potential = mechanical_energy(scene, q, u) - kinetic
    energy = float((kinetic + np.maximum(potential - potential[0], 0.0)).max())
    return Run(trajectory, energy, complete=len(trajectory.time) > samples)


def judged(bare: Cell, chart: StabilityMap, case: Case, run: Run, fine: Run | None) -> Cell:
    """Return a cell with the result of its run."""
    trajectory, available = run.trajectory, case.available
    report = trajectory.report
    if fine and math.isnan(available):
        available = DRIVEN_ENERGY * fine.energy
    energy = run.energy / available if math.isfinite(run.energy) else math.inf
    expected = fine.trajectory if fine else None
    value = chart.error(case, trajectory, expected) if run.complete else math.nan
    return replace(
        bare,
        outcome=outcome(report, energy, value, chart.tolerance),
        value=value,
        energy=energy,
        steps=report.steps,
        iterations=report.iterations / max(report.steps, 1),
        unconverged=report.unconverged,
        residual_max=report.residual_max,
        seconds=trajectory.seconds,
        message=report.failure,
    )


def coarser(chart: StabilityMap) -> StabilityMap:
    """Return a map with a third of the values on the x axis and half of those on the y axis."""
    x, y = (
        replace(axis, values=axis.values[::stride])
        for axis, stride in ((chart.x, 3), (chart.y, 2))
    )
    return replace(chart, x=x, y=y)


def key(row: Mapping[str, object]) -> tuple[str, ...]:
    """Return the columns that identify a cell."""
    return tuple(str(row[name]) for name in ('map', 'method', 'x', 'y'))


def places(chart: StabilityMap) -> Iterator[dict[str, Any]]:
    """Yield the `key` columns of all cells of a map, sorted by y."""
    for y, method, x in product(chart.y.values, chart.methods, chart.x.values):
        yield {'map': chart.name, 'method': method, 'x': x, 'y': y}


def cells(
    chart: StabilityMap, done: Container[tuple[str, ...]], run: Callable[[str, Case], Run]
) -> Iterator[Cell]:
    """
    Run the cells of a map one after the other.

    Parameters
    ----------
    chart : StabilityMap
    done : container
        Keys of the cells to leave out, see `key`.
    run : callable
        ``run(method, case)`` returns the result of a case. An exception makes a cell as well,
        except an interruption from the keyboard.

    """
    fine: dict[float, Run] = {}
    limit = cache(chart.limit)
    for place in places(chart):
        method, x, y = place['method'], place['x'], place['y']
        if key(place) in done:
            continue
        bare = Cell(
            **place, x_name=chart.x.name, y_name=chart.y.name,
            limit=limit(method, y), tolerance=chart.tolerance, measure=chart.measure,
        )  # fmt: skip
        try:
            with np.errstate(all='ignore'):
                if chart.fine_method and y not in fine:
                    case = chart.case(chart.fine_method, x, y)
                    case = replace(case, scene=replace(case.scene, dt=chart.fine_dt))
                    fine[y] = run(chart.fine_method, case)
                case = chart.case(method, x, y)
                yield judged(bare, chart, case, run(method, case), fine.get(y))
        except Exception as error:  # the map goes on, the row says what happened
            message = ' '.join(f'{type(error).__name__}: {error}'.split())
            yield replace(bare, outcome='failed', message=message)


def cells_of(table: Table) -> list[Cell]:
    """
    Return the cells of a file with numbers for their texts.

    Raises
    ------
    ParameterError
        See `csv_tables.records_of`, or if an outcome is unknown.

    """
    found: list[Cell] = records_of(table, 'stability', Cell)
    for cell in found:
        if cell.outcome not in (*OUTCOMES, 'failed'):
            raise ParameterError(
                f'outcome must be one of {", ".join(OUTCOMES)}, failed; got {cell.outcome!r}'
            )
    return found
