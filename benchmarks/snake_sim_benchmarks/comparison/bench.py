# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The bench: a matrix of runs, each of which makes one row of a CSV file.

The parts of the matrix are: `ensemble`, the errors of the best methods over many perturbed scenes
of every case; `cycle`, those after one period of the gait; `robust`, the largest over small
changes of a case; `accuracy`, the errors of runs with a target accuracy; `precision`, the error of
every contender for its time steps in one run of every case, against the converged solution;
`links`, the cost of a step over the number of links; `situations`, the cost of a step depending on
contacts and friction; `stages`, the times of the stages of a step; `iterations`, the residuals of
the solvers on stored hard problems; `start_up`; `agreement`, the distance of the paths of other
solvers from that of `newton`; `user`, what a user sees; and `soak`, penetration and memory over
very many steps. A run that fails makes a row as well. The file grows row by row, and rows that are
already in it are not run again, so that an interrupted bench can be continued.

The error of a run is its distance from the converged solution of the paper's model. A baseline has
another model and therefore two errors: `error_limit` is that of its time step, the distance from
the solution that its own small steps converge to, and `model_error` is the error of that solution.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
import math

from snake_sim_benchmarks.comparison.bench_rows import Entry, Row
from snake_sim_benchmarks.comparison.contenders import Contender
from snake_sim_benchmarks.comparison.cycles import (
    accuracies,
    cycles,
    PHASES,
    QUICK_PHASES,
    QUICK_TRIALS,
    TRIALS,
)
from snake_sim_benchmarks.comparison.ensembles import (
    ENSEMBLE,
    ensemble,
    Field,
    QUICK_ENSEMBLE,
    robust,
)
from snake_sim_benchmarks.comparison.hard_contacts import load_problems, reports_by_limit
from snake_sim_benchmarks.comparison.paths import (
    ConvergedPaths,
    extrapolated,
    largest_difference,
    Motion,
    motion,
    path_error,
)
from snake_sim_benchmarks.comparison.soak import (
    MARKS,
    QUICK_MARKS,
    soak,
    soaked_scene,
    SOAKED_SCENES,
)
from snake_sim_benchmarks.comparison.throughput import throughput
from snake_sim_benchmarks.comparison.timing import (
    calibration,
    CASE_A_NAME,
    converged,
    REFERENCE_STEPS,
    SITUATIONS,
    situations,
    stage_times,
    start_up_seconds,
    timed,
    TimedRun,
    with_links,
)
from snake_sim_benchmarks.comparison.user_times import user
from snake_sim_ros import Report, Scene
from snake_sim_ros.scene.parameters import Array, load_scene, with_settings

QUICK_REFERENCE_STEPS = (1 / 8000, 1 / 16000)  # s, see `timing.REFERENCE_STEPS`
LINK_COUNTS = (5, 10, 20, 40, 80, 160, 200)
ALSO_OVER_LINKS = ('default, spring, discrete',)  # settings besides the first of a method
LINKS_DURATION = 0.3  # s
SITUATIONS_DURATION = 1.0  # s
# Most links, for methods of higher cost.
LINK_COUNT_LIMITS = {'newton_dense': 40, 'gauss_seidel': 40, 'paper': 80}
HARD_PROBLEMS = (
    'sidewinding step 1007',
    'lateral_undulation step 0',
    'sticking, curved',
    'dropped and spinning, mu 1',
    'heavy link sliding, curved',
    'pitched link sliding, mu 0.5',
)
# Numbers of a report that a row has, and those of a solver alone.
REPORTED_BY_SOLVERS = ('steps', 'iterations', 'fallbacks', 'unconverged', 'residual_max')
REPORTED = (
    *REPORTED_BY_SOLVERS, 'planar_steps', 'iterations_max', 'penetration_max', 'joint_gap_max',
    'joint_twist_max',
)  # fmt: skip
HARD_PROBLEM_METHODS = ('newton', 'gauss_seidel', 'paper')
MOST_ITERATIONS = 10_000
# The setting that stops a solver, its value and its unit.
STOPPING_TOLERANCES: dict[str, tuple[str, float, str]] = {
    'newton_dense': ('solver.residual_tolerance', 1e-9, 'm/s'),
    'gauss_seidel': ('solver.residual_tolerance', 1e-9, 'm/s'),
    'paper': ('solver.tolerance', 1e-10, 'N s'),
}


class References:
    """Converged solutions of the cases and of the models of baselines; each is computed once."""

    def __init__(self, scenes: Mapping[str, Scene]) -> None:
        self.scenes = scenes
        self._converged: dict[str, tuple[Motion, float]] = {}
        self._limits: dict[tuple[str, str], Motion | None] = {}

    def converged(self, case: str) -> tuple[Motion, float]:
        """Return the converged solution of a case, and an estimate of its own error."""
        if case not in self._converged:
            self._converged[case] = converged(self.scenes[case])
        return self._converged[case]

    def own_limit(self, case: str, contender: Contender) -> Motion | None:
        """
        Return the solution that small steps of a contender converge to.

        For a contender with the paper's model it is the converged solution. It is None if nobody
        asks for it, or if the runs with small steps end early.
        """
        if contender.own_limit is None:
            return None
        if not contender.own_limit:
            return self.converged(case)[0]
        name, model = contender.own_limit
        if (case, name) not in self._limits:
            coarse, fine = (
                model.run(model.scene(self.scenes[case], rate), limit=math.inf).trajectory
                for rate in model.rates
            )
            whole = coarse.path.shape == fine.path.shape
            self._limits[case, name] = extrapolated(coarse, fine) if whole else None
        return self._limits[case, name]


