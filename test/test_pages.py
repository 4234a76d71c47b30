# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The front page and the pages behind it: length, links, numbers, versions."""

from pathlib import Path
import re
import runpy

import pytest
import setuptools

import snake_sim_ros
from snake_sim_ros.stepping.accuracy import USUAL_ACCURACY

ROOT = Path(__file__).resolve().parent.parent
PAGES = [*sorted(ROOT.glob('*.md')), *sorted(ROOT.glob('docs/*.md'))]
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


def test_the_front_page_fits_three_screens():
    assert len(read('README.md').splitlines()) <= 150


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_of_a_page_lead_somewhere(page):
    for target in re.findall(r'\]\((?!https?:)([^)#]+)(?:#[^)]*)?\)', page.read_text('utf-8')):
        found = page.parent / target
        made = target == 'notation.md' or found.with_suffix('.rst').is_file()
        assert found.exists() or made, target


def test_every_page_is_in_the_index():
    listed = set(re.findall(r'^[a-z_]+$', read('docs/index.md'), re.MULTILINE))
    for page in ROOT.glob('docs/*.md'):
        assert page.stem in listed | {'index'}, page.name


def test_every_example_is_on_the_page_of_examples():
    page = read('docs/examples.md')
    for path in (*ROOT.glob('examples/*.py'), *ROOT.glob('examples/*.yaml')):
        assert f'(../examples/{path.name})' in page, path.name


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
        for row in rows(read('docs/speed_accuracy/targets.md'))
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


def test_version_is_the_same_everywhere(monkeypatch):
    given = {}
    monkeypatch.setattr(setuptools, 'setup', lambda **arguments: given.update(arguments))
    monkeypatch.chdir(ROOT)
    runpy.run_path('setup.py')
    version = snake_sim_ros.__version__
    assert given['version'] == version
    assert f'<version>{version}</version>' in read('package.xml')
    assert f'\nversion: {version}\n' in read('CITATION.cff')
    assert f'version = "{version}"' in read('pixi.toml')
    assert f'\n{version} (' in read('CHANGELOG.rst')
    assert f'snake_sim_ros-{version}-py3' in read('docs/installation.md')
