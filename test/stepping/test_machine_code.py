# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The machine code of an installed package: all that a start loads, and nothing of the machine."""

import os
import shutil
import subprocess
import sys

import pytest

from snake_sim_ros.dynamics import code_cache
from snake_sim_ros.dynamics.compilation import COMPILES
from snake_sim_ros.scene import PACKAGE
from snake_sim_ros.stepping import machine_code
from snake_sim_ros.stepping.methods import METHODS

KEEP = """
from pathlib import Path
import sys
from snake_sim_ros.stepping import machine_code
machine_code.FORMS = (('lateral_undulation', 'newton'),)
{}
"""
RUN = """
from snake_sim_ros import Simulation, load_scene
from snake_sim_ros.dynamics.compilation import watched
from snake_sim_ros.stepping.samples import make_samples
names = []
with watched(names.append):
    simulation = Simulation(load_scene('lateral_undulation'))
    simulation.compile()
    kept = make_samples(simulation.scene, 1, 60)
    for begun in (0, 20, 40):  # the last call goes on in place
        simulation.advance(*simulation.gait_reference(20), kept, begun)
print(names, simulation.state.u.tobytes().hex())
"""


def output(program, sources=PACKAGE.parent, **environment):
    """Return what a program says on stdout with some sources."""
    given = {**os.environ, 'PYTHONPATH': str(sources), **environment}
    command = [sys.executable, '-c', program]
    return subprocess.check_output(command, env=given, text=True, cwd=sources)


@pytest.mark.skipif(not COMPILES, reason='nothing is compiled')
def test_what_a_start_loads_is_all_that_a_package_needs(tmp_path):
    output(KEEP.format('machine_code.compile_form(0)'))  # into the cache
    shipped = tmp_path / PACKAGE.name / code_cache.SHIPPED.name
    output(KEEP.format(f'machine_code.keep_loaded(Path({str(shipped)!r}))'))
    (folder,) = shipped.iterdir()
    assert folder.name == code_cache.identity(libraries=())
    files = [path for path in folder.rglob('*') if path.is_file()]
    assert any(path.name.startswith('steps.advance') for path in files)
    # What is inside of other functions is not there.
    assert not any('find_contacts' in path.name for path in files)
    for path in files:
        content = path.read_bytes()
        for place in (PACKAGE.parent, sys.prefix):
            assert str(place).encode() not in content
    shutil.copytree(PACKAGE, tmp_path / PACKAGE.name, symlinks=False, dirs_exist_ok=True)
    cache = tmp_path / 'cache'
    done = output(RUN, tmp_path, NUMBA_CACHE_DIR=str(cache))
    assert done.startswith('[] ')
    assert not list(cache.rglob('*.code'))
    assert done == output(RUN)  # the same bits


def test_every_method_is_compiled_on_a_floor_and_among_obstacles():
    product = {'newton', 'bdf2', 'paper'}
    assert product <= set(METHODS)
    for scene in ('lateral_undulation', 'obstacle_aided'):
        assert {method for name, method in machine_code.FORMS if name == scene} == product


def test_it_needs_a_folder(capsys):
    assert machine_code.main([]) == 2
    assert 'FOLDER' in capsys.readouterr().err


def test_it_is_not_made_where_it_would_not_be_portable(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr(machine_code, 'is_portable', lambda: False)
    assert machine_code.main([str(tmp_path / 'code')]) == 1
    assert 'x86-64-v3' in capsys.readouterr().out
    assert not list(tmp_path.iterdir())
