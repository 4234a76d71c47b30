# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The judges: spreads of errors, families of scenes, accounting, cycles, fronts and tables."""

from dataclasses import asdict, replace
from itertools import pairwise
import math

import numpy as np
import pytest

from snake_sim_benchmarks.__main__ import main
from snake_sim_benchmarks.comparison import bench_rows, cycles, ensembles
from snake_sim_benchmarks.comparison.bench_rows import Row
from snake_sim_benchmarks.comparison.bench_tables import (
    cost_at,
    front,
    robust_table,
    speeds_table,
    spread_table,
)
from snake_sim_benchmarks.comparison.chart_style import METHOD_STYLES
from snake_sim_benchmarks.comparison.charts import spreads_figure
from snake_sim_benchmarks.comparison.csv_tables import read_table
from snake_sim_benchmarks.comparison.ensembles import (
    family,
    neighbors,
    perturbed,
    spread,
    spread_rows,
    Trial,
    worst_rows,
)
from snake_sim_benchmarks.comparison.entrants import attempts, Entrant, entrants
from snake_sim_benchmarks.comparison.mujoco_model import SEARCHED
from snake_sim_benchmarks.comparison.paths import (
    compiled_course,
    converged_path,
    ConvergedPaths,
    Course,
    course_error,
    POINT_PERIOD,
    portions,
    Start,
    step_count,
)
from snake_sim_ros import ParameterError, Report, State
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.methods import make_stepper
from snake_sim_ros.stepping.state import empty_history, initial_state

A, C = load_scene('lateral_undulation'), load_scene('sidewinding')
PATHS = 'snake_sim_benchmarks.comparison.paths'
CASES = ('lateral_undulation', 'lateral_undulation_isotropic', 'sidewinding', 'sinus_lifting')

# ---- spread of errors ---------------------------------------------------------------------------


def test_spread_of_known_errors():
    found = spread([0.03, 0.04, 0.0, 0.12, 0.05])
    assert found.rms == pytest.approx(math.sqrt((9 + 16 + 144 + 25) / 5) / 100)
    assert found.median == 0.04
    # Linear between the fourth and the fifth of five ordered errors, 0.9 (5 - 1) = 3.6.
    assert found.quantile == pytest.approx(0.05 + 0.6 * 0.07)
    assert found.low < found.rms < found.high


def test_interval_of_a_root_mean_square_is_that_of_the_theory():
    # Of squares of normal errors: mean 1, standard deviation of the mean sqrt(2/n), so that the
    # root has 1/sqrt(2n); 90 % are within 1.645 of these. A bootstrap of 400 errors knows the
    # fourth moment to some 15 %.
    n = 400
    errors = np.abs(np.random.default_rng(1).normal(size=n))
    found = spread(errors)
    assert (found.high - found.low) / 2 == pytest.approx(1.645 / math.sqrt(2 * n), rel=0.2)
    assert found == spread(errors)


def test_equal_errors_have_no_spread():
    assert spread([0.02] * 5) == pytest.approx((0.02,) * 5)
    assert spread([0.02]) == (0.02,) * 5


def test_failures_count_as_infinite():
    found = spread([0.01, 0.02, 0.03, math.inf])
    assert found.rms == found.quantile == math.inf
    assert math.isnan(found.low) and math.isnan(found.high)
    assert found.median == 0.025


# ---- families -----------------------------------------------------------------------------------


def test_a_family_is_always_the_same_and_within_its_bounds():
    scenes = family(C, 20)
    assert scenes == family(C, 20) and scenes[:7] == family(C, 7)
    friction = np.array([scene.friction.longitudinal for scene in scenes]) / 0.2
    assert 0.9 <= friction.min() < 0.93 and 1.07 < friction.max() <= 1.1
    assert all(s.friction.longitudinal == s.friction.transversal for s in scenes)
    starts = np.array([scene.gait.soft_start for scene in scenes])
    assert 4.0 <= starts.min() < 4.3 and 4.7 < starts.max() <= 5.0
    phases = np.array([s.gait.yaw.phase - C.gait.yaw.phase for s in scenes]) / (2 * math.pi)
    assert 0.0 <= phases.min() < 0.15 and 0.85 < phases.max() < 1.0
    # What is not perturbed is as given.
    assert replace(scenes[3], friction=C.friction, gait=C.gait) == C


