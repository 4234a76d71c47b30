# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nothing imports the laboratory, and README.md lists what it imports of the package."""

import ast
from collections import defaultdict
from pathlib import Path
import re

ROOT = Path(__file__).resolve().parents[2]
HOUSE = ROOT / 'benchmarks' / 'snake_sim_benchmarks'


def imported(path):
    """Yield the modules, and names in them, that a source file imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from ((alias.name, '') for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield from ((node.module, alias.name) for alias in node.names)


def test_nothing_imports_the_laboratory():
    for folder in ('snake_sim_ros', 'test', 'examples', 'launch'):
        for path in (ROOT / folder).rglob('*.py'):
            assert not [name for name, _ in imported(path) if 'snake_sim_benchmarks' in name], path


def test_readme_lists_the_internal_modules_that_are_used():
    used = defaultdict(set)
    for path in HOUSE.rglob('*.py'):
        for module, name in imported(path):
            if module.startswith('snake_sim_ros.'):
                _, room, *parts = module.split('.')
                is_module = (ROOT / module.replace('.', '/') / f'{name}.py').is_file()
                used[room].add('.'.join([*parts, name] if is_module else parts))
    readme = (ROOT / 'benchmarks' / 'README.md').read_text(encoding='utf-8')
    listed = {
        room: set(re.findall(r'`([\w.]+)`', modules))
        for room, modules in re.findall(r'^\| `(\w+)` \| (.*?) \|', readme, re.MULTILINE)
        if (ROOT / 'snake_sim_ros' / room).is_dir()
    }
    assert listed == used
