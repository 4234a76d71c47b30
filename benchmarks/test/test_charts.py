# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Charts and tables are drawn from CSV files alone: here from those of the documentation."""

from pathlib import Path
import re

import pytest

from snake_sim_benchmarks.__main__ import main
from snake_sim_benchmarks.comparison import artefacts
from snake_sim_benchmarks.comparison.bench_rows import COLUMNS, rows_of
from snake_sim_benchmarks.comparison.bench_tables import LOOP, RUN
from snake_sim_benchmarks.comparison.chart_style import ends, METHOD_STYLES
from snake_sim_benchmarks.comparison.charts import draw_artefacts
from snake_sim_benchmarks.comparison.contenders import all_contenders
from snake_sim_benchmarks.comparison.csv_tables import read_table
from snake_sim_benchmarks.comparison.stability import runs as stability
from snake_sim_benchmarks.comparison.user_times import METHODS_OF_USERS, USER_CASES
from snake_sim_ros.stepping.methods import LARGE_STEP

DOCS = Path(__file__).resolve().parents[2] / 'docs'
STORED = DOCS / 'speed_accuracy'
PAGE = (DOCS / 'speed_accuracy.md').read_text(encoding='utf-8')
FIGURES = (
    'ensemble',
    'cycle',
    'work_precision',
    'error_over_dt',
    'cost_over_links',
    'residual_over_iterations',
    'where_time_goes',
)
TABLES = (
    *('speeds', 'robust', 'accuracy', 'agreement', 'throughput', 'user', 'soak'),
    *('ensemble', 'cycle'),
)


@pytest.fixture(scope='module')
def rows():
    return rows_of(read_table(STORED / 'bench.csv'))


@pytest.fixture(scope='module')
def drawn(tmp_path_factory):
    folder = tmp_path_factory.mktemp('figures')
    assert main(['chart', str(STORED / 'bench.csv'), '--out', str(folder)]) == 0
    return folder


def test_bench_is_drawn_as_svg_and_png(drawn):
    files = [drawn / f'{name}.{kind}' for name in FIGURES for kind in ('svg', 'png')]
    tables = [drawn / f'{name}.md' for name in TABLES]
    assert sorted(drawn.iterdir()) == sorted(files + tables)
    for file in files:
        assert file.read_bytes().startswith(b'\x89PNG' if file.suffix == '.png' else b'<?xml')


def test_figures_are_the_ones_in_the_documentation(drawn):
    # SVG says the same on any machine with the same matplotlib; numbers are compared as text.
    for name in FIGURES:
        texts = [
            re.findall(r'<text[^>]*>([^<]*)', (place / f'{name}.svg').read_text(encoding='utf-8'))
            for place in (drawn, STORED)
        ]
        assert texts[0] == texts[1]


def test_axes_have_units_and_figures_say_where_they_are_from(drawn):
    header = read_table(STORED / 'bench.csv').header
    for name in FIGURES:
        text = (drawn / f'{name}.svg').read_text(encoding='utf-8')
        assert all(ends(header[key]) in text for key in ('commit', 'processor', 'date'))
        assert '[s]' in text or '[us]' in text or '[m/s]' in text or 'simulated time' in text


def test_every_method_has_a_style_of_its_own():
    assert {each.method for each in all_contenders()} <= set(METHOD_STYLES)
    assert len({style[:2] for style in METHOD_STYLES.values()}) == len(METHOD_STYLES)


def test_artefacts_of_the_page_are_those_of_the_file():
    assert (STORED / 'artefacts.md').read_text(encoding='utf-8') in PAGE


@pytest.mark.parametrize('name', TABLES)
def test_tables_of_the_page_are_those_of_the_file(name, drawn):
    text = (drawn / f'{name}.md').read_text(encoding='utf-8')
    assert text == (STORED / f'{name}.md').read_text(encoding='utf-8')
    assert text in PAGE or f'speed_accuracy/{name}.md' in PAGE


def test_the_agreement_that_the_page_of_methods_claims_was_measured(rows):
    text = ' '.join((DOCS / 'methods.md').read_text(encoding='utf-8').split())
    found = re.search(r'at most (\S+) of the distance in A, B and D and (\S+) in C', text)
    bound = dict(zip(('A, B, D', 'C'), map(float, found.groups()), strict=True))
    differences = {'A, B, D': [], 'C': []}
    for row in rows:
        if row.part != 'agreement':
            continue
        assert row.duration == 15.0
        which = 'C' if row.case == 'sidewinding' else 'A, B, D'
        differences[which].append(row.path_difference)
        assert f'`{row.method}`' in text
    for which, claimed in bound.items():
        # Rounded to one digit.
        assert float(f'{max(differences[which]):.0e}') <= claimed <= 3 * max(differences[which])


