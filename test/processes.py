# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""New Python processes that take the package from some folder."""

import os
from pathlib import Path
import subprocess
import sys


def python(*arguments: str, folder: Path, **environment: str) -> str:
    """Return what a new Python process prints that takes the package from a folder."""
    path = os.pathsep.join(filter(None, [str(folder), os.environ.get('PYTHONPATH')]))
    finished = subprocess.run(
        [sys.executable, *arguments],
        env={**os.environ, 'PYTHONPATH': path, 'PYTEST_ADDOPTS': '', **environment},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert finished.returncode == 0, finished.stderr
    return finished.stdout
