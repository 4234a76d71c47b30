# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The bench: its arithmetic on known inputs, its file, and that a run that fails is a row."""

from dataclasses import asdict, replace
import math
from pathlib import Path
import re

import numpy as np
from processes import python
import pytest

from snake_sim_benchmarks.__main__ import main
from snake_sim_benchmarks.commands import PARTS
from snake_sim_benchmarks.comparison import bench, bench_rows, csv_tables as tables, soak, timing
from snake_sim_benchmarks.comparison.bench_rows import COLUMNS, Entry, Row
from snake_sim_benchmarks.comparison.bench_tables import (
    agreement_table,
    fastest,
    fitted_order,
    fitted_power,
    soak_table,
)
from snake_sim_benchmarks.comparison.charts import cost_over_links
from snake_sim_benchmarks.comparison.contenders import all_contenders, Contender
from snake_sim_benchmarks.comparison.csv_tables import plain, read_table, Table, TableWriter
from snake_sim_benchmarks.comparison.paths import (
    extrapolated,
    largest_difference,
    motion,
    path_error,
    SAMPLING_PERIOD,
)
from snake_sim_benchmarks.comparison.timing import trajectory_of_states
from snake_sim_ros import ParameterError, Report, Robot, Simulation, State
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.scene.rotations import about, product
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.state import empty_history

ROOT = Path(__file__).resolve().parents[2]
SCENE = replace(load_scene('lateral_undulation'), duration=0.3)


