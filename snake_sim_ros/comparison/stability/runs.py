"""
Where methods converge, lose accuracy, do not converge or blow up: maps over two quantities.

A cell of a map is one short run. `outcome` decides how it went, by one rule for all maps, from
what the run itself reports and from its error against a fine run or a closed form. Where theory
knows a limit, it is in the cell too. Cells are written to a CSV file as they are done; those that
are there already are not run again.
"""

from collections.abc import Callable
from collections.abc import Container
from collections.abc import Iterator
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import fields
from dataclasses import replace
from functools import cache
from itertools import product
import math
import time
from typing import Any

import numpy as np

from snake_sim_ros.comparison.course import SAMPLE
from snake_sim_ros.comparison.csv_tables import records_of
from snake_sim_ros.comparison.csv_tables import Table
from snake_sim_ros.dynamics.energy import mechanical_energy
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import ParameterError
from snake_sim_ros.scene.parameters import Array
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.stepping.base import Report
from snake_sim_ros.stepping.base import Stepper
from snake_sim_ros.stepping.methods import empty_history
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.simulation import steps_in
from snake_sim_ros.stepping.state import State

OUTCOMES = ('converged', 'inaccurate', 'unconverged', 'blown_up')  # or failed: it raised
POSSIBLE = 2.0  # energy over the largest possible one from which on a run is blown up
DRIVEN = 5.0  # what a driven robot may have, over what it has in the fine run
ENOUGH = 20  # unconverged steps after which a run ends: more would not change the outcome
FIRST_CHUNK = 25  # steps of a call, which double while they converge


@dataclass(frozen=True)
class Case:
    """
    A run that a cell makes.

    Attributes
    ----------
    scene : Scene
        Its gait is the joint reference.
    start : State
    duration : float
        A multiple of SAMPLE, or below it [s].
    available : float
        Largest energy that is physically possible [J], see Run; if it is nan, since joints drive
        the robot, DRIVEN times that of the fine run.
    make : callable, optional
        ``make(scene)`` is the stepper, if not that of the scene's method.

    """

    scene: Scene
    start: State
    duration: float
    available: float = math.nan
    make: Callable[[Scene], Stepper] | None = None


