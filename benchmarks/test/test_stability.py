# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Where methods fail, that it is noticed and reported, and that the default method does not.

Limits of theory are those that the maps draw. More of them are in other tests: joint control at
both sides of its limits with the gait, and without damping, in test_robot_physics.py; Painlevé's
rod in test_impacts.py; the gain of a free spin, exact to rounding, in test_physics.py; what a
diverged run leaves behind, and prox parameters far too large, in test_robot_physics.py.
"""

from dataclasses import replace
import math

import numpy as np
import pytest

from snake_sim_benchmarks.__main__ import main
from snake_sim_benchmarks.comparison.csv_tables import plain, read_table, Table
from snake_sim_benchmarks.comparison.paths import SAMPLING_PERIOD
from snake_sim_benchmarks.comparison.stability import maps as stability_maps, runs as stability
from snake_sim_benchmarks.comparison.stability.chart import draw_stability
from snake_sim_benchmarks.comparison.stability.maps import MAPS, run_case
from snake_sim_benchmarks.comparison.stability.problems import dropped_precisely, rod_limit
from snake_sim_benchmarks.comparison.stability.runs import (
    Axis,
    cells_of,
    outcome,
    OUTCOMES,
    simulate,
)
from snake_sim_ros import ParameterError, Report
from snake_sim_ros.stepping.base import Status

CHARTS = {chart.name: chart for chart in MAPS}


def cell(name, method, x, y):
    """Return a cell at any x and y; a time step is rounded so that it divides SAMPLING_PERIOD."""
    chart = CHARTS[name]
    if chart.x.name == 'dt':
        x = SAMPLING_PERIOD / round(SAMPLING_PERIOD / x)
    axes = {
        'x': replace(chart.x, values=(x,)),
        'y': replace(chart.y, values=(y,)),
    }
    (found,) = stability.cells(replace(chart, methods=(method,), **axes), (), run_case)
    assert found.outcome != 'failed', found.message
    return found


# ---- limits of theory ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('name', 'method', 'y', 'limit', 'worse'),
    [
        # dt < 2 K_d/K_p = 2 0.2/800
        ('stiffness_in_flight', 'newton start', 800.0, 5.0e-4, 'blown_up'),
        # 4 - 2 c dt - w^2 dt^2 > 0 with w = 1776 rad/s, c = w^2 K_d/K_p = 788.5/s
        ('stiffness_in_flight', 'newton midpoint', 800.0, 9.03e-4, 'blown_up'),
        # c dt < 2: more damping than a step can take, c = 12.8 times that
        ('damping_in_flight', 'newton start', 2.56, 1.98e-4, 'blown_up'),
        # the same formula as above
        ('damping_in_flight', 'newton midpoint', 2.56, 1.92e-4, 'blown_up'),
        # exp(W^2 dt t) = 1.1 after 1 s, W = 0.756 omega_z
        ('spin', 'newton', 10.0, 1.668e-3, 'inaccurate'),
        # r lambda_max < 2 of the dense Delassus operator of the scene
        ('prox_parameters', 'paper', 0.5, 5.226, 'unconverged'),
        ('prox_parameters', 'paper', 1.0, 6.818, 'unconverged'),
        # the formula of `newton midpoint`: w^2 = k g, c = 2 zeta sqrt(k m/2) g, g = 3.21 1/kg
        ('contact_stiffness', 'regularized', 1e5, 1.417e-3, 'inaccurate'),
        # c g dt < 2 with c = mu m g/2/eps = 167 N s/m, g = 26.4 1/kg
        ('sliding_velocity', 'regularized', 1e-2, 4.53e-4, 'inaccurate'),
    ],
)
def test_verdict_changes_at_the_limit(name, method, y, limit, worse):
    # 7 % to both sides of it: growth by e in less than 100 steps or sweeps, of hundreds; the gain
    # of the spin grows in proportion.
    below, above = cell(name, method, 0.93 * limit, y), cell(name, method, 1.07 * limit, y)
    assert below.limit == pytest.approx(limit, rel=2e-3)
    assert OUTCOMES.index(below.outcome) < OUTCOMES.index(worse) <= OUTCOMES.index(above.outcome)
    # Of what is possible; the spin's gain is 10 % in the 4 % of its energy that are across.
    assert below.energy < 1.005


def test_limits_are_no_limits_of_the_default_method():
    # Ten times the limit of `start`: no energy from nothing.
    assert cell('stiffness_in_flight', 'newton average', 5e-3, 800.0).energy < 1.005
    # r is the unit of its residual only.
    assert cell('prox_parameters', 'newton', 100.0, 0.5).outcome == 'converged'


def test_ground_masks_what_is_unstable_in_flight():
    # Twice the limit: all 22 contacts of case A hold the vertical modes.
    flight = cell('stiffness_in_flight', 'newton start', 1e-3, 800.0)
    ground = cell('stiffness_on_the_ground', 'newton start', 1e-3, 800.0)
    assert (flight.outcome, ground.outcome) == ('blown_up', 'converged')
    assert flight.limit == ground.limit == pytest.approx(5e-4)


def test_a_rod_jams_at_painleves_threshold():
    # (1 + 3 cos^2)/(3 sin cos) = 4/3 for tan theta = 2 and dt = 0. In a step of finite length it
    # jams earlier: friction may take all of v0 there. Both sides in closed form.
    assert rod_limit('newton', 0.0) == pytest.approx(4 / 3)
    limit = rod_limit('newton', 1e-3)
    for factor in (0.98, 1.02):
        found = cell('painleve', 'newton', factor * limit, 1e-3)
        assert found.outcome == 'converged', found
        # The rod turns at 1.2 rad/s in half a step beyond the middle, where its end has no slip:
        # 0.5 m times 1.2^2 dt/2. Slip that is left beside the threshold is 0.15 m/s.
        assert found.value < 0.5 * 1.2**2 * 1e-3 / 2


# ---- what fails without a formula ---------------------------------------------------------------


def test_sweeps_do_not_get_through_to_a_heavy_link():
    # kappa(G_NN) = 662, see test_robot_physics.py, with lambda_max = 3.2 1/kg and r_N = 0.1 kg: a
    # sweep takes r lambda_max/kappa = 1/2100 of the slowest error away, and 5000 are allowed.
    failed, solved = (cell('mass_ratio', method, 1000.0, 11) for method in ('paper', 'newton'))
    assert failed.outcome == 'unconverged'
    assert failed.unconverged > 0
    assert solved.outcome == 'converged'


@pytest.mark.parametrize('height', [1e-3, 1e-2, 0.1, 1.0])
def test_a_flat_fall_ends_on_the_floor(height):
    # v dt is 1 % of the radius at the limit; 1.5 g dt^2 more, see test_impacts.py, is below 5 %
    # of that for falls of a millimeter and more. Gaps up to 1 cm are closed: far beyond the limit,
    # too, falls end on the floor, or less than a step inside of it.
    limit = 0.01 * 0.0525 / math.sqrt(2 * 9.81 * height)
    safe = cell('drop_flat', 'newton', 0.9 * limit, height)
    assert safe.limit == pytest.approx(limit)
    assert safe.outcome == 'converged'
    assert safe.energy <= 1.0 + 1e-9
    for factor in (10.0, 11.0, 12.0):
        late = cell('drop_flat', 'newton', factor * limit, height)
        assert late.value < 1.1 * factor * 0.01 + 1.5 * 9.81 * late.x**2 / 0.0525


@pytest.mark.parametrize('tilt', [0.0, 1e-8, 1e-6, 1e-3, 0.1])
@pytest.mark.parametrize('dt', [2.5e-4, 1e-2])
def test_an_upright_link_is_simulated_and_judged(tilt, dt):
    # Its contact frame has no direction, and its fall begins with what tilt there is.
    found = cell('upright', 'newton', dt, tilt)
    assert found.outcome in ('converged', 'inaccurate')
    assert math.isfinite(found.value)
    assert found.energy <= 1.0 + 1e-9
    assert found.steps == round(0.4 / found.x)


@pytest.mark.parametrize('residual', [1e-30, 1e-9, 1e-6])
def test_a_solver_that_does_not_reach_its_tolerance_says_so(residual):
    # One end of three links hits the floor, the other is slammed down: no solver gets to 1e-30,
    # which is below the rounding of the velocities.
    report = simulate(dropped_precisely('newton', residual, 1e-2)).trajectory.report
    if report.unconverged:
        assert report.status is Status.MAX_ITERATIONS
        assert report.residual_max > residual
    else:
        assert report.residual_max <= residual
    assert residual > 1e-30 or report.unconverged
    assert residual < 1e-6 or not report.unconverged


# ---- the rule and the file ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ('report', 'energy', 'value', 'expected'),
    [
        (Report(steps=10), 1.0, 0.01, 'converged'),
        (Report(steps=10), 1.0, 0.02, 'inaccurate'),
        (Report(steps=10), 1.0, math.nan, 'inaccurate'),
        (Report(steps=10, unconverged=1), 1.0, 0.0, 'unconverged'),
        (Report(steps=10, unconverged=1), 2.1, 0.0, 'blown_up'),
        (Report(steps=10), math.nan, 0.0, 'blown_up'),
        (Report(steps=10, unconverged=1, failure='link 1 would'), 1.0, 0.0, 'blown_up'),
    ],
)
def test_outcome_is_the_worst_that_is_true(report, energy, value, expected):
    assert outcome(report, energy, value, 0.01) == expected


@pytest.fixture
def tiny(monkeypatch):
    """Let there be one map, of four cells of a link that spins."""
    chart = replace(
        CHARTS['spin'],
        x=Axis('dt', 's', (1e-3, 0.1)),
        y=Axis('omega_z', 'rad/s', (1.0, 100.0)),
        methods=('newton',),
    )
    monkeypatch.setattr(stability_maps, 'MAPS', (chart,))
    return chart


def run_stability(path):
    assert main(['stability', '--out', str(path)]) == 0
    return read_table(path)


def test_file_has_a_row_for_each_cell(tiny, tmp_path):
    table = run_stability(tmp_path / 'stability.csv')
    assert set(table.header) >= {'table', 'commit', 'processor', 'date', 'numpy'}
    rows = cells_of(table)
    assert [(row.y, row.x) for row in rows] == [(1, 1e-3), (1, 0.1), (100, 1e-3), (100, 0.1)]
    assert [row.outcome for row in rows[::3]] == ['converged', 'blown_up']
    assert 'link 1 would turn' in rows[3].message
    assert math.isnan(rows[3].value)
    for row, texts in zip(rows, table.rows, strict=True):
        assert row.limit == pytest.approx(tiny.limit('newton', row.y))
        again = {name: '' if v is None else str(v) for name, v in plain(row).items()}
        assert again == texts


def test_cells_in_the_file_are_not_run_again(tiny, tmp_path, monkeypatch):
    path = tmp_path / 'stability.csv'
    run_stability(path)
    text = path.read_text(encoding='utf-8')
    path.write_text(text[:-20], encoding='utf-8')  # killed in the last row
    run = []

    def counted(method, case):
        run.append(method)
        return run_case(method, case)

    monkeypatch.setattr(stability_maps, 'run_case', counted)
    assert len(cells_of(run_stability(path))) == 4
    assert len(run) == 1
    run_stability(path)
    assert len(run) == 1


def test_whatever_a_cell_raises_is_a_row(tiny):
    def refused(method, case):
        raise ParameterError('MuJoCo is not installed')

    found = list(stability.cells(tiny, (), refused))
    assert [row.outcome for row in found] == ['failed'] * 4
    assert found[0].message == 'ParameterError: MuJoCo is not installed'


def test_a_fine_run_that_raises_is_in_the_rows_that_need_it(tiny):
    def refused(method, case):
        assert case.scene.dt == 1e-4
        raise ParameterError('no fine run')

    chart = replace(tiny, fine_method='newton', fine_dt=1e-4)
    found = list(stability.cells(chart, (), refused))
    assert [row.message for row in found] == ['ParameterError: no fine run'] * 4


def test_unknown_map_is_refused(tmp_path, capsys):
    arguments = ['stability', '--maps', 'drops', '--out', str(tmp_path / 'stability.csv')]
    assert main(arguments) == 2
    assert "no map 'drops'; choose from: stiffness_in_flight" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_quick_maps_are_coarse_and_small():
    full, quick = (
        sum(len(list(stability.places(chart))) for chart in charts)
        for charts in (MAPS, map(stability.coarser, MAPS))
    )
    assert quick < full / 4


@pytest.mark.parametrize('chart', MAPS, ids=lambda chart: chart.name)
def test_time_steps_fit_into_the_sampling_period(chart):
    for axis in (chart.x, chart.y):
        assert list(axis.values) == sorted(axis.values)
        if axis is chart.x and axis.name == 'dt':
            counts = SAMPLING_PERIOD / np.array(axis.values)
            assert np.abs(counts - counts.round()).max() < 1e-9


def test_picture_shows_every_map_of_a_file(tmp_path):
    drawn = [CHARTS[name] for name in ('spin', 'contact_stiffness', 'friction')]
    rows = [
        plain(
            stability.Cell(
                **place, x_name='', y_name='', limit=math.nan, tolerance=0.1, measure='',
                outcome=(*OUTCOMES, 'failed')[k % 5],
            )
        )
        for chart in drawn
        for k, place in enumerate(stability.places(stability.coarser(chart)))
    ]  # fmt: skip
    texts = [{n: '' if v is None else str(v) for n, v in row.items()} for row in rows]
    files = draw_stability(Table({'table': 'stability'}, texts), tmp_path)
    assert [file.name for file in files] == ['stability.svg', 'stability.png']
    drawing = files[0].read_text(encoding='utf-8')
    assert all((chart.title in drawing) == (chart in drawn) for chart in MAPS)


@pytest.mark.parametrize(
    ('table', 'sentence'),
    [
        (Table({'table': 'bench'}, []), "table must be 'stability', got 'bench'"),
        (Table({'table': 'stability'}, [{'map': 'spin'}]), 'columns must be those of stability'),
        (Table({'table': 'stability'}, []), 'no map to draw'),
    ],
)
def test_other_tables_are_refused(table, sentence, tmp_path):
    with pytest.raises(ParameterError, match=sentence):
        draw_stability(table, tmp_path)
