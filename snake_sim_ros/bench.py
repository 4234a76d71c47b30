"""
The bench: a matrix of runs, one row of a CSV file for each.

Parts of the matrix are `precision`, every contender over its time steps in every case against the
converged solution; `links`, the cost of a step over the number of links; `situations`, what a step
costs by what there is to pay for; `stages`, where its time goes; `iterations`, residuals of the
solvers on stored hard problems; and `start_up`. A run that fails is a row like any other. The file
grows row by row: what is in it is not run again, so that an interrupted bench goes on.

The error of a run is that against the converged solution of the paper's model. A baseline has
another model, so that it has two errors: `error_limit` is that of its time step, against where its
own small steps lead, and `model_error` that of this limit.
"""

from collections.abc import Callable
from collections.abc import Iterable
from collections.abc import Iterator
from collections.abc import Mapping
from dataclasses import asdict
from dataclasses import dataclass
from dataclasses import fields
from dataclasses import replace
import math
from typing import Any

from snake_sim_ros.contenders import Contender
from snake_sim_ros.course import Course
from snake_sim_ros.course import extrapolated
from snake_sim_ros.course import largest_difference
from snake_sim_ros.course import path_error
from snake_sim_ros.hard_contacts import load_problems
from snake_sim_ros.hard_contacts import reports_by_limit
from snake_sim_ros.parameters import load_scene
from snake_sim_ros.parameters import Scene
from snake_sim_ros.records import ParameterError
from snake_sim_ros.stages import stage_times
from snake_sim_ros.tables import is_empty
from snake_sim_ros.tables import records_of
from snake_sim_ros.tables import Table
from snake_sim_ros.timing import calibration
from snake_sim_ros.timing import CASE_A
from snake_sim_ros.timing import converged
from snake_sim_ros.timing import SITUATIONS
from snake_sim_ros.timing import situations
from snake_sim_ros.timing import start_up_seconds
from snake_sim_ros.timing import with_links

LINK_COUNTS = (5, 10, 20, 40, 80, 160, 200)
LINKS_DURATION = 0.3  # s
SITUATIONS_DURATION = 1.0  # s
MOST_LINKS = {'newton_dense': 40, 'gauss_seidel': 40, 'paper': 80}  # of methods of higher cost
HARD = (
    'sidewinding step 1007',
    'lateral_undulation step 0',
    'sticking, curved',
    'dropped and spinning, mu 1',
    'heavy link sliding, curved',
    'pitched link sliding, mu 0.5',
)
SOLVERS = ('newton', 'gauss_seidel', 'paper')
MOST_ITERATIONS = 10_000


@dataclass(frozen=True, kw_only=True)
class Row:
    """
    A run: what it was, in the columns of KEY, and what came out; nan or None: it means nothing.

    Times are wall times; errors are the largest at any time. `path_error` and what is derived from
    it are relative to the distance of the middle link from start to end.
    """

    part: str
    case: str
    method: str
    level: str = ''
    setting: str = ''
    dt: float = math.nan  # s; mean step of a method that chooses it
    tolerance: float = math.nan  # of a method that chooses its steps
    n: int | None = None
    duration: float = math.nan  # s
    status: str = ''
    error_path: float = math.nan
    error_angle: float = math.nan  # rad
    error_heading: float = math.nan  # rad
    reference_error: float = math.nan  # how far the converged solution is from converged
    error_limit: float = math.nan
    model_error: float = math.nan
    energy_error: float = math.nan
    seconds_per_second: float = math.nan
    median_us: float = math.nan
    p99_us: float = math.nan
    calibration_us: float = math.nan  # of a fixed amount of arithmetic, timed beside the run
    compile_seconds: float = math.nan
    steps: int | None = None
    planar_steps: int | None = None
    iterations: int | None = None
    iterations_max: int | None = None
    fallbacks: int | None = None
    unconverged: int | None = None
    residual_max: float = math.nan  # m/s
    penetration_max: float = math.nan  # m
    joint_gap_max: float = math.nan  # m
    joint_twist_max: float = math.nan
    message: str = ''


COLUMNS = tuple(item.name for item in fields(Row))
KEY = ('part', 'case', 'method', 'level', 'setting', 'dt', 'tolerance', 'n', 'duration')


@dataclass(frozen=True)
class Entry:
    """
    Something to run for one row or some.

    Attributes
    ----------
    keys : tuple of Row
        Rows with nothing but their keys.
    run : callable
        Returns the rows; those without a key of `keys` follow from the same run.
    guess : float
        How long it may take, for the progress bar [s].

    """

    keys: tuple[Row, ...]
    run: Callable[[], list[Row]]
    guess: float

    def is_in(self, done: set[tuple[str, ...]]) -> bool:
        """Return whether a file with rows of these keys has all of this entry already."""
        return done.issuperset(key(asdict(row)) for row in self.keys)