def along(path):
    """Return the trajectory of a robot of one link along a path."""
    path = np.asarray(path, dtype=float)
    states = [State(np.array([[*r, 1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 6))) for r in path]
    scene = replace(SCENE, robot=Robot(link_count=1))
    return trajectory_of_states(scene, states, SAMPLING_PERIOD, Report(), 1.0)


def moved_by(run, factor):
    """Return a timed run whose way from the start is longer by a factor."""
    start = run.trajectory.position[:1]
    position = start + factor * (run.trajectory.position - start)
    return replace(run, trajectory=replace(run.trajectory, position=position))


STRAIGHT = along([(0, 0, 0), (1, 0, 0), (2, 0, 0)])


class Sliding:
    """A stepper that moves the robot along x at 1 m/s + error, at 2000 ticks a step."""

    level = 'spatial'

    def __init__(self, scene, failing=math.inf):
        self.dt, self.failing = scene.dt, failing
        self.cycles = np.zeros(1, np.int64)
        self.scene = scene

    def empty_history(self):
        return empty_history(self.scene)

    def advance(self, state, history, angle, rate, samples=None, pushes=None):
        steps = len(angle)
        self.cycles = 2000 * np.arange(steps + 1)
        q = state.q.copy()
        q[:, 0] += steps * self.dt * (1.0 + self.dt)
        report = Report(steps=steps, iterations=2 * steps, joint_torque=np.zeros((10, 2)))
        if q[0, 0] > self.failing:
            report.failure = 'too far'
        for k in range(steps if samples else 0):
            at = state.q + (k + 1) / steps * (q - state.q)
            samples.add(k, State(at, state.u), history, report.joint_torque, self.dt)
        return State(q, state.u), history, report

    def in_place(self, count, state, history, pushes, every=0):
        return None


def test_path_error_is_relative_to_the_way_gone():
    bent = along([(0, 0, 0), (1, 0.3, 0.4), (2, 0, 0.1)])
    assert path_error(bent.path, STRAIGHT.path) == pytest.approx(0.5 / 2)


def test_a_run_that_ended_early_is_infinitely_far_off():
    assert path_error(STRAIGHT.path[:2], STRAIGHT.path) == math.inf
    assert largest_difference(motion(STRAIGHT).heading[:2], motion(STRAIGHT).heading) == math.inf


def test_extrapolation_takes_off_an_error_of_first_order():
    coarse, fine = (along([(0, 0, 0), (1 + h, 0, 3 * h)]) for h in (0.2, 0.1))
    assert extrapolated(coarse, fine).path == pytest.approx(np.array([(0, 0, 0), (1, 0, 0)]))


def test_heading_does_not_jump():
    # A link whose axis e_z is at an angle in the plane: first about y by 90 deg, then about z.
    angles = np.linspace(3.0, 3.3, 4)
    turns = np.array([product(about(2, angle), about(1, np.pi / 2)) for angle in angles])
    turning = replace(along(np.zeros((4, 3))), orientation=turns[:, None])
    assert np.diff(motion(turning).heading) == pytest.approx(0.1)
    assert motion(turning).heading[0] == pytest.approx(3.0)


def test_times_are_those_of_the_clocks(monkeypatch):
    # Every reading of the wall clock is 1 ms after the one before, and every reading of the
    # counter 500 ticks, so that a tick is 1e-3 s/500 = 2 us: a step of 2000 ticks is 4 ms.
    seconds, ticks = iter(np.arange(1000) * 1e-3), iter(range(0, 500_000, 500))
    monkeypatch.setattr(timing.time, 'perf_counter', lambda: next(seconds))
    monkeypatch.setattr(timing, 'cycle_counter', lambda: next(ticks))
    run = timing.timed(SCENE, Sliding)
    trajectory = run.trajectory
    # From start to end one reading of the counter for 5 of the clock: 2 in each of 2 calls.
    assert run.timing.median == run.timing.p99 == pytest.approx(2000 * 5 * 2.0)
    assert trajectory.seconds == pytest.approx(2e-3)
    assert len(trajectory.position) == 4
    assert trajectory.report.steps == 1200


def test_a_run_that_takes_too_long_is_stopped_and_says_so(monkeypatch):
    seconds = iter(np.arange(1000.0))
    monkeypatch.setattr(timing.time, 'perf_counter', lambda: next(seconds))
    run = timing.timed(SCENE, Sliding, limit=1.5)
    assert run.status == 'too_slow'
    assert len(run.trajectory.position) == 2


def entry(run, **values):
    values = {'part': 'precision', 'case': 'A', 'method': 'newton', 'dt': 0.01, **values}
    return Entry((Row(**values),), run, 1.0)


def contender(make=Sliding, **values):
    def run(scene, limit):
        return timing.timed(scene, make, limit=limit)

    return Contender(
        **{'method': 'newton', 'setting': 'default', 'rates': (1000,), 'run': run, **values}
    )


@pytest.fixture
def references(monkeypatch):
    def straight(scene):
        found = motion(timing.timed(scene, Sliding).trajectory)
        way = np.outer(SAMPLING_PERIOD * np.arange(4), [1.0, 0.0, 0.0])
        return found._replace(path=found.path[:1] + way), 1e-6

    monkeypatch.setattr(bench, 'converged', straight)
    return bench.References({'A': SCENE})


def test_a_known_error_is_in_the_row(references):
    # The speed is 1 + dt instead of 1: at the end 0.3 dt of 0.3 m.
    (only,) = bench.precision(references, [contender()], 10.0)
    (row,) = bench_rows.outcome(only)
    assert row.error_path == pytest.approx(1e-3)
    assert row.error_limit == row.error_path
    assert math.isnan(row.model_error)
    assert row.reference_error == 1e-6
    assert row.error_angle == row.error_heading == 0.0
    assert (row.status, row.steps, row.iterations) == ('converged', 300, 600)


def test_model_error_and_step_error_are_told_apart(references):
    # The contender's own small steps lead to a speed of 1, then its model is made 2 % faster.
    def fast(scene, limit):
        return moved_by(timing.timed(scene, Sliding, limit=limit), 1.02)

    other = contender(run=fast)
    other = replace(other, own_limit=('fast', replace(other, rates=(2000, 4000))))
    (only,) = bench.precision(references, [other], 10.0)
    (row,) = bench_rows.outcome(only)
    assert row.model_error == pytest.approx(0.02)
    assert row.error_limit == pytest.approx(1e-3)
    assert row.error_path == pytest.approx(1.02 * 1.001 - 1)


def test_a_run_that_diverges_is_a_row_without_errors(references):
    diverging = contender(make=lambda scene: Sliding(scene, failing=-10.0))
    (only,) = bench.precision(references, [diverging], 10.0)
    (row,) = bench_rows.outcome(only)
    assert row.status == 'diverged' and row.error_path == math.inf
    assert 'too far' in row.message


@pytest.mark.parametrize(
    ('error', 'status'), [(ParameterError('no'), 'refused'), (ZeroDivisionError('x'), 'error')]
)
def test_a_run_that_raises_is_a_row(error, status):
    def fail():
        raise error

    (row,) = bench_rows.outcome(entry(fail))
    assert row.status == status
    assert type(error).__name__ in row.message


def test_an_end_from_the_keyboard_is_not_swallowed():
    def stop():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bench_rows.outcome(entry(stop))


def test_rows_are_read_as_they_were_written(tmp_path):
    row = Row(part='links', case='a, "b"', method='newton', dt=1 / 3, n=3, residual_max=1e-300)
    writer = TableWriter(tmp_path / 'x.csv', 'bench', COLUMNS)
    writer.append([plain(replace(row, error_path=math.inf, energy_error=math.nan))])
    assert bench_rows.rows_of(read_table(tmp_path / 'x.csv')) == [row]


def test_header_says_where_the_numbers_are_from(tmp_path):
    TableWriter(tmp_path / 'x.csv', 'bench', COLUMNS)
    header = read_table(tmp_path / 'x.csv').header
    assert {'table', 'commit', 'processor', 'python', 'numpy', 'scipy', 'numba', 'date'} <= set(
        header
    )


def write(path, rows):
    TableWriter(path, 'bench', COLUMNS).append(plain(row) for row in rows)


def test_rows_that_are_there_are_not_run_again(tmp_path):
    path = tmp_path / 'x.csv'
    entries = [entry(list, dt=dt) for dt in (0.1, 0.2, 0.3)]
    write(path, [entries[0].keys[0], replace(entries[2].keys[0], status='diverged')])
    done = set(map(bench_rows.key, TableWriter(path, 'bench', COLUMNS).rows))
    assert [item.is_in(done) for item in entries] == [True, False, True]


def test_a_method_that_chooses_its_steps_is_known_by_its_tolerance(tmp_path):
    chosen = entry(list, dt=math.nan, tolerance=1e-3)
    write(tmp_path / 'x.csv', [replace(chosen.keys[0], dt=0.0123)])
    done = set(map(bench_rows.key, TableWriter(tmp_path / 'x.csv', 'bench', COLUMNS).rows))
    assert chosen.is_in(done)
    assert not entry(list, dt=math.nan, tolerance=1e-4).is_in(done)


def test_a_row_cut_short_is_run_again(tmp_path):
    path = tmp_path / 'x.csv'
    entries = [entry(list, dt=dt) for dt in (0.1, 0.2)]
    write(path, [item.keys[0] for item in entries])
    path.write_bytes(path.read_bytes()[:-1])
    writer = TableWriter(path, 'bench', COLUMNS)
    done = set(map(bench_rows.key, writer.rows))
    assert [item.is_in(done) for item in entries] == [True, False]
    writer.append([plain(entries[1].keys[0])])
    assert len(read_table(path).rows) == 2


def test_rows_of_other_settings_are_refused(tmp_path):
    path = tmp_path / 'x.csv'
    TableWriter(path, 'bench', COLUMNS, ['friction.longitudinal=0.4'])
    TableWriter(path, 'bench', COLUMNS, ['friction.longitudinal=0.4'])
    with pytest.raises(ParameterError, match=r"settings 'friction.*=0.4', these would be of ''"):
        TableWriter(path, 'bench', COLUMNS)


@pytest.mark.parametrize(
    'content',
    [b'# notes\nno newline at the end', b'a line', b'\xff\xfe', b'# table: stability\nx'],
)
def test_a_file_of_something_else_is_left_as_it_is(tmp_path, content):
    path = tmp_path / 'notes.txt'
    path.write_bytes(content)
    with pytest.raises(ParameterError):
        TableWriter(path, 'bench', COLUMNS)
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        (None, 'not readable as CSV'),
        ('# table: bench\n', 'names of columns must follow'),
        ('', 'an empty file'),
        ('time,x\n1,2\n', 'the first line must say what it is'),
    ],
)
def test_a_file_that_is_no_table_is_named(tmp_path, text, message):
    path = tmp_path / 'x.csv'
    if text is not None:
        path.write_text(text)
    with pytest.raises(ParameterError, match=message):
        read_table(path)