def reported(row: Row, report: Report, numbers: Iterable[str] = REPORTED) -> Row:
    """Return a row with the status, the failure and some numbers of a report."""
    found = {name: getattr(report, name) for name in numbers}
    return replace(row, status=report.status.value, message=report.failure, **found)


def measured(row: Row, run: TimedRun) -> Row:
    """Return a row with the times and the report of a run."""
    report, simulated = run.trajectory.report, run.simulated
    return replace(
        reported(row, report),
        dt=simulated / report.steps if math.isnan(row.dt) and report.steps else row.dt,
        status=run.status,
        energy_error=run.energy_error,
        seconds_per_second=run.trajectory.seconds / simulated if simulated else math.nan,
        median_us=run.timing.median,
        p99_us=run.timing.p99,
        calibration_us=calibration(),
        compile_seconds=run.timing.compile_seconds,
    )


def compared(row: Row, found: Motion, expected: Motion, doubt: float, own: Motion | None) -> Row:
    """Return a row with its errors, which are infinite for a run that ended early."""
    row = replace(
        row,
        reference_error=doubt,
        error_path=path_error(found.path, expected.path),
        error_angle=largest_difference(found.joint_angle, expected.joint_angle),
        error_heading=largest_difference(found.heading, expected.heading),
    )
    if own is None:
        return row
    if own is not expected:
        row = replace(row, model_error=path_error(own.path, expected.path))
    return replace(row, error_limit=path_error(found.path, own.path))


def precision(
    references: References, contenders: Iterable[Contender], limit: float
) -> Iterator[Entry]:
    """Yield a run of every contender, for each of its time steps, in every case it supports."""
    for case, scene in references.scenes.items():
        moves_up = scene.gait.pitch.amplitude != 0.0
        for contender in contenders:
            if contender.level == 'planar' and moves_up:
                continue
            for rate in contender.rates:
                row = Row(
                    part='precision', case=case, method=contender.method, level=contender.level,
                    setting=contender.setting, dt=math.nan if contender.adaptive else 1 / rate,
                    tolerance=rate if contender.adaptive else math.nan,
                    n=scene.robot.link_count, duration=scene.duration,
                )  # fmt: skip
                own = contender.scene(scene, rate)
                run = partial(precision_of, references, contender, row, own, limit)
                yield Entry((row,), run, contender.seconds(own))


def precision_of(
    references: References, contender: Contender, row: Row, scene: Scene, limit: float
) -> list[Row]:
    """Run a contender in a scene that has its time step; return its row with its errors."""
    options = {'tolerance': row.tolerance} if contender.adaptive else {}
    run = contender.run(scene, limit=limit, **options)
    expected, doubt = references.converged(row.case)
    small_steps = references.own_limit(row.case, contender)
    found = motion(run.trajectory)
    return [compared(measured(row, run), found, expected, doubt, small_steps)]


def links(
    scene: Scene, contenders: Iterable[Contender], counts: Iterable[int], limit: float
) -> Iterator[Entry]:
    """Yield short runs of each contender's default setting with other numbers of links."""
    scene = replace(scene, duration=LINKS_DURATION)
    for contender in contenders:
        for n in counts:
            if n > LINK_COUNT_LIMITS.get(contender.method, math.inf):
                continue
            row = Row(
                part='links', case=CASE_A_NAME, method=contender.method, level=contender.level,
                setting=contender.setting, dt=scene.dt, n=n, duration=scene.duration,
            )  # fmt: skip
            longer = replace(scene, robot=with_links(scene.robot, n))
            own = contender.scene(longer, 1 / scene.dt)

            def run(named: Contender = contender, row: Row = row, own: Scene = own) -> list[Row]:
                return [measured(row, named.run(own, limit=limit))]

            yield Entry((row,), run, contender.seconds(own))


def solvers() -> Iterator[Entry]:
    """Yield runs of the solvers on hard contact problems: residuals over iterations."""
    problems = load_problems()
    for name in HARD_PROBLEMS:
        for method in HARD_PROBLEM_METHODS:
            problem = problems[name]
            row = Row(
                part='iterations', case=name, method=method, level='spatial',
                dt=problem.scene.dt, n=problem.scene.robot.link_count,
            )  # fmt: skip

            def run(name: str = name, method: str = method, row: Row = row) -> list[Row]:
                return [
                    reported(row, report, REPORTED_BY_SOLVERS)
                    for report in reports_by_limit(problems[name], method, MOST_ITERATIONS)
                ]

            yield Entry((row,), run, 5.0)