def key(row: Mapping[str, Any]) -> tuple[str, ...]:
    """Return what identifies a row; a method that chooses its steps is known by its tolerance."""
    texts = {name: '' if is_empty(row[name]) else str(row[name]) for name in KEY}
    if texts['tolerance']:
        texts['dt'] = ''
    return tuple(texts.values())


class References:
    """Converged solutions of the cases, and where small steps of a baseline lead; made once."""

    def __init__(self, scenes: Mapping[str, Scene]) -> None:
        self.scenes = scenes
        self._converged: dict[str, tuple[Course, float]] = {}
        self._limits: dict[tuple[str, str], Course | None] = {}

    def converged(self, case: str) -> tuple[Course, float]:
        """Return the converged solution of a case, and how far it is from being converged."""
        if case not in self._converged:
            self._converged[case] = converged(self.scenes[case])
        return self._converged[case]

    def own_limit(self, case: str, contender: Contender) -> Course | None:
        """
        Return where small steps of a contender lead; the converged solution if that is it.

        None if it is not asked for, or if the contender does not get through with them.
        """
        if contender.own_limit is None:
            return None
        if not contender.own_limit:
            return self.converged(case)[0]
        name, model = contender.own_limit
        if (case, name) not in self._limits:
            coarse, fine = (
                model.run(model.scene(self.scenes[case], rate), limit=math.inf)
                for rate in model.rates
            )
            whole = coarse.path.shape == fine.path.shape
            self._limits[case, name] = extrapolated(coarse, fine) if whole else None
        return self._limits[case, name]


def measured(row: Row, course: Course) -> Row:
    """Return a row with what a course took, and how its solver did."""
    report, simulated = course.report, course.simulated
    return replace(
        row,
        dt=simulated / report.steps if math.isnan(row.dt) and report.steps else row.dt,
        status=course.status,
        energy_error=course.energy_error,
        seconds_per_second=course.seconds / simulated if simulated else math.nan,
        median_us=course.median,
        p99_us=course.p99,
        calibration_us=calibration(),
        compile_seconds=course.compile_seconds,
        steps=report.steps,
        planar_steps=report.planar_steps,
        iterations=report.iterations,
        iterations_max=report.iterations_max,
        fallbacks=report.fallbacks,
        unconverged=report.unconverged,
        residual_max=report.residual_max,
        penetration_max=report.penetration_max,
        joint_gap_max=report.joint_gap_max,
        joint_twist_max=report.joint_twist_max,
        message=report.failure,
    )


def compared(row: Row, course: Course, expected: Course, doubt: float, own: Course | None) -> Row:
    """Return a row with its errors, infinite for a run that ended early."""
    row = replace(
        row,
        reference_error=doubt,
        error_path=path_error(course.path, expected.path),
        error_angle=largest_difference(course.joint_angle, expected.joint_angle),
        error_heading=largest_difference(course.heading, expected.heading),
    )
    if own is None:
        return row
    if own is not expected:
        row = replace(row, model_error=path_error(own.path, expected.path))
    return replace(row, error_limit=path_error(course.path, own.path))


def precision(
    references: References, rivals: Iterable[Contender], limit: float
) -> Iterator[Entry]:
    """Yield every contender at every step in every case that it can do."""
    for case, scene in references.scenes.items():
        moves_up = scene.gait.pitch.amplitude != 0.0
        for rival in rivals:
            if rival.level == 'planar' and moves_up:
                continue
            for rate in rival.rates:
                row = Row(
                    part='precision', case=case, method=rival.method, level=rival.level,
                    setting=rival.setting, dt=math.nan if rival.adaptive else 1 / rate,
                    tolerance=rate if rival.adaptive else math.nan,
                    n=scene.robot.link_count, duration=scene.duration,
                )  # fmt: skip
                own = rival.scene(scene, rate)

                def run(rival: Contender = rival, row: Row = row, own: Scene = own) -> list[Row]:
                    options = {'tolerance': row.tolerance} if rival.adaptive else {}
                    course = rival.run(own, limit=limit, **options)
                    expected, doubt = references.converged(row.case)
                    small_steps = references.own_limit(row.case, rival)
                    return [compared(measured(row, course), course, expected, doubt, small_steps)]

                yield Entry((row,), run, rival.seconds(own))


def links(
    scene: Scene, rivals: Iterable[Contender], counts: Iterable[int], limit: float
) -> Iterator[Entry]:
    """Yield short runs with other numbers of links, of the contenders' default settings."""
    scene = replace(scene, duration=LINKS_DURATION)
    for rival in rivals:
        for n in counts:
            if n > MOST_LINKS.get(rival.method, math.inf):
                continue
            row = Row(
                part='links', case=CASE_A, method=rival.method, level=rival.level,
                setting=rival.setting, dt=scene.dt, n=n, duration=scene.duration,
            )  # fmt: skip
            longer = replace(scene, robot=with_links(scene.robot, n))
            own = rival.scene(longer, 1 / scene.dt)

            def run(rival: Contender = rival, row: Row = row, own: Scene = own) -> list[Row]:
                return [measured(row, rival.run(own, limit=limit))]

            yield Entry((row,), run, rival.seconds(own))


