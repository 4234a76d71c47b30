# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The cache of compiled functions: one for all installations, private, and not growing."""

import os
from pathlib import Path
import shutil
import subprocess
import sys

import pytest

from snake_sim_ros.dynamics import code_cache
from snake_sim_ros.dynamics.compilation import compiled, COMPILES, watched
from snake_sim_ros.scene import PACKAGE

PROGRAM = """
import sys
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.dynamics import kinematics
from snake_sim_ros.scene.parameters import Robot
import numpy as np
names, places, R = [], Robot(link_count=2).chain.places, np.zeros((2, 3, 3))
frames = kinematics.make_joint_frames(places, R)
motion = np.zeros((1, 2, 7)), np.zeros((1, 2, 6))
with watched(names.append):
    kinematics.joint_motions(places, motion, R, np.zeros((2, 3)), frames, np.zeros((1, 1, 2, 2)))
print(len(names), 'numba' in sys.modules)
"""


def compiled_functions(cache: Path, sources: Path) -> int:
    """Return how many functions a process compiles, which imports Numba only if it compiles."""
    inherited = {name: value for name, value in os.environ.items() if name != 'NUMBA_CACHE_DIR'}
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM],
        env={**inherited, 'XDG_CACHE_HOME': str(cache), 'PYTHONPATH': str(sources)},
        cwd=sources,
        capture_output=True,
        text=True,
        check=True,
    )
    count, is_ready = done.stdout.split()
    assert is_ready == str(count != '0')
    return int(count)


def test_it_is_shared_by_sources_that_are_the_same_or_comes_with_the_package(tmp_path):
    copy, link, cache = tmp_path / 'copy', tmp_path / 'link', tmp_path / 'cache'
    for folder in (copy, link):
        folder.mkdir()
    shutil.copytree(PACKAGE, copy / PACKAGE.name, symlinks=False)
    (link / PACKAGE.name).symlink_to(PACKAGE)
    assert compiled_functions(cache, PACKAGE.parent) > 3
    assert compiled_functions(cache, copy) == 0
    assert compiled_functions(cache, link) == 0
    # What came with the package is loaded and never written.
    shipped = copy / PACKAGE.name / code_cache.SHIPPED.name
    shutil.copytree(cache / PACKAGE.name, shipped)
    (ours,) = shipped.iterdir()
    ours.rename(shipped / code_cache.identity(libraries=()))
    before = {path: path.stat().st_mtime_ns for path in shipped.rglob('*')}
    empty = tmp_path / 'empty'
    assert compiled_functions(empty, copy) == 0
    assert not list(empty.rglob('*.code'))
    assert {path: path.stat().st_mtime_ns for path in shipped.rglob('*')} == before
    # Both are of these sources only: of others neither helps.
    shutil.copytree(cache, empty, dirs_exist_ok=True)
    (copy / PACKAGE.name / 'contact' / 'closing.py').write_text('# nothing any more\n')
    assert compiled_functions(empty, copy) > 3


def test_code_that_came_for_something_else_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(code_cache, 'SHIPPED', tmp_path)
    assert code_cache.why_compile() == ''
    (tmp_path / 'other').mkdir()
    for is_portable, why in (
        (True, 'its sources have changed'),
        (False, 'this is an older or another processor'),
    ):
        monkeypatch.setattr(code_cache, 'is_portable', lambda is_so=is_portable: is_so)
        assert code_cache.why_compile() == (
            f'the package brings machine code for x86-64-v3, but {why}: it is compiled now'
        )
    if code_cache.processor_name() == code_cache.PORTABLE:
        (tmp_path / code_cache.identity(libraries=())).mkdir()
        assert code_cache.why_compile() == ''


def test_an_old_compiler_is_named(monkeypatch):
    monkeypatch.setattr(code_cache, 'version', lambda _: '0.58.1')
    assert code_cache.why_compile() == (
        'numba 0.58.1 compiles each scene for minutes: install numba 0.60 or newer'
    )
    oldest = '.'.join(map(str, code_cache.OLDEST_NUMBA))
    for name in ('setup.py', 'pyproject.toml'):
        text = (Path(__file__).parents[2] / name).read_text(encoding='utf-8')
        assert f"'numba>={oldest}," in text


