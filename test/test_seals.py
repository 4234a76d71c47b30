# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Seals of CSV files: what was changed by hand is told, what goes on later has its own head."""

import re

import pytest

from snake_sim_ros.commands.main import main
from snake_sim_ros.comparison import csv_tables as tables
from snake_sim_ros.comparison.csv_tables import read_table, TableWriter
from snake_sim_ros.scene.checked_records import ParameterError

COLUMNS = ('name', 'value')
ROWS = [{'name': name, 'value': value} for name, value in (('a', 0.1), ('b', None), ('c, d', 3))]


@pytest.fixture(autouse=True)
def measured_at(monkeypatch):
    """Let a test say at which commit it measures."""

    def change(commit, sources='same'):
        monkeypatch.setattr(tables, '_commit', lambda: commit)
        monkeypatch.setattr(tables, '_sources', lambda: sources)

    change('first')
    return change


@pytest.fixture
def path(tmp_path):
    file = tmp_path / 'x.csv'
    TableWriter(file, 'things', COLUMNS).append(ROWS)
    return file


def edited(path, change):
    lines = path.read_text().splitlines()
    change(lines)
    path.write_text(''.join(f'{line}\n' for line in lines))


def line_of(path, start):
    return next(
        k for k, text in enumerate(path.read_text().splitlines()) if text.startswith(start)
    )


def test_rows_and_head_are_read_without_seals(path):
    table = read_table(path)
    assert table.rows == [{'name': 'a', 'value': '0.1'}, {'name': 'b', 'value': ''},
                          {'name': 'c, d', 'value': '3'}]  # fmt: skip
    assert 'seal' not in table.header
    assert table.header['commit'] == 'first'


def test_every_single_line_counts(path):
    # Whatever line is changed, doubled or taken out, except that rows may miss at the end.
    lines = path.read_text().splitlines()
    first = line_of(path, 'name,')
    for k, line in enumerate(lines):
        for new in ([f'{line} '], [line, line], [line.replace(line[2], 'z', 1)], []):
            path.write_text('\n'.join([*lines[:k], *new, *lines[k + 1 :], '']))
            if not new and k == len(lines) - 1:
                assert len(read_table(path).rows) == 2
                continue
            with pytest.raises(ParameterError, match=r'x\.csv: '):
                read_table(path)
    for end in range(first + 1, len(lines) + 1):
        path.write_text('\n'.join([*lines[:end], '']))
        assert len(read_table(path).rows) == end - first - 1


def test_rows_in_another_order_are_refused(path):
    def swap(lines):
        lines[-1], lines[-2] = lines[-2], lines[-1]

    edited(path, swap)
    with pytest.raises(ParameterError, match='seal of line'):
        read_table(path)


def test_a_head_that_names_another_commit_is_refused_with_a_sentence(path, capsys, measured_at):
    # What happened once: the head was edited, then rows of another commit were appended under it.
    k = line_of(path, '# commit')

    def rename(lines):
        lines[k] = '# commit: second'

    edited(path, rename)
    seal = line_of(path, '# seal') + 1
    sentence = f'x.csv: the seal of line {seal} does not fit: this line, or one since the seal'
    measured_at('second')
    with pytest.raises(ParameterError, match=re.escape(sentence)):
        TableWriter(path, 'things', COLUMNS)
    assert main(['chart', str(path), '--out', str(path.parent)]) == 2
    assert sentence in capsys.readouterr().err


def test_a_head_before_any_row_is_sealed_as_well(tmp_path):
    file = tmp_path / 'x.csv'
    TableWriter(file, 'things', COLUMNS)
    edited(file, lambda lines: lines.insert(1, '# note: mine'))
    with pytest.raises(ParameterError, match='does not fit'):
        read_table(file)


def test_a_head_added_at_the_end_is_refused(path):
    edited(path, lambda lines: lines.append('# commit: second'))
    with pytest.raises(ParameterError, match='does not fit'):
        read_table(path)


def test_going_on_at_the_same_commit_adds_rows_under_a_head_of_their_own(path, monkeypatch):
    before = path.read_text()
    monkeypatch.setattr(tables, '_now', lambda: 'later')
    writer = TableWriter(path, 'things', COLUMNS)
    assert len(writer.rows) == 3
    assert path.read_text() == before  # nothing to say without rows
    writer.append(ROWS[:1])
    writer.append(ROWS[1:])
    table = read_table(path)
    assert len(table.rows) == 6
    assert table.header['commit'] == 'first'
    assert table.header['date'].endswith(' and later')
    text = path.read_text()
    assert text.startswith(before) and text.count('# commit: first') == 2


