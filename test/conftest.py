# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tests that run with the compiler, and how two processes of tests share it."""

import gc
from importlib.util import find_spec
import os
import signal

import pytest

# Two processes on two cores: threads of linear algebra would wait for each other most of the time.
# NumPy heeds it while it is imported.
os.environ['OPENBLAS_NUM_THREADS'] = '1'

from snake_sim_ros.dynamics.code_cache import Shelf

FAST = 'pytest.mark.fast'  # what files of fast tests say

# They call functions that are compiled for compiled ones only; test_without_compiler.py runs them.
collect_ignore = []
if not os.environ.get('NUMBA_DISABLE_JIT'):
    collect_ignore += ['contact/test_central_path.py', 'contact/test_condensing.py']
    collect_ignore += ['stepping/test_change.py', 'stepping/test_one_step.py']
    collect_ignore += ['dynamics/test_articulated_body.py', 'dynamics/test_joint_path.py']
# They are not on PyPI: .ci/interfaces generates them, test/nodes has stand-ins for them.
for package, name in (
    ('control_msgs', 'follow_joint_trajectory'),
    ('simulation_interfaces', 'simulation_interfaces'),
    ('tf2_msgs', 'transforms'),
):
    if find_spec(package) is None:
        collect_ignore.append(f'system/test_{name}.py')


def pytest_configure(config):
    """Heed SIGINT, and keep the order of files."""
    # A script that starts the tests with & has it ignored, and then all their processes ignore it.
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    config.option.loadscopereorder = False
    Shelf.shares_work = True  # with the other process of the tests


def pytest_ignore_collect(collection_path, config):
    """Leave out files without the mark if fast tests are asked for: importing takes longer."""
    if config.option.markexpr == 'fast' and collection_path.suffix == '.py':
        return True if FAST not in collection_path.read_text(encoding='utf-8') else None
    return None


@pytest.hookimpl(hookwrapper=True)
def pytest_collection():
    """Look for no garbage among modules and tests, neither now, half of the time, nor later."""
    gc.disable()
    yield
    gc.freeze()
    gc.enable()


def pytest_collection_modifyitems(items):
    """Begin with the files that take minutes; then mix live nodes, which wait, and others."""
    files = dict.fromkeys(item.path for item in items)
    live = [path for path in files if path.parent.name == 'system']
    others = [path for path in files if path.parent.name != 'system']
    place = {path: k / len(kind) for kind in (live, others) for k, path in enumerate(kind)}
    items.sort(key=lambda item: (not item.get_closest_marker('long'), place[item.path]))


@pytest.hookimpl(hookwrapper=True, tryfirst=True)
def pytest_terminal_summary(terminalreporter):
    """Say at the end how to get the browser that skipped tests need."""
    yield
    skipped = terminalreporter.stats.get('skipped', [])
    count = sum('chromium' in str(report.longrepr) for report in skipped)
    if count:
        how = 'sudo apt install chromium, or .ci/chromium'
        terminalreporter.write_line(f'{count} tests of the viewer need a browser: {how}')