@pytest.mark.parametrize('case', USER_CASES)
@pytest.mark.parametrize('method', [method for method, _ in METHODS_OF_USERS])
def test_runs_are_nearly_as_fast_as_the_loop(rows, case, method):
    times = {
        row.setting: row.seconds_per_second
        for row in rows
        if (row.part, row.case, row.method) == ('user', case, method)
    }
    assert 1.0 < times[RUN] / times[LOOP] < 1.25


def test_soaks_of_the_page_are_as_long_as_it_says(rows):
    rows = [row for row in rows if row.part == 'soak']
    assert {row.case for row in rows if row.steps == 10**7} == {row.case for row in rows}
    # Flat: between the last two looks, 9e6 steps, no more than 1 %, a quarter of a byte a step.
    ends = {(row.case, row.steps): row.memory_end for row in rows}
    for case in {row.case for row in rows}:
        assert ends[case, 10**7] < 1.01 * ends[case, 10**6]


def test_files_of_the_page_say_what_is_known_of_them():
    for name in ('bench', 'stability', 'artefacts', 'drake/bench'):
        header = read_table(STORED / f'{name}.csv').header
        assert {'commit', 'sources', 'processor'} <= set(header), name


def test_artefacts_are_a_table_in_markdown(tmp_path):
    (file,) = draw_artefacts(read_table(STORED / 'artefacts.csv'), tmp_path)
    assert file.read_text() == (STORED / 'artefacts.md').read_text()


def test_auto_takes_what_the_stored_bench_finds_best(rows):
    # Above LARGE_STEP bdf2 gets to 1 % sooner than newton at any step, in all cases.
    judged = [row for row in rows if row.part == 'ensemble' and row.method in ('newton', 'bdf2')]
    for case in {row.case for row in judged}:
        good = [row for row in judged if row.case == case and row.error_rms <= 0.01]
        best = min(good, key=lambda row: row.seconds_per_second)
        assert best.method == 'bdf2' and best.dt > LARGE_STEP


CELL = {'x': '1', 'y': '1', 'steps': '1', 'unconverged': '0'}


def table(kind, columns, **texts):
    """Return a file, with one row if there are texts."""
    row = ','.join(texts.get(name, '') for name in columns) + '\n'
    return f'# table: {kind}\n{",".join(columns)}\n' + row * bool(texts)


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('# table: weather\nx\n1\n', "got 'weather'"),
        ('# table: bench\nx\n1\n', 'columns must be those of bench'),
        ('x\n1\n', 'the first line must say what it is'),
        (table('bench', COLUMNS), 'x.csv: nothing to draw'),
        (table('bench', COLUMNS, method='euler'), "method must be one of .* got 'euler'"),
        (table('stability', stability.COLUMNS), 'x.csv: no map to draw'),
        (
            table('stability', stability.COLUMNS, **CELL, outcome='fine'),
            "outcome must be one of converged, .* got 'fine'",
        ),
        (table('artefacts', artefacts.COLUMNS), 'x.csv: no artefact to show'),
        (table('artefacts', ('a', 'b'), a='1'), 'columns must be those of artefacts'),
        (table('artefacts', artefacts.COLUMNS, exact='no'), "exact must be a number, got 'no'"),
    ],
)
def test_chart_refuses_other_files(tmp_path, capsys, text, message):
    path = tmp_path / 'x.csv'
    path.write_text(text)
    assert main(['chart', str(path), '--out', str(tmp_path)]) == 2
    assert re.search(message, capsys.readouterr().err)
    assert list(tmp_path.iterdir()) == [path]


def test_runs_without_errors_are_left_out(tmp_path):
    # A case whose runs were all refused has no axes; the one of the other has its limits.
    path = tmp_path / 'x.csv'
    runs = {'part': 'precision', 'method': 'newton', 'level': 'spatial', 'dt': '0.001'}
    good = {'error_path': '0.01', 'reference_error': '1e-4', 'seconds_per_second': '0.1'}
    texts = [
        table('bench', COLUMNS, **runs, case='refused'),
        table('bench', COLUMNS, **runs, case='mixed'),
        table('bench', COLUMNS, **runs, case='mixed', **good),
    ]
    path.write_text(texts[0] + ''.join(text.splitlines(keepends=True)[-1] for text in texts[1:]))
    assert main(['chart', str(path), '--out', str(tmp_path)]) == 0
    drawing = (tmp_path / 'error_over_dt.svg').read_text(encoding='utf-8')
    assert '>mixed<' in drawing and '>refused<' not in drawing


def test_chart_refuses_a_folder_that_is_not_there(tmp_path, capsys):
    bench = str(STORED / 'bench.csv')
    assert main(['chart', bench, '--out', str(tmp_path / 'no')]) == 2
    assert '--out: no folder' in capsys.readouterr().err