def solvers() -> Iterator[Entry]:
    """Yield the residual over iterations of the solvers on hard contact problems."""
    problems = load_problems()
    for name in HARD:
        for method in SOLVERS:
            problem = problems[name]
            row = Row(
                part='iterations', case=name, method=method, level='spatial',
                dt=problem.scene.dt, n=problem.scene.robot.link_count,
            )  # fmt: skip

            def run(name: str = name, method: str = method, row: Row = row) -> list[Row]:
                return [
                    replace(
                        row,
                        status=report.status.value,
                        steps=report.steps,
                        iterations=report.iterations,
                        fallbacks=report.fallbacks,
                        unconverged=report.unconverged,
                        residual_max=report.residual_max,
                        message=report.failure,
                    )
                    for report in reports_by_limit(problems[name], method, MOST_ITERATIONS)
                ]

            yield Entry((row,), run, 5.0)


def costs(scene: Scene) -> Iterator[Entry]:
    """Yield what steps cost by what there is to pay for, and where their time goes."""
    n, dt = scene.robot.link_count, scene.dt
    usual = Row(part='situations', case=CASE_A, method='newton', level='spatial', dt=dt, n=n)
    rows = {name: replace(usual, case=name, duration=SITUATIONS_DURATION) for name in SITUATIONS}
    yield Entry(
        tuple(rows.values()),
        lambda: [
            measured(rows[name], run) for name, run in situations(SITUATIONS_DURATION).items()
        ],
        5.0,
    )
    for level in ('spatial', 'planar'):
        row = replace(usual, part='stages', level=level)

        def run(row: Row = row) -> list[Row]:
            return [
                replace(row, setting=stage, median_us=median, status='converged')
                for stage, median in stage_times(scene, row.level).items()
            ]

        yield Entry((row,), run, 15.0)


def start_up(scene: Scene) -> Iterator[Entry]:
    """Yield the time from starting a new process to its first step done."""
    for setting in ('nothing compiled before', 'everything compiled before'):
        row = Row(part='start_up', case=CASE_A, method='newton', level='auto', setting=setting)

        def run(row: Row = row) -> list[Row]:
            seconds = start_up_seconds(scene, cold=row.setting.startswith('nothing'))
            return [replace(row, compile_seconds=seconds, status='converged')]

        yield Entry((row,), run, 10.0)


def matrix(
    scenes: Mapping[str, Scene], rivals: list[Contender], limit: float, *, quick: bool
) -> dict[str, Iterator[Entry]]:
    """
    Return the matrix, part by part; a part is made as its entries are asked for.

    Parameters
    ----------
    scenes : mapping
        Cases, name -> scene.
    rivals : list of Contender
    limit : float
        Wall time after which a run ends early [s].
    quick : bool
        Whether to take two numbers of links instead of all.

    """
    scene = load_scene(CASE_A)
    counts = LINK_COUNTS[1:4:2] if quick else LINK_COUNTS
    usual = {
        (rival.method, rival.level): rival for rival in reversed(rivals) if not rival.adaptive
    }
    return {
        'precision': precision(References(scenes), rivals, limit),
        'links': links(scene, usual.values(), counts, limit),
        'iterations': solvers(),
        'costs': costs(scene),
        'start_up': start_up(scene),
    }


def outcome(entry: Entry) -> list[Row]:
    """Run an entry: anything that it raises is a row, too, except an end from the keyboard."""
    try:
        return entry.run()
    except Exception as error:  # the bench goes on, the row says what happened
        status = 'refused' if isinstance(error, ParameterError) else 'error'
        message = ' '.join(f'{type(error).__name__}: {error}'.split())
        return [replace(row, status=status, message=message) for row in entry.keys]


def line(row: Row) -> str:
    """Return a row in short, for people who wait."""
    what = [row.part, row.case, row.method, row.level, row.setting]
    if row.dt > 0.0:
        what.append(f'dt {row.dt:.2g} s')
    if row.n:
        what.append(f'n = {row.n}')
    if row.part == 'iterations' and row.iterations:
        what.append(f'{row.iterations} iterations to {row.residual_max:.1e} m/s')
    if row.median_us > 0.0:
        what.append(f'{row.median_us:.2f} us')
    if math.isfinite(row.error_path):
        what.append(f'{100 * row.error_path:.3g} %')
    return ' | '.join(part for part in [*what, row.status, row.message] if part)


def rows_of(table: Table) -> list[Row]:
    """
    Return the rows of a file with numbers for their texts.

    Raises
    ------
    ParameterError
        See `tables.records_of`.

    """
    return records_of(table, 'bench', Row)
