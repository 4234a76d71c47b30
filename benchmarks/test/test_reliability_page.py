# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The page on reliability has the tables that the program makes of its CSV files."""

from pathlib import Path

import pytest

from snake_sim_benchmarks.comparison.csv_tables import read_table
from snake_sim_benchmarks.reliability.trials import draw_trials

DOCS = Path(__file__).resolve().parents[2] / 'docs'
PAGE = (DOCS / 'reliability.md').read_text(encoding='utf-8')


@pytest.mark.parametrize('kind', ['fuzz', 'soak'])
def test_tables_of_the_page_are_those_of_the_file(kind, tmp_path):
    table = read_table(DOCS / 'reliability' / f'{kind}.csv')
    (drawn,) = draw_trials(table, tmp_path)
    text = drawn.read_text(encoding='utf-8')
    assert text == (DOCS / 'reliability' / drawn.name).read_text(encoding='utf-8')
    assert text in PAGE


def test_cases_that_are_open_are_named_on_the_page():
    folder = Path(__file__).parent / 'found'
    for path in folder.glob('*.yaml'):
        is_open = '\nopen:' in path.read_text(encoding='utf-8')
        assert not is_open or path.stem in PAGE