@pytest.mark.parametrize('name', CASES)
def test_a_phase_is_the_same_gait_at_another_time(name):
    scene = load_scene(name)
    late = perturbed(scene, friction=1.0, phase=0.3, soft_start=4.2)
    assert late.gait.soft_start == (4.2 if scene.gait.soft_start else 0.0)
    times = 20.0 + np.linspace(0.0, 5.0, 7)
    expected = gait.reference(scene.gait, times + 0.3 * 4.5, 10)
    found = gait.reference(late.gait, times, 10)
    for one, other in zip(found, expected, strict=True):
        assert np.abs(one - other).max() < 1e-12


def test_neighbors_are_the_seven_runs_of_a_robust_bound():
    found = neighbors(C)
    assert len(found) == 7
    assert sorted(factor for _, factor in found.values()) == [0.8, 1, 1, 1, 1, 1, 1.2]
    friction = sorted(scene.friction.transversal / 0.2 for scene, _ in found.values())
    amplitude = sorted(s.gait.yaw.amplitude / C.gait.yaw.amplitude for s, _ in found.values())
    assert friction == amplitude == pytest.approx([0.98, 1, 1, 1, 1, 1, 1.02])
    assert len({scene for scene, _ in found.values()}) == 5


# ---- accounting ---------------------------------------------------------------------------------


class Sliding:
    """A stepper that moves the robot along x at 1 m/s, and diverges beyond a place."""

    level = 'spatial'

    def __init__(self, scene, clock, failing=math.inf):
        self.dt, self.clock, self.failing = scene.dt, clock, failing
        self.scene, self.calls = scene, []

    def empty_history(self):
        return empty_history(self.scene)

    def advance(self, state, history, angle, rate, samples=None, pushes=None):
        steps = len(angle)
        self.calls.append(steps)
        self.clock[0] += 1000 * steps + 7 * len(self.calls)
        q = state.q.copy()
        q[:, 0] += steps * self.dt
        failure = 'too far' if q[5, 0] > self.failing else ''
        return State(q, state.u), history, Report(steps=steps, unconverged=1, failure=failure)


@pytest.fixture
def sliding(monkeypatch):
    """Return what makes the stepper of `compiled_course` a sliding one, on a clock of its own."""
    made, clock = [], [0]
    monkeypatch.setattr('time.thread_time_ns', lambda: clock[0])

    def use(failing=math.inf):
        def make(scene):
            made.append(Sliding(scene, clock, failing))
            return made[-1]

        monkeypatch.setattr(f'{PATHS}.make_stepper', make)
        return made

    return use


def test_steps_need_not_divide_a_duration():
    for rate, steps in ((30, 450), (62.5, 937), (4000, 60000), (1 / 0.07, 214)):
        scene = replace(A, dt=1 / rate)
        assert step_count(scene) == steps
        found = list(portions(scene))
        assert found[0][0] == 0 and found[-1][1] == steps
        assert all(one[1] == other[0] for one, other in pairwise(found))
        every = found[0][1] * scene.dt
        assert abs(every - 0.1) <= scene.dt / 2 + 1e-12


def test_time_is_that_of_the_shortest_call_of_all_steps(sliding):
    made = sliding()
    course = compiled_course(replace(A, dt=0.03, duration=0.3))
    (stepper,) = made
    # Four portions for the path, then two calls of all ten steps, of which the first is shorter.
    assert stepper.calls == [3, 3, 3, 1, 10, 10]
    assert course.seconds == pytest.approx(1e-9 * (10_000 + 7 * 5))
    assert course.time == pytest.approx([0.0, 0.09, 0.18, 0.27, 0.3])
    assert course.path[:, 0] - course.path[0, 0] == pytest.approx(course.time)
    assert (course.unconverged, course.failure) == (4, '')


def test_a_long_call_is_timed_once(sliding):
    made = sliding()
    course = compiled_course(replace(A, dt=1e-4, duration=10.1))
    (stepper,) = made
    assert stepper.calls[-2:] == [1000, 101_000]
    assert 0.1 < course.seconds < 0.102


def test_a_course_that_fails_ends_there(sliding):
    sliding(failing=0.25 + initial_state(A).q[5, 0])
    course = compiled_course(replace(A, dt=0.1, duration=0.5))
    assert course.failure == 'too far' and math.isnan(course.seconds)
    assert course.time == pytest.approx([0.0, 0.1, 0.2])
    assert course_error(course, LINE) == math.inf


