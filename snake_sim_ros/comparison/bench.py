"""
The bench: a matrix of runs, one row of a CSV file for each.

Parts of the matrix are `precision`, every contender over its time steps in every case against the
converged solution; `links`, the cost of a step over the number of links; `situations`, what a step
costs by what there is to pay for; `stages`, where its time goes; `iterations`, residuals of the
solvers on stored hard problems; `start_up`; `agreement`, how far the paths of other solvers are
from that of `newton`; and `soak`, what penetration and memory do in very many steps. A run that
fails is a row like any other. The file grows row by row: what is in it is not run again, so that
an interrupted bench goes on.

The error of a run is that against the converged solution of the paper's model. A baseline has
another model, so that it has two errors: `error_limit` is that of its time step, against where its
own small steps lead, and `model_error` that of this limit.
"""

from collections.abc import Iterable
from collections.abc import Iterator
from collections.abc import Mapping
from collections.abc import Sequence
from dataclasses import replace
import math

from snake_sim_ros.comparison.bench_entries import Contender
from snake_sim_ros.comparison.bench_rows import Entry
from snake_sim_ros.comparison.bench_rows import Row
from snake_sim_ros.comparison.course import Course
from snake_sim_ros.comparison.course import extrapolated
from snake_sim_ros.comparison.course import largest_difference
from snake_sim_ros.comparison.course import path_error
from snake_sim_ros.comparison.hard_contacts import load_problems
from snake_sim_ros.comparison.hard_contacts import reports_by_limit
from snake_sim_ros.comparison.soak import MARKS
from snake_sim_ros.comparison.soak import QUICK_MARKS
from snake_sim_ros.comparison.soak import soak
from snake_sim_ros.comparison.soak import SOAKED
from snake_sim_ros.comparison.soak import soaked_scene
from snake_sim_ros.comparison.stage_times import stage_times
from snake_sim_ros.comparison.timing import calibration
from snake_sim_ros.comparison.timing import CASE_A
from snake_sim_ros.comparison.timing import converged
from snake_sim_ros.comparison.timing import SITUATIONS
from snake_sim_ros.comparison.timing import situations
from snake_sim_ros.comparison.timing import start_up_seconds
from snake_sim_ros.comparison.timing import timed
from snake_sim_ros.comparison.timing import with_links
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.parameters import Scene
from snake_sim_ros.scene.parameters import with_settings
from snake_sim_ros.stepping.base import Report

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
AGREEING: dict[str, tuple[str, float, str]] = {  # what stops a solver, where, and its unit
    'newton_dense': ('solver.residual_tolerance', 1e-9, 'm/s'),
    'gauss_seidel': ('solver.residual_tolerance', 1e-9, 'm/s'),
    'paper': ('solver.tolerance', 1e-10, 'N s'),
}


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


def reported(row: Row, report: Report) -> Row:
    """Return a row with how the solver did in some steps."""
    return replace(
        row,
        status=report.status.value,
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


def measured(row: Row, course: Course) -> Row:
    """Return a row with what a course took, and how its solver did."""
    report, simulated = course.report, course.simulated
    return replace(
        reported(row, report),
        dt=simulated / report.steps if math.isnan(row.dt) and report.steps else row.dt,
        status=course.status,
        energy_error=course.energy_error,
        seconds_per_second=course.seconds / simulated if simulated else math.nan,
        median_us=course.median,
        p99_us=course.p99,
        calibration_us=calibration(),
        compile_seconds=course.compile_seconds,
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


def agreement(scenes: Mapping[str, Scene], methods: Iterable[str]) -> Iterator[Entry]:
    """Yield how far from the path of `newton` other solvers get, with the same steps and laws."""
    paths: dict[str, Course] = {}
    for case, scene in scenes.items():
        usual = with_settings(scene, {'level': 'spatial', 'method': 'newton'})
        for method in [name for name in AGREEING if name in set(methods)]:
            setting, tolerance, unit = AGREEING[method]
            row = Row(
                part='agreement', case=case, method=method, level='spatial',
                setting=f'{setting} in {unit}', dt=scene.dt, tolerance=tolerance,
                n=scene.robot.link_count, duration=scene.duration,
            )  # fmt: skip
            own = with_settings(usual, {'method': method, setting: tolerance})

            def run(row: Row = row, usual: Scene = usual, own: Scene = own) -> list[Row]:
                if row.case not in paths:
                    paths[row.case] = timed(usual)
                course = timed(own)
                difference = path_error(course.path, paths[row.case].path)
                row = replace(row, path_difference=difference, seconds=course.seconds)
                return [measured(row, course)]

            yield Entry((row,), run, 10.0 + 1e-4 * scene.duration / scene.dt)


def soaks(marks: Sequence[int]) -> Iterator[Entry]:
    """Yield very long runs; each has a row for every one of its marks."""
    for name in SOAKED:
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
        Whether to take two numbers of links instead of all, and a hundredth of the steps of soaks.

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
        'agreement': agreement(scenes, {rival.method for rival in rivals}),
        'soak': soaks(QUICK_MARKS if quick else MARKS),
    }
