# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the package needs and claims is the same in setup.py, package.xml, pages and changelog."""

from pathlib import Path
import re
import runpy
from xml.etree import ElementTree

import pytest
import setuptools

from snake_sim_ros import ParameterError, Robot
from snake_sim_ros.stepping.methods import LARGE_STEP

pytestmark = pytest.mark.fast

ROOT = Path(__file__).resolve().parent.parent


def text(name):
    """Return the text of a file with single spaces."""
    return ' '.join((ROOT / name).read_text(encoding='utf-8').split())


CHANGELOG = text('CHANGELOG.rst')
INSTALLATION = text('docs/installation.md')
# rosdep's keys for packages of PyPI where they are not python3-<name>. It has none for the
# optional packages, or one that is installed by pip: docs/installation.md names them.
KEYS = {'PyYAML': 'python3-yaml', 'Pillow': 'python3-pil'}
OPTIONAL = {'bags', 'learn', 'studies', 'urdf', 'video', 'viewer'}
SITE = {'docs'}  # only builds the site
TRAINING = {'train'}  # only for examples; it takes several GB
# Checks of style, other readers of bags and of URDF files, and what makes the tests faster.
DEVELOPMENT = {
    'pytest-xdist',
    'import-linter',
    'ruff',
    'mypy',
    'types-PyYAML',
    'wheel',
    'rosbags',
    'mujoco-core',
}


@pytest.fixture
def given(monkeypatch):
    """Return what setup.py gives to setuptools, once it runs."""
    arguments = {}
    monkeypatch.setattr(setuptools, 'setup', lambda **found: arguments.update(found))
    return arguments


@pytest.fixture
def needed(given, monkeypatch):
    """Return what setup.py asks for: extra -> names of packages; None is what is always needed."""
    monkeypatch.chdir(ROOT)
    runpy.run_path('setup.py')
    extras = {None: given['install_requires'], **given['extras_require']}
    return {key: set(map(name, requirements)) for key, requirements in extras.items()}


def test_a_link_to_setup_runs_in_another_folder(given, monkeypatch, tmp_path):
    # As colcon build --symlink-install does it, without the other files of the project.
    (tmp_path / 'setup.py').symlink_to(ROOT / 'setup.py')
    monkeypatch.chdir(tmp_path)
    runpy.run_path('setup.py')
    assert given['long_description'] == (ROOT / 'README.md').read_text(encoding='utf-8')


def name(requirement):
    return re.match(r'[\w-]+', requirement).group()


def depends(kind):
    root = ElementTree.parse(ROOT / 'package.xml').getroot()
    return {item.text for item in root.findall(kind)}


def keys(names):
    return {KEYS.get(item, f'python3-{item}') for item in names}


def test_rosdep_gets_what_runs_and_pictures_need(needed):
    assert keys(needed[None] | needed['plots']) <= depends('exec_depend')
    names = {item.removeprefix('ros-jazzy-').replace('-', '_') for item in needed['jazzy']}
    assert names <= depends('exec_depend')


def test_the_page_on_installation_names_what_rosdep_does_not_get(needed):
    assert set(needed) == {None, 'plots', 'test', 'jazzy'} | OPTIONAL | SITE | TRAINING
    for item in set().union(*(needed[extra] for extra in OPTIONAL | TRAINING)):
        assert f'`{item}`' in INSTALLATION
    (asked,) = re.findall(r"pip install '\.\[([a-z,]+)\]'` in an environment", INSTALLATION)
    assert set(asked.split(',')) == OPTIONAL


def test_rosdep_gets_what_the_tests_cannot_do_without(needed):
    optional = set().union(*(needed[extra] for extra in OPTIONAL))
    run = needed['test'] - optional - needed['plots'] - DEVELOPMENT
    assert keys(run) == depends('test_depend')


def test_changelog_and_page_say_the_same_of_large_steps():
    assert LARGE_STEP == 1e-3
    assert 'for time steps of 1/1000 s to 1/10 s' in CHANGELOG
    assert 'for large steps, 1/1000 s to 1/10 s' in text('docs/methods.md')


@pytest.mark.parametrize('page', ['CHANGELOG.rst', 'docs/scenes.md'])
def test_numbers_of_links_are_those_that_are_taken(page):
    first, last = map(int, re.search(r'(\d+) to (\d+) links', text(page)).groups())
    for count in (first, last):
        assert Robot(link_count=count).link_count == count
    for count in (first - 1, last + 1):
        with pytest.raises(ParameterError):
            Robot(link_count=count)