@dataclass(frozen=True)
class Run:
    """
    What became of a case.

    Attributes
    ----------
    q, u : ndarray, shape (m, n, 7), (m, n, 6)
        At the start and every SAMPLE, or at the end of a shorter run.
    impulse : ndarray, shape (contacts, 5)
        Contact impulses of the last step [N s].
    energy : float
        Largest kinetic energy, with the potential energy as far as it is above that of the start,
        at a sample or in the last state [J].
    report : Report
    complete : bool
        Whether it went on for the whole duration.
    seconds : float
        Wall time of all steps, without compiling [s].

    """

    q: Array
    u: Array
    impulse: Array
    energy: float
    report: Report
    complete: bool
    seconds: float


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
        Rows of the picture: a method of stepping.METHODS, maybe with the scheme of its joint
        controller, or a baseline or peer that `maps.run_case` knows.
    case : callable
        ``case(method, x, y)`` is the run of a cell.
    error : callable
        ``error(case, run, fine)`` is compared with the tolerance; fine is None without `fine_dt`.
    measure : str
        What the error is, with its unit.
    tolerance : float
    limit : callable
        ``limit(method, y)`` is the largest x that theory allows; nan if it names none.
    fine_method : str
        Method of a fine run at every y, one of `methods`; empty if there is no fine run.
    fine_dt : float
        Its time step, which divides SAMPLE [s].

    """

    name: str
    title: str
    x: Axis
    y: Axis
    methods: tuple[str, ...]
    case: Callable[[str, float, float], Case]
    error: Callable[[Case, Run, Run | None], float]
    measure: str
    tolerance: float
    limit: Callable[[str, float], float]
    fine_method: str = ''
    fine_dt: float = math.nan


@dataclass(frozen=True, kw_only=True)
class Cell:
    """
    A row of the file: where it is in which map, how it went, and the numbers behind that.

    Attributes
    ----------
    limit : float
        Largest x that theory allows at this y; nan if it names none.
    value, tolerance : float
        Error of the run and what it may be; nan if the run ended early.
    measure : str
        What the error is, with its unit.
    energy : float
        Over the largest that is physically possible.
    residual_max : float
        [m/s]
    iterations : float
        A step.
    seconds : float
        Wall time of the run [s].
    message : str
        Why a run failed.

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
    Return how a run went, one of OUTCOMES: the worst that is true.

    Parameters
    ----------
    report : Report
    energy : float
        Over the largest that is physically possible. Discrete energies swing around the true one
        close to a limit, hence the factor POSSIBLE.
    value, tolerance : float
        Error of the run, and the largest that counts as accurate.

    """
    if report.failure or not energy <= POSSIBLE:
        return 'blown_up'
    if report.unconverged:
        return 'unconverged'
    return 'converged' if value <= tolerance else 'inaccurate'


def simulate(case: Case) -> Run:
    """Run a case until it is over, has failed, or has had ENOUGH unconverged steps."""
    scene, joints = case.scene, case.scene.robot.link_count - 1
    stepper = (case.make or make_stepper)(scene)
    period = min(SAMPLE, case.duration)
    steps = steps_in(period, scene.dt, 'sampling period')
    end = steps * steps_in(case.duration, period, 'duration')
    state, history, report = case.start, empty_history(scene), Report()
    none = np.zeros((0, joints, 2))
    stepper.advance(state, history, none, none)  # compiles
    states, chunk, failed = [state], FIRST_CHUNK, False
    begin = time.perf_counter()
    while report.steps < end and not failed:
        left = steps - report.steps % steps
        times = (report.steps + 0.5 + np.arange(min(chunk, left))) * scene.dt
        reference = gait.reference(scene.gait, times, joints)
        state, history, news = stepper.advance(state, history, *reference)
        report += news
        chunk = FIRST_CHUNK if report.unconverged else 2 * chunk
        failed = bool(report.failure) or report.unconverged >= ENOUGH
        if report.steps % steps == 0 and not report.failure:
            states.append(state)
    seconds = time.perf_counter() - begin
    q, u = (np.array([getattr(entry, name) for entry in [*states, state]]) for name in 'qu')
    kinetic = mechanical_energy(replace(scene, gravity=(0.0, 0.0, 0.0)), q, u)
    potential = mechanical_energy(scene, q, u) - kinetic
    return Run(
        q=q[:-1],
        u=u[:-1],
        impulse=history.impulse,
        energy=float((kinetic + np.maximum(potential - potential[0], 0.0)).max()),
        report=report,
        complete=report.steps == end,
        seconds=seconds,
    )


def judged(bare: Cell, chart: StabilityMap, case: Case, run: Run, fine: Run | None) -> Cell:
    """Return a cell with what became of its run."""
    report, available = run.report, case.available
    if fine and math.isnan(available):
        available = DRIVEN * fine.energy
    energy = run.energy / available if math.isfinite(run.energy) else math.inf
    value = chart.error(case, run, fine) if run.complete else math.nan
    return replace(
        bare,
        outcome=outcome(report, energy, value, chart.tolerance),
        value=value,
        energy=energy,
        steps=report.steps,
        iterations=report.iterations / max(report.steps, 1),
        unconverged=report.unconverged,
        residual_max=report.residual_max,
        seconds=run.seconds,
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
    """Return what tells a cell apart."""
    return tuple(str(row[name]) for name in ('map', 'method', 'x', 'y'))


def places(chart: StabilityMap) -> Iterator[dict[str, Any]]:
    """Yield the `key` columns of all cells of a map, cells of one y in a row."""
    for y, method, x in product(chart.y.values, chart.methods, chart.x.values):
        yield {'map': chart.name, 'method': method, 'x': x, 'y': y}


def cells(
    chart: StabilityMap, done: Container[tuple[str, ...]], run: Callable[[str, Case], Run]
) -> Iterator[Cell]:
    """
    Run the cells of a map by and by.

    Parameters
    ----------
    chart : StabilityMap
    done : container
        The `key` of cells to leave out.
    run : callable
        ``run(method, case)``; whatever it raises is a cell, too, except an end from the keyboard.

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
        See `csv_tables.records_of`; or if an outcome is none.

    """
    found: list[Cell] = records_of(table, 'stability', Cell)
    for cell in found:
        if cell.outcome not in (*OUTCOMES, 'failed'):
            raise ParameterError(
                f'outcome must be one of {", ".join(OUTCOMES)}, failed; got {cell.outcome!r}'
            )
    return found