def test_a_row_cut_short_is_written_again(path):
    whole = path.read_bytes()
    path.write_bytes(whole[:-3])
    writer = TableWriter(path, 'things', COLUMNS)
    assert len(writer.rows) == 2
    writer.append(ROWS[2:])
    assert len(read_table(path).rows) == 3


@pytest.mark.parametrize('other', [('second', 'same'), ('first', 'changed')])
def test_rows_of_other_sources_need_to_be_asked_for(path, measured_at, other):
    before = path.read_text()
    measured_at(*other)
    with pytest.raises(
        ParameterError, match=r'these would be of .*, or go on with --other-sources'
    ):
        TableWriter(path, 'things', COLUMNS)
    assert path.read_text() == before
    TableWriter(path, 'things', COLUMNS, other_sources=True).append(ROWS[:1])
    header = read_table(path).header
    assert (header['commit'], header['sources']) == (
        ' and '.join(dict.fromkeys(['first', other[0]])),
        ' and '.join(dict.fromkeys(['same', other[1]])),
    )
    # None of both goes on with what is mixed.
    for commit in ('first', other[0]):
        measured_at(commit, 'third')
        with pytest.raises(ParameterError, match='holds rows of'):
            TableWriter(path, 'things', COLUMNS)


def test_another_processor_is_refused_in_any_case(path, monkeypatch):
    monkeypatch.setattr(tables, '_processor', lambda: 'abacus')
    with pytest.raises(
        ParameterError, match="these would be of 'abacus': name another file, or r"
    ):
        TableWriter(path, 'things', COLUMNS, other_sources=True)


def test_sources_are_told_apart_by_what_they_say(monkeypatch, tmp_path):
    package = tmp_path / 'package'
    (package / 'config').mkdir(parents=True)
    (package / 'config' / 'a.yaml').write_text('dt: 0.1\n')
    monkeypatch.undo()
    monkeypatch.setattr(tables, 'PACKAGE', package)
    found = [tables._sources()]
    for name in ('tables.py', 'nodes/x.py', 'config/a.yaml'):
        (package / name).parent.mkdir(exist_ok=True)
        (package / name).write_text('# changed\n')
        found.append(tables._sources())
    assert len(set(found)) == 4
    assert tables._sources() == found[-1]


def test_marking_a_file_says_that_nobody_knows(path, capsys):
    sealed = path.read_text()
    assert main(['seal', str(path)]) == 0
    assert 'its seals fit' in capsys.readouterr().out
    assert path.read_text() == sealed

    edited(path, lambda lines: lines.insert(1, '# commit: another'))
    assert main(['seal', str(path)]) == 0
    assert 'of unknown provenance' in capsys.readouterr().out
    table = read_table(path)
    assert table.header['provenance'].startswith('unknown; found as it is and sealed on ')
    assert len(table.rows) == 3
    with pytest.raises(ParameterError, match="holds rows of provenance 'unknown"):
        TableWriter(path, 'things', COLUMNS)
    TableWriter(path, 'things', COLUMNS, other_sources=True).append(ROWS[:1])
    assert len(read_table(path).rows) == 4


def test_a_file_without_seals_is_refused_until_it_is_marked(tmp_path):
    file = tmp_path / 'old.csv'
    file.write_text('# table: things\n# commit: old\nname,value\na,1\n"b, c",2\n')
    with pytest.raises(
        ParameterError, match=r'old\.csv: the rows have no seals: .* snake-sim seal'
    ):
        read_table(file)
    assert main(['seal', str(file)]) == 0
    assert [row['name'] for row in read_table(file).rows] == ['a', 'b, c']
    assert 'unknown' in read_table(file).header['provenance']


def test_a_line_break_in_a_cell_does_not_end_the_row(tmp_path):
    file = tmp_path / 'x.csv'
    TableWriter(file, 'things', COLUMNS).append([{'name': 'two\nlines', 'value': 1}])
    assert read_table(file).rows == [{'name': 'two lines', 'value': '1'}]