@pytest.mark.parametrize('method', ['newton', 'bdf2'])
def test_a_run_in_one_call_is_the_run_in_portions(method):
    # The path that is judged is that of the run that is timed, to the bit.
    scene = with_settings(C, {'method': method, 'level': 'spatial', 'dt': 0.01, 'duration': 0.5})
    start = Start(initial_state(scene), 6.0)
    course, stepper = compiled_course(scene, start), make_stepper(scene)
    reference = gait.reference(scene.gait, 6.0 + 0.01 * (np.arange(50) + 0.5), 10)
    end, _, _ = stepper.advance(start.state, stepper.empty_history(), *reference)
    assert np.array_equal(end.q[5, :3], course.path[-1])
    assert course.seconds > 0.0


# ---- converged paths ----------------------------------------------------------------------------

TIMES = POINT_PERIOD * np.arange(201)
LINE = converged_path(np.outer(TIMES, [1.0, 0.0, 0.0]), np.outer(TIMES, [1.001, 0.0, 0.0]))


def course_along(path, times):
    return Course(np.asarray(times), np.asarray(path, dtype=float), 1.0, 0, '')


def test_errors_are_relative_to_the_way_at_any_times():
    assert (LINE.way, LINE.doubt) == pytest.approx((1.0, 0.001))
    times = [0.0, 0.333, 0.777, 0.999]
    aside = [0.0, 0.03, 0.04, 0.0]
    path = np.column_stack([times, aside, np.zeros(4)])
    assert course_error(course_along(path, times), LINE) == pytest.approx(0.04)


def test_a_converged_path_is_extrapolated_and_computed_once(monkeypatch):
    # Of first order: a speed of 1 + dt leads to 1 at a step of zero.
    made = []

    def path(scene):
        made.append((scene.method, scene.level, scene.dt))
        return np.outer(TIMES, [1.0 + scene.dt, 0.0, 0.0])

    monkeypatch.setattr(f'{PATHS}._path', path)
    paths = ConvergedPaths((0.02, 0.01))
    for method, dt in (('bdf2', 0.05), ('newton', 0.01)):
        found = paths.path(replace(A, method=method, dt=dt))
        assert found.way == pytest.approx(1.0)
        assert found.doubt == pytest.approx(0.01)
    assert made == [('newton', 'spatial', 0.02), ('newton', 'spatial', 0.01)]


# ---- trials side by side ------------------------------------------------------------------------


def trial(error, doubt=0.0, **changes):
    return Trial(
        replace(A, duration=1.0), lambda course: error * course.path[0, 0], doubt, **changes
    )


def entrant(name, order, weight=1.0, seconds=0.01, failure='', refusal=''):
    """Return an entrant with a row, whose errors are those of a trial times a weight."""

    def run(scene, start=None):
        order.append((name, scene.dt))
        if refusal:
            raise ParameterError(refusal)
        return Course(np.zeros(1), np.full((1, 3), weight), seconds, 2, failure)

    row = Row(part='ensemble', case='A', method=name, dt=0.05)
    return Entrant(name, 'x', (20.0,), run), row


def test_entrants_take_turns_in_every_trial():
    order = []
    entered = [entrant(name, order) for name in ('newton', 'mujoco', 'bdf2')]
    spread_rows(entered, [trial(0.1), trial(0.2)])
    assert [name for name, _ in order] == ['newton', 'mujoco', 'bdf2'] * 2


def test_rows_have_spread_cost_and_doubt_of_all_trials():
    order = []
    seconds = iter([0.05, 0.01, 0.02])
    entered = [entrant('newton', order, weight=2.0)]
    slow, row = entered[0]
    run = slow.run
    slow = replace(slow, run=lambda *given: run(*given)._replace(seconds=next(seconds)))
    (found,) = spread_rows([(slow, row)], [trial(e, doubt=e / 10) for e in (0.01, 0.02, 0.02)])
    assert found.error_rms == pytest.approx(math.sqrt((4 + 16 + 16) / 3) / 100)
    assert (found.error_median, found.error_quantile) == pytest.approx((0.04, 0.04))
    assert found.reference_error == pytest.approx(math.sqrt((1 + 4 + 4) / 3) / 1000)
    assert found.seconds_per_second == pytest.approx(0.01 + 0.2 * 0.01)  # 10 % of trials below
    assert (found.trials, found.unconverged, found.status) == (3, 6, 'max_iterations')


