# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The numbers on the front page and the pages behind it are those that were measured."""

from pathlib import Path
import re

import pytest

from snake_sim_ros.stepping.accuracy import USUAL_ACCURACY

ROOT = Path(__file__).resolve().parents[2]
# Rows of the README and of docs/why.md, by their beginnings, as they begin in the measured table.
ARTEFACTS = {
    'creep on a slope': 'creep on a slope',
    'error of the end point': 'sliding with mu 0.1 and 0.5, end point',
    'sliding with mu 0.1 and 0.5, end point': 'sliding with mu 0.1 and 0.5, end point',
    'sliding with mu 0.1 and 0.5, direction': 'sliding with mu 0.1 and 0.5, direction',
    'penetration after a drop': 'penetration after a drop',
}
COLUMNS = ('exact', '`newton`', '`mujoco`, default', '`mujoco`, accurate', '`pyramid`')


def read(name):
    return (ROOT / name).read_text(encoding='utf-8')


def rows(text):
    """Return the cells of the rows of all tables of a text."""
    found = re.findall(r'^\|(.*)\|$', text, re.MULTILINE)
    return [[cell.strip() for cell in row.split('|')] for row in found]


@pytest.mark.parametrize('name', ['README.md', 'docs/why.md'])
def test_artefacts_are_those_that_were_measured(name):
    heads, *measured = rows(read('docs/speed_accuracy/artefacts.md'))
    found = [row for row in rows(read(name)) if row[0].startswith(tuple(ARTEFACTS))]
    assert len(found) >= 2
    for first, *cells in found:
        (begin,) = [b for a, b in ARTEFACTS.items() if first.startswith(a)]
        (row,) = [row for row in measured if row[0].startswith(begin)]
        assert cells == [row[heads.index(column)] for column in COLUMNS], first


def test_speeds_are_those_that_were_measured():
    measured = {
        (row[1].strip('`'), row[2]): tuple(row[3:6])
        for row in rows(read('docs/speed_accuracy/speeds.md'))
        if row[0] == 'ensemble' and row[2].endswith('%')
    }
    shown = {
        (row[0].split(', ')[1].replace('-', '_').replace(' ', '_'), row[1]): tuple(row[2:])
        for row in rows(read('docs/why.md'))
        if len(row) == 5 and row[1].endswith('%')
    }
    assert shown == measured
    (front,) = [row for row in rows(read('README.md')) if row[0].startswith('sidewinding with 1')]
    error = re.search(r'with ([\d.]+ %) error', front[0]).group(1)
    assert (front[2], front[4]) == measured['sidewinding', error][:2]


def test_the_accuracy_that_is_asked_for_costs_what_was_measured():
    measured = {
        (row[0].strip('`'), float(row[1])): row
        for row in rows(read('docs/speed_accuracy/accuracy.md'))[2:]
    }
    cases = list(dict.fromkeys(case for case, _ in measured))
    shown = [row for row in rows(read('docs/command_line.md')) if row[0].startswith('`accuracy`')]
    assert len(shown) * len(cases) == len(measured)
    for first, *cells in shown:
        wanted = [measured[case, float(first.split()[1])] for case in cases]
        assert cells == [f'{row[2]}, {row[8]}' for row in wanted]
    (front,) = [row for row in rows(read('README.md')) if 'default accuracy' in row[0]]
    assert front[2] == measured['sidewinding', USUAL_ACCURACY][8]
