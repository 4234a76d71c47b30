# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands in processes of their own that are stopped by a signal while they work."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import time

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = {**os.environ, 'PYTHONPATH': str(ROOT)}
DEADLINE = 100.0  # s for what a test waits for
# A metric of rows that take long in a folder with a file `hold`, without keeping a core busy.
SLOW = """
from pathlib import Path
import time


def slow(trajectory):
    if Path('hold').exists():
        time.sleep(0.1)
    return 0.0
"""


def wait_for(condition, what):
    """Wait until a condition holds."""
    deadline = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.002)


def rows_of(journal):
    """Return the number of whole rows of a journal."""
    return journal.read_bytes().count(b'\n') if journal.exists() else 0


def stopped(arguments, folder, journal, *, rows, by=signal.SIGKILL):
    """
    Start a command, stop it once its journal has some rows; return its status and prints.

    Its rows take long if it has the metric `slow`.
    """
    hold = folder / 'hold'
    hold.touch()
    process = subprocess.Popen(
        [sys.executable, '-m', 'snake_sim_ros.commands', *map(str, arguments)],
        cwd=folder, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        wait_for(lambda: rows_of(journal) >= rows or process.poll() is not None, 'no rows')
        assert process.poll() is None
        process.send_signal(by)
        output, errors = process.communicate(timeout=DEADLINE)
    finally:
        hold.unlink()
        process.kill()
        process.wait()
    return process.returncode, output, errors
