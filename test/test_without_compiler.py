# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The physics alone, without nodes and compiler; and what is tested without the compiler."""

import json
import os
from pathlib import Path
import re
import shutil

import numpy as np
from processes import python
import pytest
from short_run import CASES, short_run

from snake_sim_ros.scene import PACKAGE
from snake_sim_ros.stepping.state import named_arrays

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parent.parent
PHYSICS = {'scene', 'dynamics', 'contact', 'gaits', 'controllers', 'stepping'}


@pytest.fixture(scope='module')
def uncompiled(tmp_path_factory):
    """Return what a process without nodes and compiler finds, all cases in the same one."""
    folder = tmp_path_factory.mktemp('physics')
    rooms = {path.parent.name for path in PACKAGE.glob('*/__init__.py')}
    upper = shutil.ignore_patterns(*rooms - PHYSICS)
    shutil.copytree(PACKAGE, folder / 'snake_sim_ros', ignore=upper)
    program = str(ROOT / 'test' / 'short_run.py')
    file, found = json.loads(python(program, folder=folder, NUMBA_DISABLE_JIT='1'))
    assert Path(file).parent == folder / 'snake_sim_ros'
    return found


@pytest.mark.parametrize(('method', 'level'), CASES)
def test_physics_runs_without_nodes_and_without_compiler(uncompiled, method, level):
    q, u, arrays = uncompiled[f'{method} {level}']
    end, compiled_history, report = short_run(method, level)
    assert (report.steps, report.planar_steps) == (3, 2 if level == 'auto' else 0)
    if method == 'paper':
        assert report.iterations_max > 3 * 10  # after which the contact problem is condensed
    # Both round as written, but sines and tangents may come from another library: 120 sweeps pass
    # a last bit of them on, with stiff joints, to velocities below 1 m/s and 2 rad/s.
    assert np.abs(end.q - q).max() < 1e-12
    assert np.abs(end.u - u).max() < 1e-12
    compiled_arrays = named_arrays(compiled_history)
    assert compiled_arrays.keys() == arrays.keys()
    for name, array in compiled_arrays.items():
        assert np.abs(array - np.reshape(arrays[name], array.shape)).max(initial=0.0) < 1e-12, name


def test_what_is_tested_without_compiler():
    assert_passed(
        'contact/test_central_path.py contact/test_condensing.py '
        'dynamics/test_articulated_body.py dynamics/test_joint_path.py stepping/test_change.py'
    )


def test_a_first_verdict_takes_seconds():
    # 20 s of a processor are promised in CONTRIBUTING.md; it takes half of that.
    start = os.times().children_user
    assert_passed('stepping/test_one_step.py')
    assert os.times().children_user - start < 20.0


def assert_passed(files):
    """Assert that the tests of some files pass without the compiler, see conftest.py."""
    paths = [f'test/{name}' for name in files.split()]
    arguments = ['-m', 'pytest', '-q', '-p', 'no:cacheprovider', *paths]
    printed = python(*arguments, folder=ROOT, NUMBA_DISABLE_JIT='1')
    assert re.search(r'^\d\d+ passed(, \d skipped)? in', printed, re.MULTILINE), printed
