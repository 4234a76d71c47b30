# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The front page and the pages behind it: length, links, versions."""

from pathlib import Path
import re
import runpy

import pytest
import setuptools

import snake_sim_ros

pytestmark = pytest.mark.fast

ROOT = Path(__file__).resolve().parent.parent
PAGES = [*sorted(ROOT.glob('*.md')), *sorted(ROOT.glob('docs/*.md'))]


def read(name):
    return (ROOT / name).read_text(encoding='utf-8')


def test_the_front_page_fits_three_screens():
    assert len(read('README.md').splitlines()) <= 150


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_links_of_a_page_lead_somewhere(page):
    for target in re.findall(r'\]\((?!https?:)([^)#]+)(?:#[^)]*)?\)', page.read_text('utf-8')):
        found = page.parent / target
        made = target == 'notation.md' or found.with_suffix('.rst').is_file()
        assert found.exists() or made, target


def test_every_page_is_in_the_index():
    listed = set(re.findall(r'^[a-z0-9_]+$', read('docs/index.md'), re.MULTILINE))
    for page in ROOT.glob('docs/*.md'):
        assert page.stem in listed | {'index'}, page.name


@pytest.mark.parametrize('name', ['examples', 'gallery'])
def test_every_example_is_on_the_page_of_examples_and_in_the_gallery(name):
    page = read(f'docs/{name}.md')
    for path in ROOT.glob('examples/*.*'):
        assert f'(../examples/{path.name})' in page, path.name


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
    assert f'snake_sim_ros-{version}-cp' in read('docs/installation.md')
