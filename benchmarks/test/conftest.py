# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The tests of the laboratory: its folder, the helpers of the product's tests, Ctrl-C."""

from importlib.util import find_spec
import os
from pathlib import Path
import signal
import sys

# Two processes on two cores: threads of linear algebra would wait for each other most of the time.
os.environ['OPENBLAS_NUM_THREADS'] = '1'

from snake_sim_ros.dynamics.code_cache import Shelf

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = [str(ROOT / name) for name in ('benchmarks', 'test', 'test/system')]
sys.path[:0] = FOLDERS
# Processes that tests start find the laboratory as well.
os.environ['PYTHONPATH'] = os.pathsep.join(
    [str(ROOT), FOLDERS[0], *filter(None, [os.environ.get('PYTHONPATH')])]
)

import snake_sim_benchmarks.comparison.baselines  # noqa: E402, F401, adds its solvers to METHODS

collect_ignore = []
if find_spec('pydrake') is None:  # Drake needs Python 3.12
    collect_ignore.append('test_drake_runs.py')


def pytest_configure(config):
    """Heed SIGINT, and share the work of the compiler with the other process of the tests."""
    # A script that starts the tests with & has it ignored, and then all their processes ignore it.
    if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    Shelf.shares_work = True
