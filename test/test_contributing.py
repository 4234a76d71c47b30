# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The recipes of CONTRIBUTING.md do what they say: their Python runs, without the compiler."""

import os
from pathlib import Path
import re
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / 'CONTRIBUTING.md').read_text(encoding='utf-8')
# Three links that undulate for 3 ms on the floor, in space.
RUN = """
import numpy as np
from snake_sim_ros.scene.parameters import load_scene, with_settings
from snake_sim_ros.stepping.simulation import simulate

SHORT = with_settings(
    load_scene('lateral_undulation'),
    {'robot.link_count': 3, 'level': 'spatial', 'dt': 1e-3, 'duration': 3e-3},
)

def trajectory(method, **settings):
    found = simulate(with_settings(SHORT, {'method': method, **settings}), rate=1000.0)
    report = found.report
    assert (report.steps, report.failure, report.unconverged) == (3, '', 0), report
    return found
"""
# What comes before the Python of a recipe that shows functions of the package, and what follows.
NAMES = {'Add a contact law': 'from snake_sim_ros.contact.laws import *'}
CHECKS = {
    'Add a gait': """
table = scene.gait.table
assert table.joint_count == 10 and len(table.time) == 201
angle, rate = table.reference(0.3125)  # between two rows
assert abs(angle - crawl(0.3125)).max() < 1e-7
assert abs(rate[:, 1] - 0.4 * np.cos(1.25 - 0.6 * np.arange(10))).max() < 1e-4
""",
    'Add a sensor': RUN
    + """
from types import SimpleNamespace

# Link 1 along e_z of I, then along -e_z, then along e_x.
half = np.sqrt(0.5)
turns = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [half, 0.0, half, 0.0]])
still = SimpleNamespace(orientation=turns[:, None])
tilt = measured_tilt(still, SensorsWithTilt())
assert abs(tilt - [np.pi / 2, -np.pi / 2, 0.0]).max() < 1e-7
noisy = SensorsWithTilt(tilt_noise=0.1, sensor_seed=3)
lying = trajectory('newton')
readings = measured_tilt(lying, noisy)
assert readings.shape == (4,) and 0.0 < abs(readings).max() < 0.5
assert (readings == measured_tilt(lying, noisy)).all()  # a seed gives the same bits
""",
    # Implicit steps of gamma' = -G c gamma for both contacts of a link, which rolls if pushed so.
    'Add a contact law': RUN
    + """
from snake_sim_ros import Simulation, State

ALONG, ACROSS = 4.0, 12.0  # N s/m
viscous = {'friction.viscous_longitudinal': ALONG, 'friction.viscous_transversal': ACROSS}
alone = {'friction.longitudinal': 0.0, 'friction.transversal': 0.0, 'robot.link_count': 1}
alone |= {'solver.tolerance': 1e-13}
for method in ('newton', 'paper'):
    one = with_settings(SHORT, {'method': method, **alone, **viscous})
    simulation = Simulation(one)
    u = simulation.state.u.copy()
    u[0, :2] = 0.1, 0.05
    simulation.state = State(simulation.state.q, u)
    none = np.zeros((3, 0, 2))
    report = simulation.advance(none, none)
    assert report.steps == 3 and not report.unconverged
    v, roll, robot = simulation.state.u[0, :2], simulation.state.u[0, 5], one.robot
    m, r, theta = robot.link_mass, robot.contact_radius, robot.inertia_axial
    rate = np.array([ALONG / m, ACROSS * (1 / m + r**2 / theta)])
    expected = np.array([0.1, 0.05]) / (1 + rate * one.dt) ** 3
    error = abs(v + [0.0, r * roll] - expected).max()
    assert error < 3 * 2 * one.solver.residual_tolerance, error
""",
    # A link that is pushed sideways: more links share loads, for which sweeps alone are too slow.
    # Residuals are at most 1e-9 m/s, so that positions agree to 3e-12 m after 3 ms.
    'Add a solver': RUN
    + """
push = {'force': (0.0, 6.0, 0.0), 'torque': (0.0, 0.0, 0.1), 'duration': 1.0}
pushed = {'robot.link_count': 1, 'pushes': [push]}
newton, sweeps = trajectory('newton', **pushed), trajectory('plain_sweeps', **pushed)
assert sweeps.report.iterations > newton.report.iterations
assert abs(newton.position[-1] - newton.position[0]).max() > 1e-5
assert abs(sweeps.position - newton.position).max() < 3e-12
""",
    # It is the same step.
    'Add a method': RUN
    + """
newton, mine = trajectory('newton'), trajectory('my_method')
assert (mine.position == newton.position).all()
assert (mine.joint_torque == newton.joint_torque).all()
""",
}


def recipes():
    """Return heading -> Python of the recipes on the page."""
    sections = re.split(r'^#+ (.*)\n', PAGE, flags=re.MULTILINE)
    blocks = {
        heading: '\n'.join(re.findall(r'^```python\n(.*?)^```', text, re.MULTILINE | re.DOTALL))
        for heading, text in zip(sections[1::2], sections[2::2], strict=True)
    }
    return {heading: code for heading, code in blocks.items() if code}


def test_every_recipe_is_checked():
    assert set(recipes()) == set(CHECKS)


def test_the_recipe_of_a_law_shows_the_laws_of_the_package():
    laws = (ROOT / 'snake_sim_ros' / 'contact' / 'laws.py').read_text(encoding='utf-8')
    functions = re.split(r'^(?=@inlined)', recipes()['Add a contact law'], flags=re.MULTILINE)[1:]
    assert len(functions) == 4
    for function in functions:
        assert function.strip() in laws, function


@pytest.mark.parametrize('heading', CHECKS)
def test_a_recipe_does_what_it_says(heading):
    environment = {**os.environ, 'NUMBA_DISABLE_JIT': '1', 'PYTHONPATH': str(ROOT)}
    script = f'{NAMES.get(heading, "")}\n{recipes()[heading]}\n{CHECKS[heading]}'
    done = subprocess.run(
        [sys.executable, '-c', script], env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