def test_the_worst_of_neighbors_counts_with_steps_of_their_own():
    order = []
    trials = [trial(0.01), trial(0.03, step_factor=0.8), trial(0.02, step_factor=1.2)]
    (found,) = worst_rows([entrant('newton', order)], trials)
    assert found.error_path == 0.03
    assert [dt for _, dt in order] == pytest.approx([0.05, 0.04, 0.06])
    assert found.dt == 0.05


def test_a_failure_and_a_refusal_are_told_and_others_go_on():
    order = []
    entered = [
        entrant('mujoco', order, refusal='MuJoCo is not installed'),
        entrant('newton', order, weight=math.inf, failure='t = 1 s: diverged'),
        entrant('bdf2', order),
    ]
    absent, failed, good = spread_rows(entered, [trial(0.1), trial(0.1)])
    assert (absent.status, absent.message) == ('refused', 'MuJoCo is not installed')
    assert math.isnan(absent.error_rms) and absent.trials is None
    assert (failed.status, failed.message) == ('diverged', 't = 1 s: diverged')
    assert failed.error_rms == math.inf
    assert good.error_rms == pytest.approx(0.1)
    assert [name for name, _ in order].count('mujoco') == 1


# ---- entrants -----------------------------------------------------------------------------------


@pytest.mark.parametrize('case', CASES)
def test_ours_and_others_take_turns(case):
    for quick in (False, True):
        found = attempts(entrants(case, (), quick=quick), ())
        names = [(each.method, each.setting, rate) for each, rate in found]
        assert len(set(names)) == len(names)
        methods = [method for method, _, _ in names]
        assert methods[:3] == ['bdf2', 'mujoco', 'newton']
        assert set(methods) <= set(METHOD_STYLES)
    assert {each.method for each in entrants(case, ['newton'], quick=True)} == {'newton'}


def test_mujoco_enters_with_all_settings_of_its_search():
    settings = {
        case: {each.setting for each in entrants(case, ['mujoco'], quick=False)} for case in CASES
    }
    for case in ('lateral_undulation', 'sidewinding', 'sinus_lifting'):
        own = {name for name, found in SEARCHED.items() if found.case == case}
        assert settings[case] == own | {'default'}
    assert settings['lateral_undulation_isotropic'] == set(SEARCHED) | {'default'}
    rates = {each.setting: each.rates for each in entrants(CASES[2], ['mujoco'], quick=False)}
    assert rates['C 3 %'] == (150, 90, 60, 45, 30, 21, 15)
    assert rates['C 0.5 %'] == (2000, 1500, 1000, 700, 500)


def test_steps_that_are_asked_for_are_those_of_all():
    found = attempts(entrants(CASES[0], ['newton', 'bdf2'], quick=False), [50.0, 20.0])
    assert [(each.method, rate) for each, rate in found] == [
        ('bdf2', 50.0), ('newton', 50.0), ('bdf2', 20.0), ('newton', 20.0),
    ]  # fmt: skip


# ---- cycles -------------------------------------------------------------------------------------


def test_a_restart_goes_on_as_the_reference_does():
    # From a state alone, without the history of the steps before it. Sweeps begin with other
    # impulses then, so that a step differs by the residual, 1e-12 m/s, and what 1125 steps make
    # of that.
    scene = with_settings(
        A, {'method': 'newton', 'level': 'spatial', 'dt': 1 / 1000,
            'solver.residual_tolerance': cycles.RESIDUAL},
    )  # fmt: skip
    starts = cycles.steady_starts(scene, 4)
    assert [start.time for start in starts] == pytest.approx([4.5, 5.625, 6.75, 7.875])
    quarter = replace(scene, duration=cycles.period(scene) / 4)
    for start, later in pairwise(starts):
        assert np.abs(cycles.end_after(quarter, start) - later.state.q[5, :3]).max() < 1e-8


def test_a_gait_is_steady_after_its_soft_start():
    scene = with_settings(replace(C, dt=1 / 100, method='bdf2'), {'level': 'spatial'})
    (start,) = cycles.steady_starts(scene, 1)
    assert start.time == pytest.approx(9.0)