@pytest.mark.parametrize(
    ('table', 'message'),
    [
        (Table({'table': 'stability'}, []), "table must be 'bench', got 'stability'"),
        (Table({'table': 'bench'}, [{'part': 'x'}]), 'columns must be those of bench'),
        (
            Table({'table': 'bench'}, [{**dict.fromkeys(COLUMNS, ''), 'n': 'many'}]),
            "n must be a number, got 'many'",
        ),
    ],
)
def test_a_table_that_is_not_of_a_bench_is_refused(table, message):
    with pytest.raises(ParameterError, match=message):
        bench_rows.rows_of(table)


def test_every_compiled_method_takes_part_at_all_its_levels():
    entered = {(each.method, each.level) for each in all_contenders()}
    for method in set(METHODS) - {'reference', 'auto'}:
        levels = ['spatial', 'planar'] if METHODS[method].planar else ['spatial']
        assert {(method, level) for level in levels} <= entered
    baselines = {'semi_implicit_euler', 'rk45', 'lsoda', 'radau', 'bdf', 'pyramid', 'mujoco'}
    assert baselines <= {method for method, _ in entered}


def test_contenders_have_names_of_their_own():
    names = [(r.method, r.level, r.setting) for r in all_contenders()]
    assert len(names) == len(set(names))


