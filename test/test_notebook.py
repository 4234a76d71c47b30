# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The notebook of the examples runs from its first cell to its last, without Jupyter."""

import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

NOTEBOOK = Path(__file__).resolve().parent.parent / 'examples' / 'first_runs.ipynb'


@pytest.fixture(scope='module')
def cells():
    return json.loads(NOTEBOOK.read_text(encoding='utf-8'))['cells']


def test_notebook_runs_without_ros(cells, tmp_path):
    code = [''.join(cell['source']) for cell in cells if cell['cell_type'] == 'code']
    # As on a machine without ROS; pictures go nowhere.
    script = '\n'.join(['import sys', "sys.modules['rclpy'] = None", *code])
    environment = {**os.environ, 'MPLBACKEND': 'Agg'}
    done = subprocess.run(
        [sys.executable, '-c', script], cwd=tmp_path, env=environment, text=True,
        capture_output=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert ' m at ' in done.stdout and 'cost of transport' in done.stdout


def test_notebook_is_stored_without_what_it_printed(cells):
    for cell in cells:
        assert not cell.get('outputs') and cell.get('execution_count') is None
