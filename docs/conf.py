# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The site: Sphinx, because rosdoc2 runs it for ROS packages, with pages in Markdown.

The API page lists what `snake_sim_ros.__all__` names, the page of rooms every module. Some pages
are files of the folder above, which rosdoc2 leaves where it is: it must be in the import path.
"""

import ast
from dataclasses import fields, is_dataclass
import inspect
from pathlib import Path
import re
from typing import TYPE_CHECKING

import snake_sim_ros
from snake_sim_ros.scene import PACKAGE
from snake_sim_ros.scene.parameters import Scene

if TYPE_CHECKING:
    from sphinx.application import Sphinx

project = 'snake_sim_ros'
author = 'snake_sim_ros maintainers'
copyright = f'2026, {author}'
version = release = snake_sim_ros.__version__
extensions = ['myst_parser', 'sphinx.ext.autodoc', 'sphinx.ext.napoleon']
html_theme = 'sphinx_rtd_theme'
html_static_path, html_css_files = ['_static'], ['site.css']
myst_heading_anchors = 3
# Tables that are in pages already; those that a page links to are pages without a place in a menu.
exclude_patterns = ['paper/*.md', 'speed_accuracy/[!ce]*.md', 'speed_accuracy/drake/*.md']
suppress_warnings = ['toc.not_included']  # test_pages.py looks for pages
TOP = {
    'changelog': 'CHANGELOG.rst',
    'contributing': 'CONTRIBUTING.md',
    'notation': 'NOTATION.md',
    'quality_declaration': 'QUALITY_DECLARATION.md',
}
autodoc_typehints = 'none'  # the docstrings have types, with shapes and units
napoleon_google_docstring = False
napoleon_use_ivar = True  # attributes are described once


def setup(app: 'Sphinx') -> None:
    """Let pages be completed when they are read."""
    app.connect('source-read', complete)
    app.connect('autodoc-process-docstring', describe)


def complete(app: 'Sphinx', page: str, source: list[str]) -> None:
    """Append what is written in docstrings to a page, or the file at the top that it shows."""
    if page == 'api':
        source[0] += ''.join(map(directive, in_order_of_use()))
    elif page == 'scene_keys':
        source[0] += '\n| key | default | unit | what |\n|---|---|---|---|\n' + keys(Scene)
    elif page == 'rooms':
        source[0] += ''.join(map(room, sorted(PACKAGE.glob('*/__init__.py'))))
    elif page in TOP:
        text = (PACKAGE.parent / TOP[page]).read_text(encoding='utf-8')
        source[0] = text.replace('](docs/', '](')


def describe(
    app: 'Sphinx', what: str, name: str, value: object, options: object, lines: list[str]
) -> None:
    """Describe an attribute of a record by the meaning and the unit of its field."""
    of_class, _, attribute = name.removeprefix('snake_sim_ros.').partition('.')
    record = getattr(snake_sim_ros, of_class, None)
    known = {field.name: field for field in fields(record)} if is_dataclass(record) else {}
    found = known[attribute].metadata if attribute in known else {}
    if 'meaning' in found:
        lines[:] = [f'{found["meaning"]} [{found["unit"]}]' if found['unit'] else found['meaning']]


def keys(record: type, begin: str = '') -> str:
    """Return the rows of a table of all keys of a record, and of the records in it."""
    rows = ''
    for field in fields(record):
        name, found = f'{begin}{field.name}', field.metadata
        if 'meaning' in found:
            texts = (f'`{field.default}`', found['unit'], found['meaning'])
            cells = [text.replace('|', '\\|') for text in texts]
            rows += f'| `{name}` | {cells[0]} | {cells[1]} | {cells[2]} |\n'
        elif is_dataclass(field.default):
            rows += keys(type(field.default), f'{name}.')
    return rows


def in_order_of_use() -> list[str]:
    """Return all public names, as the page on Python lists them, and those that it does not."""
    page = (Path(__file__).parent / 'python.md').read_text(encoding='utf-8')
    listed = re.findall(r'`(\w+)`', page.partition('## All names')[2])
    public = snake_sim_ros.__all__
    return list(dict.fromkeys([*(name for name in listed if name in public), *public]))


def directive(name: str) -> str:
    """Return the directive that documents a public name."""
    value = getattr(snake_sim_ros, name)
    if not inspect.isclass(value):
        kind, options = 'function' if callable(value) else 'data', ''
    else:
        kind = 'exception' if issubclass(value, Exception) else 'class'
        options = '   :members:\n   :undoc-members:\n'
    return f'\n```{{eval-rst}}\n.. auto{kind}:: snake_sim_ros.{name}\n{options}```\n'


def room(path: Path) -> str:
    """Return a section with the summaries of a room and of its modules."""
    modules = [each for each in sorted(path.parent.rglob('*.py')) if each.name[:2] != '__']
    rows = [f'| `{each.relative_to(path.parent)}` | {summary(each)} |\n' for each in modules]
    heading = f'\n## {path.parent.name}\n\n{summary(path)}\n\n| module | what |\n|---|---|\n'
    return heading + ''.join(rows)


def summary(path: Path) -> str:
    """Return the first paragraph of the docstring of a module."""
    text = ast.get_docstring(ast.parse(path.read_text(encoding='utf-8')))
    return ' '.join((text or '').split('\n\n')[0].split())