def test_errors_after_a_cycle_are_relative_to_the_way_of_the_cycle():
    scene = replace(A, duration=0.5)
    coarse, fine = (cycles.reference_run(scene, dt) for dt in (1 / 1000, 1 / 2000))
    start = Start(initial_state(A), 4.5)
    found = cycles.trial_from(scene, start, coarse, fine)
    ends = [cycles.end_after(each, start) for each in (coarse, fine)]
    end = 2 * ends[1] - ends[0]
    way = np.linalg.norm(end - start.state.q[5, :3])
    assert found.start is start
    assert found.doubt == pytest.approx(np.linalg.norm(ends[1] - ends[0]) / way)
    path = np.array([start.state.q[5, :3], end])
    assert found.error(course_along(path, [0.0, 0.5])) == 0.0
    path[1, 1] += 0.01 * way
    assert found.error(course_along(path, [0.0, 0.5])) == pytest.approx(0.01)
    assert found.error(course_along(path, [0.0, 0.5])._replace(failure='x')) == math.inf


def test_steps_of_a_cycle_divide_the_period():
    (entry,) = cycles.cycles(
        {CASES[2]: C}, lambda case: attempts(entrants(case, ['bdf2'], quick=True), [35.0, 10.0]),
        (1 / 8000, 1 / 16000), 4,
    )  # fmt: skip
    assert [row.dt for row in entry.keys] == pytest.approx([4.5 / 158, 0.1])
    assert {row.duration for row in entry.keys} == {cycles.period(C)}
    assert cycles.period(C) == pytest.approx(4.5)


# ---- fronts and tables --------------------------------------------------------------------------


def test_a_front_is_what_nobody_beats_in_both():
    points = [(1.0, 0.3), (2.0, 0.1), (3.0, 0.2), (4.0, 0.05), (0.5, math.inf), (math.nan, 0.01)]
    assert front(points) == [(1.0, 0.3), (2.0, 0.1), (4.0, 0.05)]


def test_costs_on_a_front_follow_power_laws_between_points():
    points = [(1.0, 0.1), (100.0, 0.001)]  # cost = 0.1/error
    assert cost_at(points, 0.01) == pytest.approx(10.0)
    assert cost_at(points, 0.001) == pytest.approx(100.0)
    assert cost_at(points, 0.5) == pytest.approx(1.0)
    assert math.isnan(cost_at(points, 0.0009)) and math.isnan(cost_at([], 0.1))


JUDGED = Row(part='ensemble', case='sidewinding', method='bdf2', level='spatial',
             setting='residual 1e-5 m/s', dt=0.02, trials=4, status='converged',
             reference_error=1e-4)  # fmt: skip


def judged(cost, rms, **values):
    spreads = {'error_rms': rms, 'rms_low': 0.8 * rms, 'rms_high': 1.2 * rms,
               'error_median': 0.9 * rms, 'error_quantile': 1.6 * rms}  # fmt: skip
    return replace(JUDGED, seconds_per_second=cost, **{**spreads, **values})


ROWS = [
    judged(1 / 4000, 0.022, dt=0.05),
    judged(1 / 2000, 0.011),
    judged(1 / 1000, 0.012, method='newton', setting='default'),  # slower and worse
    judged(1 / 2000, 0.05, method='mujoco', setting='C 5 %', dt=1 / 30),
    judged(1 / 100, 0.01, method='mujoco', setting='C 0.5 %', dt=1e-3),
    replace(JUDGED, method='mujoco', setting='C 1 %', status='refused', message='absent'),
]


def test_table_of_an_ensemble_has_the_fronts_of_both_sides():
    _, _, *lines = spread_table(ROWS, 'ensemble').splitlines()
    assert lines == [
        '| `sidewinding` | `bdf2`, residual 1e-5 m/s, 1/20 s | 2.2 % | 1.8 % to 2.6 % | 2 % '
        '| 3.5 % | 4 | 4000 |',
        '| `sidewinding` | `bdf2`, residual 1e-5 m/s, 1/50 s | 1.1 % | 0.88 % to 1.3 % | 0.99 % '
        '| 1.8 % | 4 | 2000 |',
        '| `sidewinding` | `mujoco`, C 5 %, 1/30 s | 5 % | 4 % to 6 % | 4.5 % | 8 % | 4 | 2000 |',
        '| `sidewinding` | `mujoco`, C 0.5 %, 1/1000 s | 1 % | 0.8 % to 1.2 % | 0.9 % | 1.6 % '
        '| 4 | 100 |',
    ]


