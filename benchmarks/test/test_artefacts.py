# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What methods without set-valued laws make up, against closed forms; and the table of it."""

import math
import sys

import numpy as np
import pytest
from scenes import ACROSS, ALONG, EPS, G, MASS

from snake_sim_benchmarks import __main__ as cli
from snake_sim_benchmarks.comparison import artefacts
from snake_sim_benchmarks.comparison.artefacts import (
    DROP_HEIGHT,
    DT,
    MU,
    PENALTY,
    SLIDING_SPEED,
    SLOPE_ANGLE,
)
from snake_sim_benchmarks.comparison.csv_tables import read_table
from snake_sim_benchmarks.comparison.timing import trajectory_of_states
from snake_sim_ros import Report
from snake_sim_ros.contact.laws import PRESS_SPEED

OURS, REGULARIZED, PYRAMID = ('newton', ''), 'semi_implicit_euler', ('pyramid', '')
DEFAULT, STIFF, NO_SLIP = (('mujoco', name) for name in ('default', 'fast', 'accurate'))
FALL = math.sqrt(2 * G * DROP_HEIGHT)  # m/s, velocity of impact
STOP = artefacts.stopping_point(artefacts.ORTHOTROPIC)
# A method of first order may be half a step early or late: of the way, at sqrt(2) m/s.
LATE = math.sqrt(2) * DT / 2


@pytest.fixture(scope='module')
def value():
    """Return a function that returns what an artefact measures of a contender."""
    runs = artefacts.contenders()
    made = {}

    def values(measure, contender):
        if contender[0] == 'mujoco':
            pytest.importorskip('mujoco')
        key = next(key for key in runs if key == contender or key[0] == contender)
        if (measure, key) not in made:
            made[measure, key] = measure(runs[key])
        return made[measure, key]

    return values


# ---- set-valued laws ----------------------------------------------------------------------------


def test_ours_neither_creeps_nor_lifts(value):
    # Residuals of rounding, see test_no_creep.py.
    assert abs(value(artefacts.creep, OURS)[0]) < 1e-12
    assert value(artefacts.lifting, OURS)[0] <= 4 * 0.1 * EPS


def test_ours_stops_where_coulomb_says(value):
    # T7, with p = 25: the numbers of the model's specification.
    assert pytest.approx((0.629883, 0.112316), abs=1e-6) == STOP
    assert value(artefacts.direction, OURS)[0] < LATE


def test_ours_sinks_in_by_one_step_at_most(value):
    # The selection rule presses at PRESS_SPEED at most, for a second. A gap closes in one step.
    assert value(artefacts.rest, OURS)[0] < PRESS_SPEED * 1.0
    depth, rebound = value(artefacts.drop, OURS)
    assert depth < FALL * DT
    assert rebound < 1e-12


def test_ours_gains_energy_by_explicit_gyroscopic_terms(value):
    # T12: velocities across grow by exp(Omega^2 dt t/2), so that ours is no better here.
    *across, w_z = artefacts.SPIN_RATES
    Omega = (ALONG - ACROSS) / ACROSS * w_z
    share = ACROSS * np.dot(across, across) / (ACROSS * np.dot(across, across) + ALONG * w_z**2)
    expected = 100 * share * (math.exp(Omega**2 * DT * 10.0) - 1)
    # The growth of a step is 1 + (Omega dt)^2/2, of which the exponential is the first term.
    assert value(artefacts.spin, OURS)[0] == pytest.approx(expected, rel=1e-3)


# ---- baselines ----------------------------------------------------------------------------------


def test_regularized_friction_creeps(value):
    # mu tanh(v/eps) = tan b, once the start has died out.
    expected = PENALTY.sliding_velocity * math.atanh(math.tan(SLOPE_ANGLE) / MU)
    assert value(artefacts.creep, REGULARIZED)[0] == pytest.approx(expected, rel=1e-3)


def test_springs_sink_in(value):
    # m g/(2 k) of each of two; after the drop v/(e omega), critically damped, less what the damper
    # overdoes in steps that omega dt = 0.14 of it long.
    k = PENALTY.stiffness
    assert value(artefacts.rest, REGULARIZED)[0] == pytest.approx(MASS * G / (2 * k), rel=1e-3)
    omega = math.sqrt(2 * k / MASS)
    depth, rebound = value(artefacts.drop, REGULARIZED)
    assert depth == pytest.approx(FALL / (math.e * omega), rel=2 * omega * DT)
    assert 1e-5 < rebound < DROP_HEIGHT