def test_what_moves_up_is_not_run_in_the_plane():
    scenes = {name: load_scene(name) for name in ('lateral_undulation', 'sidewinding')}
    rows = [
        item.keys[0] for item in bench.precision(bench.References(scenes), all_contenders(), 1.0)
    ]
    levels = {(row.case, row.level) for row in rows}
    assert levels == {
        ('lateral_undulation', 'planar'),
        ('lateral_undulation', 'spatial'),
        ('sidewinding', 'spatial'),
    }


PRECISION = Row(part='precision', case='A', method='newton', level='spatial', setting='default')
ROWS = [  # of a method of second order, and a faster one with an error of its model
    *(
        replace(
            PRECISION, dt=dt, error_path=dt**2, error_limit=dt**2, seconds_per_second=1e-3 / dt
        )
        for dt in (0.01, 0.08, 0.2)
    ),
    replace(
        PRECISION, method='mujoco', setting='fast', dt=0.1, error_path=0.02, error_limit=0.02,
        seconds_per_second=0.004,
    ),
    replace(PRECISION, method='mujoco', setting='fast', dt=0.2, status='diverged'),
]  # fmt: skip


def test_fastest_run_that_is_good_enough():
    assert fastest(ROWS, 0.05) == ROWS[3]
    assert fastest(ROWS, 0.01) == ROWS[1]
    assert fastest(ROWS, 1e-5) is None


def test_fitted_order_is_that_of_a_power_law():
    assert fitted_order(ROWS[:3]) == pytest.approx(2.0)
    assert math.isnan(fitted_order(ROWS[:2]))


def test_errors_that_are_those_of_the_reference_are_not_fitted():
    rows = [replace(row, reference_error=1e-3) for row in ROWS[:3]]
    assert math.isnan(fitted_order(rows))