def test_table_of_speeds_compares_them_at_one_error():
    _, _, first, second, third, *rest = speeds_table(ROWS).splitlines()
    # MuJoCo: from 2000 at 5 % to 100 at 1 %, a power of ln 20/ln 5 of the error.
    power = math.log(20) / math.log(5)
    theirs = 100 * 2.2**power
    assert first == (
        f'| ensemble | `sidewinding` | 2.2 % | 4000 | {theirs:.0f} | {4000 / theirs:.1f} |'
    )
    assert second.startswith('| ensemble | `sidewinding` | 1.3 % | 2364 | ')
    assert third.startswith('| ensemble | `sidewinding` | 1.05 % | none | ')
    assert rest == []


def test_robust_table_names_the_fastest_within_a_bound():
    rows = [
        replace(row, part='robust', error_path=2 * row.error_rms, error_rms=math.nan)
        for row in ROWS
    ]
    _, _, five, two, *_ = robust_table(rows).splitlines()
    assert five == (
        '| `sidewinding` | 5 % | `bdf2`, residual 1e-5 m/s, 1/20 s | 4000 | 4.4 % '
        '| `mujoco`, C 0.5 %, 1/1000 s | 100 | 2 % |'
    )
    assert two.endswith('| none |  |  | `mujoco`, C 0.5 %, 1/1000 s | 100 | 2 % |')


def test_chart_has_a_panel_for_each_case_and_thick_lines_of_fronts():
    rows = [*ROWS, *(replace(row, case='sinus_lifting') for row in ROWS)]
    figure = spreads_figure(rows)
    assert [axes.get_title() for axes in figure.axes] == ['C: sidewinding', 'D: sinus-lifting']
    (legend,) = figure.legends
    assert [text.get_text() for text in legend.get_texts()] == ['newton', 'bdf2', 'MuJoCo']
    thick = [line for line in figure.axes[0].lines if line.get_linewidth() > 1.0]
    assert [list(line.get_ydata()) for line in thick][-1] == [0.05, 0.01]


# ---- the bench ----------------------------------------------------------------------------------


def test_a_small_bench_is_measured_and_drawn(tmp_path):
    pytest.importorskip('mujoco')
    # Short runs of both, four scenes and phases: real rows, of which chart makes its tables.
    path = tmp_path / 'bench.csv'
    options = ['--quick', '--parts', 'ensemble', 'cycle', 'robust', '--methods', 'bdf2', 'mujoco']
    short = ['--duration', '0.6', '--dt', '0.02', '--set', 'gait.yaw.angular_frequency=12.0']
    assert main(['bench', CASES[0], *options, *short, '--out', str(path)]) == 0
    rows = bench_rows.rows_of(read_table(path))
    found = {(row.part, row.method) for row in rows}
    assert found == {(p, m) for p in ('ensemble', 'cycle', 'robust') for m in ('bdf2', 'mujoco')}
    for row in rows:
        assert row.status == 'converged' and row.seconds_per_second > 0.0
        assert row.trials == (7 if row.part == 'robust' else 4)
        error = row.error_path if row.part == 'robust' else row.error_rms
        assert row.reference_error < error < 1.0
    assert main(['chart', str(path), '--out', str(tmp_path)]) == 0
    written = {file.name for file in tmp_path.iterdir()}
    names = {'ensemble', 'cycle', 'robust', 'speeds'}
    assert {f'{name}.md' for name in names} < written
    assert {
        f'{name}.{kind}' for name in ('ensemble', 'cycle') for kind in ('svg', 'png')
    } < written
    # It goes on where it was: nothing is left to do.
    size = path.stat().st_size
    assert main(['bench', CASES[0], *options, *short, '--out', str(path)]) == 0
    assert path.stat().st_size == size


def test_neighbors_have_steps_that_a_scene_may_have():
    field = attempts(entrants(CASES[2], ['bdf2'], quick=False), ())
    (entry,) = ensembles.robust({CASES[2]: C}, lambda case: field, ConvergedPaths((1, 1)))
    assert min(rate for _, rate in field) == 10
    assert max(row.dt for row in entry.keys) == 1 / 20


def test_an_entry_of_an_ensemble_is_known_by_all_of_its_rows():
    field = attempts(entrants(CASES[2], ['bdf2'], quick=True), ())
    (entry,) = ensembles.ensemble({CASES[2]: C}, lambda case: field, ConvergedPaths((1, 1)), 4)
    keys = {bench_rows.key(asdict(row)) for row in entry.keys}
    assert len(keys) == len(field) and entry.is_in(keys)
    assert not entry.is_in(keys - {bench_rows.key(asdict(entry.keys[0]))})