def test_code_for_types_of_an_absent_package_is_in_nobodys_way(tmp_path):
    law = (
        'from snake_sim_ros.dynamics.compilation import compiled\n\n\n@compiled\ndef first(way):\n'
    )
    (tmp_path / 'laws').mkdir()
    (tmp_path / 'laws' / 'law.py').write_text(f'{law}    return way[0]\n')
    (tmp_path / 'types').mkdir()
    (tmp_path / 'types' / 'ways.py').write_text(
        'from typing import NamedTuple\n\n\nclass Way(NamedTuple):\n    x: float\n'
    )

    def said(script, *folders):
        path = os.pathsep.join([str(PACKAGE.parent), *(str(tmp_path / name) for name in folders)])
        environment = {**os.environ, 'XDG_CACHE_HOME': str(tmp_path / 'cache'), 'PYTHONPATH': path}
        command = [sys.executable, '-c', f'import law\n{script}']
        return subprocess.check_output(command, env=environment, cwd=tmp_path, text=True)

    assert said('import ways\nprint(law.first(ways.Way(1.0)))', 'laws', 'types') == '1.0\n'
    assert said('print(law.first((2.0,)))', 'laws') == '2.0\n'


def test_what_was_not_used_for_long_is_removed(tmp_path, monkeypatch):
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path))
    monkeypatch.delenv('NUMBA_CACHE_DIR', raising=False)
    parent = tmp_path / 'snake_sim_ros'
    for k in range(7):
        (parent / f'other_{k}').mkdir(parents=True)
        (parent / f'other_{k}' / 'code').write_text('old')
        os.utime(parent / f'other_{k}', (1000 * k, 1000 * k))
    folder = code_cache.cache_folder()
    assert folder == parent / code_cache.identity()
    left = {path.name for path in parent.iterdir()}
    assert left == {folder.name, 'other_4', 'other_5', 'other_6'}


@pytest.mark.parametrize('trouble', ['open to all', 'a link', 'a file'])
def test_a_folder_for_temporary_files_must_be_private(tmp_path, monkeypatch, trouble):
    # Who can write it decides what runs.
    home = tmp_path / 'home'
    home.write_text('not a folder')
    monkeypatch.setenv('XDG_CACHE_HOME', str(home))
    monkeypatch.delenv('NUMBA_CACHE_DIR', raising=False)
    monkeypatch.setattr(code_cache.tempfile, 'gettempdir', lambda: str(tmp_path))
    private = tmp_path / f'cache-{os.getuid()}'
    found = code_cache.cache_folder()
    assert found == private / 'snake_sim_ros' / code_cache.identity()
    assert private.stat().st_mode & 0o777 == 0o700
    shutil.rmtree(private)
    if trouble == 'open to all':
        private.mkdir()
        private.chmod(0o777)
    elif trouble == 'a link':
        (tmp_path / 'elsewhere').mkdir(mode=0o700)
        private.symlink_to(tmp_path / 'elsewhere')
    else:
        private.write_text('')
    assert code_cache.cache_folder() is None


def test_a_folder_of_somebody_else_is_not_taken(tmp_path, monkeypatch):
    tmp_path.chmod(0o700)
    assert code_cache.is_private(tmp_path)
    monkeypatch.setattr(code_cache.os, 'getuid', lambda: 12345)
    assert not code_cache.is_private(tmp_path)


def test_what_refuses_to_compile_leaves_the_function_as_it_is(monkeypatch, tmp_path):
    if not COMPILES:
        pytest.skip('nothing is compiled')

    monkeypatch.setattr(code_cache, 'FOLDER', tmp_path)  # nothing is compiled there

    class Refused(Exception):
        pass

    def refuse(name):
        raise Refused(name)

    def twice(x):
        return 2 * x

    monkeypatch.setattr(code_cache.Shelf, 'shares_work', True)
    function, beside = compiled(twice), compiled(twice)  # beside, as another process has it
    with pytest.raises(Refused, match='twice'), watched(refuse):
        function(1.0)
    assert beside(1.0) == 2.0  # no lock is left
    assert function(1.0) == 2.0