def test_exponent_of_the_cost_over_links_is_that_of_a_power_law():
    # Drawn are methods of known cost: 0.4 us n^1 at the spatial level, 0.01 us n^2 in the plane.
    assert fitted_power((5, 10, 40), (3.0, 12.0, 192.0)) == pytest.approx(2.0)
    cost = {'spatial': lambda n: 0.4 * n, 'planar': lambda n: 0.01 * n**2}
    rows = [
        Row(part='links', case='A', method='newton', level=level, n=n, median_us=cost[level](n))
        for level in cost
        for n in bench.LINK_COUNTS
    ]
    (legend,) = cost_over_links(rows).legends
    assert [text.get_text() for text in legend.get_texts()] == [
        'newton, n^1.00', 'newton, planar, n^2.00',
    ]  # fmt: skip


def test_links_are_measured_from_few_to_as_many_as_a_robot_may_have():
    # An exponent says something over more than a decade.
    rows = [item.keys[0] for item in bench.links(SCENE, [contender()], bench.LINK_COUNTS, 1.0)]
    assert [row.n for row in rows] == list(bench.LINK_COUNTS)
    assert max(bench.LINK_COUNTS) == 200 >= 10 * min(bench.LINK_COUNTS)


def test_mujoco_is_measured_over_links_with_its_own_contacts_too():
    parts = bench.matrix({}, all_contenders(), lambda case: [], 1.0, quick=True)
    rows = [item.keys[0] for item in parts['links']]
    settings = {row.setting for row in rows if row.method == 'mujoco'}
    assert settings == {'accurate, spring, discrete', 'default, spring, discrete'}
    assert len({(row.method, row.level, row.setting, row.n) for row in rows}) == len(rows)


def test_agreement_is_that_of_paths(monkeypatch):
    # A speed of 1 + dt for newton, 1 % more for the others: 1 % of the way.
    def run(scene):
        faster = 1.0 if scene.method == 'newton' else 1.01
        found = moved_by(timing.timed(scene, Sliding), faster)
        report = replace(found.trajectory.report, unconverged=3)
        return replace(found, trajectory=replace(found.trajectory, report=report))

    made = []

    def counted(scene):
        made.append((scene.method, scene.level, scene.solver.tolerance))
        return run(scene)

    monkeypatch.setattr(bench, 'timed', counted)
    entries = list(bench.agreement({'A': SCENE}, ['paper', 'newton', 'gauss_seidel', 'mujoco']))
    rows = [row for item in entries for row in bench_rows.outcome(item)]
    # newton runs once for both.
    assert made == [
        ('newton', 'spatial', 1e-7),
        ('gauss_seidel', 'spatial', 1e-7),
        ('paper', 'spatial', 1e-10),
    ]
    assert [(row.case, row.method, row.tolerance) for row in rows] == [
        ('A', 'gauss_seidel', 1e-9),
        ('A', 'paper', 1e-10),
    ]
    for row, item in zip(rows, entries, strict=True):
        assert row.path_difference == pytest.approx(0.01)
        assert (row.unconverged, row.status) == (3, 'max_iterations')
        assert item.is_in({bench_rows.key(asdict(row))})
    _, _, line, _ = agreement_table(rows).splitlines()
    assert line == (
        '| `A` | `gauss_seidel` | `solver.residual_tolerance` 1e-09 m/s | 1.0e-02 | 1200 | 3 |'
    )


def test_soak_looks_at_penetration_and_memory(monkeypatch):
    monkeypatch.setattr(
        bench, 'SOAKED_SCENES', {'lateral_undulation': soak.SOAKED_SCENES['lateral_undulation']}
    )
    (only,) = bench.soaks((4, 30))
    rows = bench_rows.outcome(only)
    assert [(row.steps, row.duration) for row in rows] == [(4, 0.001), (30, 0.0075)]
    for row in rows:
        assert row.status == 'converged' and row.unconverged == 0
        assert 0.0 <= row.penetration_end <= row.penetration_max
        assert row.seconds > 0.0
        assert 1e7 < row.memory_begin and 1e7 < row.memory_end
    assert only.is_in({bench_rows.key(asdict(row)) for row in rows})
    assert len(soak_table(rows).splitlines()) == 4


