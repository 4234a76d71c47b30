# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rooms and their imports, which the contracts of import-linter in pyproject.toml state."""

import ast
import os
from pathlib import Path
import re

from processes import python
import pytest

pytestmark = pytest.mark.fast

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / 'snake_sim_ros'
MODULES = sorted(PACKAGE.rglob('*.py'))
HEAD = """\
# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
each_module = pytest.mark.parametrize(
    'path', MODULES, ids=lambda path: str(path.relative_to(PACKAGE).with_suffix(''))
)


def test_imports_keep_the_contracts(monkeypatch):
    # Rooms stand above each other; no circles; physics without ROS and without a display.
    importlinter = pytest.importorskip('importlinter.cli')
    monkeypatch.chdir(ROOT)
    assert importlinter.lint_imports(no_cache=True) == importlinter.EXIT_STATUS_SUCCESS


def test_contributing_names_the_rooms():
    page = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
    rooms = {path.parent.name for path in PACKAGE.glob('*/__init__.py')}
    assert rooms == set(re.findall(r'^\| `(\w+)` \|', page, re.MULTILINE))


def test_physics_imports_without_ros_and_matplotlib():
    script = (
        'import importlib, sys\n'
        'sys.modules["rclpy"] = sys.modules["matplotlib"] = sys.modules["viser"] = None\n'
        'for name in ("stepping.simulation", "studies.study", "recording.recorded_runs"):\n'
        '    importlib.import_module(f"snake_sim_ros.{name}")\n'
        'from snake_sim_ros import *\n'
        'print("imported")'
    )
    assert python('-c', script, folder=ROOT) == 'imported\n'


def texts():
    """Yield the text files of the project, without what is built or hidden."""
    built = {'build', 'install', 'log', '__pycache__'}
    for folder, folders, files in os.walk(ROOT):
        folders[:] = [
            name
            for name in folders
            if name not in built and not name.startswith('.') and not name.endswith('.egg-info')
        ]
        for name in {*files} - {'.git'}:  # a file in a second work tree
            path = Path(folder) / name
            content = path.read_bytes()
            if b'\0' not in content:
                yield path, content.decode()


def test_every_source_file_says_whose_it_is():
    for path, text in texts():
        if path.suffix == '.py' or text.startswith('#!'):
            first, _, rest = text.partition('\n')
            assert (rest if first.startswith('#!') else text).startswith(HEAD), path


@pytest.mark.parametrize('room', ['dynamics', 'contact', 'stepping'])
def test_functions_of_the_physics_take_six_arguments_at_most(room):
    # More say that some of them belong together, in a record with a meaning.
    for path in (PACKAGE / room).rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
            if isinstance(node, ast.FunctionDef):
                given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                names = [each.arg for each in given if each.arg not in ('self', 'cls')]
                assert len(names) <= 6, f'{path.name}: {node.name}({", ".join(names)})'


@each_module
def test_outputs_are_written_as_a_whole(path):
    # Bags grow, and locks are empty.
    others = ('files.py', 'bag_writer.py', 'code_cache.py')
    way = re.compile(r"(\w+)\.(?:(?:write_text|write_bytes|savefig)\(|open\([^)\n]*'[wx])")
    written = {match[1] for match in way.finditer(path.read_text(encoding='utf-8'))}
    assert path.name in others or written <= {'part'}


def test_no_text_names_a_place_on_somebodys_machine():
    # System folders such as /usr/bin and /opt/ros are the same everywhere.
    place = re.compile(r'(?<![\w.~$}/])/(?:home|root|Users|work|mnt|media|srv|tmp|scratch)/\w')
    found = [
        f'{path.relative_to(ROOT)}: {line.strip()}'
        for path, text in texts()
        for line in text.splitlines()
        if place.search(line)
    ]
    assert not found