def costs(scene: Scene) -> Iterator[Entry]:
    """Yield the costs of steps with and without contacts and friction, and of their stages."""
    n, dt = scene.robot.link_count, scene.dt
    usual = Row(part='situations', case=CASE_A_NAME, method='newton', level='spatial', dt=dt, n=n)
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
    """Yield the time from the start of a new process to the end of its first step."""
    for setting in ('nothing compiled before', 'everything compiled before'):
        row = Row(
            part='start_up', case=CASE_A_NAME, method='newton', level='auto', setting=setting
        )

        def run(row: Row = row) -> list[Row]:
            seconds = start_up_seconds(scene, cold=row.setting.startswith('nothing'))
            return [replace(row, compile_seconds=seconds, status='converged')]

        yield Entry((row,), run, 10.0)


def agreement(scenes: Mapping[str, Scene], methods: Iterable[str]) -> Iterator[Entry]:
    """Yield distances of the paths of other solvers from that of `newton`, with equal steps."""
    paths: dict[str, Array] = {}
    for case, scene in scenes.items():
        usual = with_settings(scene, {'level': 'spatial', 'method': 'newton'})
        for method in [name for name in STOPPING_TOLERANCES if name in set(methods)]:
            setting, tolerance, unit = STOPPING_TOLERANCES[method]
            row = Row(
                part='agreement', case=case, method=method, level='spatial',
                setting=f'{setting} in {unit}', dt=scene.dt, tolerance=tolerance,
                n=scene.robot.link_count, duration=scene.duration,
            )  # fmt: skip
            own = with_settings(usual, {'method': method, setting: tolerance})

            def run(row: Row = row, usual: Scene = usual, own: Scene = own) -> list[Row]:
                if row.case not in paths:
                    paths[row.case] = timed(usual).trajectory.path
                timed_run = timed(own)
                found = timed_run.trajectory
                difference = path_error(found.path, paths[row.case])
                row = replace(row, path_difference=difference, seconds=found.seconds)
                return [measured(row, timed_run)]

            yield Entry((row,), run, 10.0 + 1e-4 * scene.duration / scene.dt)


def soaks(marks: Sequence[int]) -> Iterator[Entry]:
    """Yield very long runs; each makes a row at every mark."""
    for name in SOAKED_SCENES:
        scene = soaked_scene(name)
        rows = tuple(
            Row(
                part='soak', case=name, method=scene.method, level=scene.level, dt=scene.dt,
                n=scene.robot.link_count, duration=steps * scene.dt,
            )
            for steps in marks
        )  # fmt: skip

        def run(rows: tuple[Row, ...] = rows, scene: Scene = scene) -> list[Row]:
            looks = soak(scene, marks, restarts=bool(scene.pegs.x))
            return [
                replace(
                    reported(row, look.report),
                    seconds=look.seconds,
                    penetration_end=look.penetration_end,
                    memory_begin=look.memory_begin,
                    memory_end=look.memory_end,
                )
                for row, look in zip(rows, looks, strict=True)
            ]

        yield Entry(rows, run, 5.0 + 7e-6 * marks[-1])


def matrix(
    scenes: Mapping[str, Scene],
    contenders: list[Contender],
    field: Field,
    limit: float,
    *,
    quick: bool,
) -> dict[str, Iterator[Entry]]:
    """
    Return the matrix by parts; the entries of a part are made when they are iterated over.

    Parameters
    ----------
    scenes : mapping
        Cases, name -> scene.
    contenders : list of Contender
    field : callable
        The entrants of ensembles and cycles.
    limit : float
        Wall time after which a run ends early [s].
    quick : bool
        Whether to use small ensembles, few phases, two numbers of links, and a hundredth of the
        steps of soaks.

    """
    scene = load_scene(CASE_A_NAME)
    counts = LINK_COUNTS[1:4:2] if quick else LINK_COUNTS
    usual = {
        (contender.method, contender.level, contender.setting in ALSO_OVER_LINKS): contender
        for contender in reversed(contenders)
        if not contender.adaptive
    }
    steps = QUICK_REFERENCE_STEPS if quick else REFERENCE_STEPS
    paths = ConvergedPaths(steps)
    return {
        'ensemble': ensemble(scenes, field, paths, QUICK_ENSEMBLE if quick else ENSEMBLE),
        'cycle': cycles(scenes, field, steps, QUICK_PHASES if quick else PHASES),
        'robust': robust(scenes, field, paths),
        'accuracy': accuracies(scenes, steps, QUICK_TRIALS if quick else TRIALS),
        'precision': precision(References(scenes), contenders, limit),
        'links': links(scene, usual.values(), counts, limit),
        'iterations': solvers(),
        'costs': costs(scene),
        'start_up': start_up(scene),
        'agreement': agreement(scenes, {contender.method for contender in contenders}),
        'throughput': throughput(scenes, paths, quick=quick),
        'user': user(scenes),
        'soak': soaks(QUICK_MARKS if quick else MARKS),
    }
