"""Before the tests, everything they share is compiled once, in as many processes as test."""

import os
import subprocess
import sys

# (scene, method, level) in an order in which a process finds much of the next one compiled.
SHARED = (
    (
        ('lateral_undulation', 'newton', 'spatial'),
        ('lateral_undulation', 'newton_dense', 'spatial'),
        ('lateral_undulation', 'bdf2', 'spatial'),
        ('lateral_undulation', 'gauss_seidel', 'spatial'),
        ('lateral_undulation', 'paper', 'spatial'),
    ),
    (
        ('lateral_undulation', 'newton', 'planar'),
        ('lateral_undulation', 'newton_dense', 'planar'),
        ('lateral_undulation', 'bdf2', 'planar'),
        ('lateral_undulation', 'gauss_seidel', 'planar'),
        ('obstacle_aided', 'newton', 'spatial'),
    ),
)
PROGRAM = """
import sys
from snake_sim_ros.parameters import load_scene, with_settings
from snake_sim_ros.simulation import Simulation
for entry in sys.argv[1:]:
    source, method, level = entry.split(':')
    scene = with_settings(load_scene(source), {'method': method, 'level': level})
    Simulation(scene).compile(scene.gait)
"""


def pytest_configure(config):
    """Compile, if this is the process that starts the others."""
    if not getattr(config.option, 'numprocesses', None) or os.environ.get('NUMBA_DISABLE_JIT'):
        return
    folder = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    environment = {**os.environ, 'PYTHONPATH': folder}
    running = [
        subprocess.Popen([sys.executable, '-c', PROGRAM, *map(':'.join, part)], env=environment)
        for part in SHARED
    ]
    for process in running:
        process.wait(300)