def test_a_pyramid_changes_the_direction_of_sliding(value):
    # Each component stops alone: v^2/(2 mu g).
    x, y = (1 / (2 * mu * G) for mu in (0.1, 0.5))
    expected = math.hypot(x - STOP[0], y - STOP[1])
    distance, turned = value(artefacts.direction, PYRAMID)
    assert distance == pytest.approx(expected, abs=LATE)
    assert turned == pytest.approx(
        math.degrees(math.atan2(y, x) - math.atan2(STOP[1], STOP[0])), abs=0.05
    )
    # It is the only one of its artefacts: on an axis it is Coulomb's law.
    assert abs(value(artefacts.creep, PYRAMID)[0]) < 1e-12
    assert value(artefacts.lifting, PYRAMID)[0] <= 4 * 0.1 * EPS


# ---- MuJoCo -------------------------------------------------------------------------------------


def test_mujoco_creeps_as_its_friction_is_soft(value):
    # A steady slide v of a contact with the friction f = m g sin(tilt)/2 has b v = R f, where b =
    # 2/(d_w t_c), t_c = dt, and R = (1 - d)/(d m impratio); d is 0.1 to 0.99 from the surface to a
    # depth of 0.1 mm, d_w = 0.99, impratio = 30. The defaults have t_c = 0.02 s and impratio = 1.
    b, f = 2 / (0.99 * DT), MASS * G * math.sin(SLOPE_ANGLE) / 2
    softest, hardest = ((1 - d) / (d * MASS * 30) * f / b for d in (0.1, 0.99))
    assert hardest < value(artefacts.creep, STIFF)[0] < softest
    assert value(artefacts.creep, DEFAULT)[0] > softest


def test_mujoco_creeps_no_more_with_its_second_friction_solver(value):
    # Its friction has no softness; a single link takes it down to rounding, about 1e-14 m/s.
    assert abs(value(artefacts.creep, NO_SLIP)[0]) < 1e-12


@pytest.mark.parametrize('contender', [DEFAULT, STIFF])
def test_mujoco_lifts_what_slides(contender, value):
    # The cone of velocities: mu v upward if all of a step were contact, a height of (mu v)^2/2g.
    assert 1e-3 < value(artefacts.lifting, contender)[0] < (MU * SLIDING_SPEED) ** 2 / (2 * G)


@pytest.mark.parametrize('contender', [DEFAULT, STIFF, NO_SLIP])
def test_mujoco_sinks_in(contender, value):
    assert 1e-6 < value(artefacts.rest, contender)[0] < 1e-3
    assert value(artefacts.drop, contender)[0] > value(artefacts.rest, contender)[0]


def test_default_cone_of_mujoco_is_a_pyramid(value):
    assert value(artefacts.direction, DEFAULT)[1] > 1.0
    assert abs(value(artefacts.direction, NO_SLIP)[1]) < 1.0


# ---- table --------------------------------------------------------------------------------------


def still(scene, start, steps, every):
    """Run nothing: every state is the start."""
    return lasting(scene, start, steps // every + 1)


def lasting(scene, state, count):
    """Return a trajectory of so many samples of one state."""
    return trajectory_of_states(scene, [state] * count, DT, Report(), 0.0)


def test_the_command_writes_a_table_and_goes_on_with_it(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(artefacts, 'contenders', lambda: {('still', 'a rock'): still})
    file = tmp_path / 'artefacts.csv'
    assert cli.main(['artefacts', '--out', str(file)]) == 0
    table = read_table(file)
    assert table.header['table'] == 'artefacts'
    assert {row['method'] for row in table.rows} == {'still'}
    names = [row['artefact'] for row in table.rows]
    assert names == [name for entry in artefacts.ARTEFACTS for name, _ in entry.quantities]
    assert float(table.rows[0]['value']) == float(table.rows[0]['exact']) == 0.0
    printed = capsys.readouterr().out
    assert 'a rock' in printed
    assert f'{names[0]} [m/s]' in printed
    assert not list(artefacts.measurements(table.rows))
    assert cli.main(['artefacts', '--out', str(file)]) == 0
    assert read_table(file).rows == table.rows


def test_a_run_that_ends_early_is_a_row_without_value():
    rows = [artefacts.Row(artefact='a', method='m', setting='', unit='m')]
    artefact = artefacts.ARTEFACTS[0]

    def fails(scene, start, steps, every):
        return lasting(scene, start, 1)

    (row,) = artefacts.measured(artefact, fails, rows)
    assert row.value is None
    assert 'failed' in row.message


def test_without_mujoco_there_is_a_dash(monkeypatch):
    monkeypatch.setitem(sys.modules, 'mujoco', None)
    rows = [artefacts.Row(artefact='a', method='mujoco', setting='fast', unit='m')]
    run = artefacts.contenders()['mujoco', 'fast']
    (row,) = artefacts.measured(artefacts.ARTEFACTS[0], run, rows)
    assert 'not installed' in row.message
    text = artefacts.text_table([row])
    assert text.splitlines()[-1].split()[-2] == '-'