def test_soak_among_pegs_begins_anew_after_every_duration(monkeypatch):
    # Of 1200 steps in calls of 500: 1200, 1200 and 600 steps make 3000.
    class Counting(Sliding):
        calls = []  # noqa: RUF012

        def advance(self, state, history, angle, rate, samples=None, pushes=None):
            self.calls.append((len(angle), state.q[0, 0] == start))
            return super().advance(state, history, angle, rate, samples)

    start = Simulation(SCENE, Sliding(SCENE)).state.q[0, 0]
    monkeypatch.setattr(soak, 'LAST_PERIOD', 500 * SCENE.dt)
    monkeypatch.setattr(soak, 'Simulation', lambda scene: Simulation(scene, Counting(scene)))
    for restarts, steps in (
        (True, [500, 500, 200, 500, 500, 200, 500, 100]),
        (False, [500] * 6),
    ):
        Counting.calls.clear()
        (look,) = soak.soak(SCENE, (3000,), restarts=restarts)
        assert look.report.steps == 3000
        calls = Counting.calls[1:]  # without the one that compiles
        assert [count for count, _ in calls] == steps
        begins = [k for k, (_, anew) in enumerate(calls) if anew]
        assert begins == ([0, 3, 6] if restarts else [0])


def test_soak_ends_where_the_run_diverges(monkeypatch):
    # Every other mark says so, too; nobody waits for steps that are not taken.
    monkeypatch.setattr(
        soak, 'Simulation', lambda scene: Simulation(scene, Sliding(scene, failing=-10.0))
    )
    looks = list(soak.soak(SCENE, (10, 10**7), restarts=False))
    assert [look.report.status.value for look in looks] == ['diverged', 'diverged']


def test_memory_is_unknown_where_the_system_does_not_tell(monkeypatch):
    assert soak.resident_memory() > 1e7

    def missing(*arguments, **options):
        raise FileNotFoundError

    monkeypatch.setattr(soak.Path, 'read_text', missing)
    assert soak.resident_memory() is None
    assert '| unknown to unknown |' in soak_table([Row(part='soak', case='A', method='newton')])


def test_soak_scenes_are_those_of_the_documentation():
    assert max(soak.MARKS) == 10**7
    scenes = {name: soak.soaked_scene(name) for name in soak.SOAKED_SCENES}
    assert scenes['lateral_undulation'].level == 'spatial'
    assert scenes['sidewinding'].gait.pitch.amplitude > 0
    assert scenes['obstacle_aided'].pegs.x


SMALL_BENCH = [
    *('bench', 'lateral_undulation', '--methods', 'newton', '--dt', '0.00025', '0.001'),
    *('--duration', '0.3'),
]


@pytest.fixture(scope='module')
def measured(tmp_path_factory):
    """Return the file of a small bench of real runs."""
    path = tmp_path_factory.mktemp('bench') / 'bench.csv'
    assert main([*SMALL_BENCH, '--out', str(path)]) == 0
    return path


def test_bench_writes_a_row_for_every_run(measured):
    rows = bench_rows.rows_of(read_table(measured))
    found = {(row.level, row.dt) for row in rows if row.setting == 'default'}
    assert found == {(level, dt) for level in ('spatial', 'planar') for dt in (0.00025, 0.001)}
    for row in rows:
        assert (row.case, row.method, row.n, row.duration) == (
            'lateral_undulation', 'newton', 11, 0.3,
        )  # fmt: skip
        assert row.status == 'converged'
        assert 0 < row.median_us <= row.p99_us
        assert row.calibration_us > 0
        assert row.error_path < 0.05
        assert row.energy_error < 1e-4


def test_bench_goes_on_where_it_was_ended(measured, tmp_path, capsys):
    path = tmp_path / 'bench.csv'
    lines = measured.read_text().splitlines(keepends=True)
    path.write_text(''.join(lines[:-1]))
    assert main([*SMALL_BENCH, '--out', str(path)]) == 0
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith('precision')]
    assert len(told) == 1
    keys = [
        [bench_rows.key(row) for row in read_table(file).rows] for file in (measured, path)
    ]  # fmt: skip
    assert keys[0] == keys[1]


def test_bench_goes_on_at_another_commit_if_asked_to(measured, tmp_path, capsys, monkeypatch):
    path = tmp_path / 'bench.csv'
    whole = measured.read_text().splitlines(keepends=True)
    path.write_text(''.join(whole[:-1]))
    monkeypatch.setattr(tables, '_commit', lambda: 'another')
    assert main([*SMALL_BENCH, '--out', str(path)]) == 2
    assert "these would be of 'another'" in capsys.readouterr().err
    assert path.read_text() == ''.join(whole[:-1])
    assert main([*SMALL_BENCH, '--other-sources', '--out', str(path)]) == 0
    table = read_table(path)
    assert table.header['commit'] == f'{read_table(measured).header["commit"]} and another'
    assert len(table.rows) == len(read_table(measured).rows)


def test_bench_refuses_what_it_does_not_know(tmp_path, capsys):
    out = ['--out', str(tmp_path / 'x.csv')]
    assert main(['bench', '--methods', 'newtn', *out]) == 2
    assert "no method 'newtn' in the matrix; it has: bdf, bdf2, " in capsys.readouterr().err
    assert main(['bench', '--methods', 'newton', '--out', str(tmp_path / 'no' / 'x.csv')]) == 2
    assert 'no folder' in capsys.readouterr().err


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (['--dt', '0'], 'dt must be above 0 s, got 0 s'),
        (['--dt', '-1'], 'dt must be above 0 s, got -1 s'),
        (['--dt', 'nan'], 'dt must be finite, got nan s'),
        (['--dt', '0.001', '0.003'], 'dt must divide the sampling period: got dt=0.003 s'),
        (['--duration', '0.25'], 'duration must be a multiple of 0.1 s, .* got 0.25 s'),
        (['--duration', '0.05'], 'duration must be a multiple of 0.1 s, .* got 0.05 s'),
        (['--limit', 'nan'], 'limit must be above 0 s, got nan s'),
        (['--limit', '0'], 'limit must be above 0 s, got 0 s'),
    ],
)
def test_bench_refuses_times_that_no_run_can_have(tmp_path, capsys, options, message):
    path = tmp_path / 'x.csv'
    assert main(['bench', '--quick', *options, '--out', str(path)]) == 2
    assert re.fullmatch(f'run: {message}.*\n', capsys.readouterr().err)
    assert not path.exists()


def test_stages_are_those_of_the_step(tmp_path):
    # Without the compiler: the stamped loops take the very steps of the methods.
    program = """
from functools import partial

import numpy as np
from snake_sim_benchmarks.comparison import timing as stages
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import load_scene
from snake_sim_ros.stepping.state import initial_state
from snake_sim_ros.stepping.methods import METHODS

scene = load_scene('lateral_undulation')
reference = gait.reference(scene.gait, scene.dt * (np.arange(2) + 0.5), 10)
method = METHODS['newton']
for make, stamped in (
    (method.spatial, stages.spatial_stages),
    (method.planar, stages.planar_stages),
):
    stamps = np.zeros((2, 5), np.int64)
    plain, other = make(scene), make(scene)
    other.loop = lambda *arguments: stamped(*arguments, stamps)
    ends = [
        stepper.advance(initial_state(scene), stepper.empty_history(), *reference)[0]
        for stepper in (plain, other)
    ]
    assert (ends[0].q == ends[1].q).all() and (ends[0].u == ends[1].u).all()
"""
    python('-c', program, folder=ROOT, NUMBA_DISABLE_JIT='1')


def test_parts_can_be_run_alone():
    assert set(PARTS) == set(bench.matrix({}, [], lambda case: [], 1.0, quick=True))


def test_every_row_says_what_it_was():
    assert set(bench_rows.KEY) <= set(COLUMNS)
    assert set(asdict(PRECISION)) == set(COLUMNS)
