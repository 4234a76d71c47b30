# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Gaits from tables of joint angles: between and beyond their rows, in files, and in blends."""

from dataclasses import replace
import math

import numpy as np
import pytest

from snake_sim_ros import Gait, ParameterError, Robot, Table, Wave
from snake_sim_ros.gaits.blending import Blend, check_limits, check_reach
from snake_sim_ros.gaits.steering import Steering, Stride
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.parameters import (
    load_scene,
    scene_from_text,
    scene_to_text,
    with_settings,
)
from snake_sim_ros.stepping.accuracy import longest_step

pytestmark = pytest.mark.fast

OMEGA = 1.4
WAVES = Gait(
    yaw=Wave(amplitude=0.4, angular_frequency=OMEGA, phase_lag=-0.9),
    pitch=Wave(amplitude=0.1, angular_frequency=OMEGA, phase_lag=-0.9, phase=1.57),
)
CYCLE = 2 * math.pi / OMEGA
HEADER = 'time,joint_1_yaw,joint_2_pitch_deg'


def table_of_waves(rows, duration=CYCLE, **options):
    time = np.linspace(0.0, duration, rows)
    return Table.of(time, gait.reference(WAVES, time, 10)[0], **options)


def refusal(function, *arguments, **options):
    with pytest.raises(ParameterError) as caught:
        function(*arguments, **options)
    assert '\n' not in str(caught.value)
    return str(caught.value)


def test_a_table_of_waves_is_these_waves():
    times = np.linspace(0.0, CYCLE, 777)
    angle, rate = gait.reference(WAVES, times, 10)
    told, commanded_rate = gait.reference(Gait(table=table_of_waves(201)), times, 10)
    # A cubic spline is off by 5/384 h^4 |alpha''''| inside, and ten times that at its ends.
    h = OMEGA * CYCLE / 200
    assert np.abs(told - angle).max() < 0.4 * 10 * 5 / 384 * h**4
    assert np.abs(commanded_rate - rate).max() < 0.4 * OMEGA * h**3


def test_rates_that_are_given_are_those_of_the_rows():
    time = np.linspace(0.0, CYCLE, 60)
    table = Table.of(time, *gait.reference(WAVES, time, 10))
    for told, wanted in zip(table.reference(time), gait.reference(WAVES, time, 10), strict=True):
        assert told == pytest.approx(wanted, abs=1e-12)


@pytest.mark.parametrize('time', [0.3, np.array([0.3, 1.7])])
def test_rates_are_the_derivatives_of_the_angles(time):
    table, h = table_of_waves(40), 1e-5
    later, sooner = (table.reference(time + sign * h)[0] for sign in (1, -1))
    assert table.reference(time)[1] == pytest.approx((later - sooner) / (2 * h), abs=1e-8)


def test_beyond_its_rows_a_table_holds_or_repeats():
    once, again = table_of_waves(200), table_of_waves(200, repeat=True)
    angle, rate = once.reference(np.array([-1.0, CYCLE + 5.0]))
    assert angle == pytest.approx(np.array([once.angle[0], once.angle[-1]]).reshape(2, 10, 2))
    assert (rate == 0.0).all()
    times = np.linspace(0.0, CYCLE, 50)
    for told, wanted in zip(
        again.reference(times + 3 * CYCLE), gait.reference(WAVES, times, 10), strict=True
    ):
        assert told == pytest.approx(wanted, abs=1e-6)


def test_waves_and_table_are_added_and_fade_in():
    both = replace(WAVES, table=table_of_waves(200), soft_start=2.0)
    times = np.linspace(0.0, CYCLE, 30)
    for told, wanted in zip(
        gait.reference(both, times, 10),
        gait.reference(replace(WAVES, soft_start=2.0), times, 10),
        strict=True,
    ):
        # Rates of a spline are off by h^3 |alpha''''| at its ends, h = 2 pi/199/omega.
        assert told == pytest.approx(2 * wanted, abs=0.4 * OMEGA * (2 * math.pi / 199) ** 3)


def test_one_time_is_like_many():
    table = table_of_waves(50)
    angle, rate = table.reference(np.array([0.5, 1.5]))
    assert (table.reference(1.5)[0] == angle[1]).all()
    assert (table.reference(1.5)[1] == rate[1]).all()
    assert angle.shape == rate.shape == (2, 10, 2)


# ---- blends -------------------------------------------------------------------------------------


def test_a_blend_with_a_table_has_no_jump():
    plain = load_scene('lateral_undulation').gait
    blend = Blend.of(Gait(table=table_of_waves(100, 10.0)), 10, 1.0, np.full((10, 2), 0.1))
    assert blend.reference(0.0)[0] == pytest.approx(np.full((10, 2), 0.1))
    later = blend.changed(3.0, plain).changed(3.4, Gait(table=table_of_waves(90, 8.0)))
    for before, after, t in ((blend, later, 3.0), (later, later.changed(3.7, plain), 3.7)):
        for one, other in zip(before.reference(t), after.reference(t), strict=True):
            assert one == pytest.approx(other, abs=1e-12)
    h, times = 1e-6, np.linspace(3.41, 4.5, 20)
    change = (later.reference(times + h)[0] - later.reference(times - h)[0]) / (2 * h)
    assert later.reference(times)[1] == pytest.approx(change, abs=1e-7)
    wanted = gait.reference(WAVES, 6.0, 10)
    for told, angle in zip(later.reference(6.0), wanted, strict=True):
        assert told == pytest.approx(angle, abs=1e-5)


def test_limits_of_the_joints_hold_between_rows():
    robot, time = Robot(), np.linspace(0.0, 1.0, 4)
    angle = np.zeros((4, 10, 2))
    angle[1:3, 4, 0] = 0.78  # the spline goes beyond them
    table = Table.of(time, angle)
    largest = np.abs(table.reference(np.linspace(0.0, 1.0, 500))[0]).max()
    assert largest > robot.joint_limit > 0.78
    assert refusal(check_reach, Gait(table=table), robot) == (
        'amplitude plus offset of gait.yaw plus the largest angle of gait.table must be within '
        f'the joint limit, +-0.7854 rad, got {largest:.4g} rad'
    )
    quick = Table.of(time / 50, angle / 2)
    assert 'gait.table must have rates of at most 5 rad/s' in refusal(
        check_limits, Gait(table=quick), robot
    )
    check_limits(Gait(table=table_of_waves(50)), robot)


def test_a_table_cannot_be_steered():
    still, remarks = Steering(0.1, 0.0).gait(Gait(table=table_of_waves(9)), Robot(), Stride(0.5))
    assert still == Gait()
    assert list(remarks.values()) == [
        'cmd_vel: a gait from a table has no frequency to set; it stops'
    ]


def test_steps_are_short_enough_for_a_table():
    waves = replace(load_scene('sidewinding'), gait=WAVES)
    table = replace(waves, gait=Gait(table=table_of_waves(200)))
    assert longest_step(table, 1e-3) == pytest.approx(longest_step(waves, 1e-3), rel=1e-3)


# ---- files --------------------------------------------------------------------------------------


def written(folder, text, table='gait.csv', name='gait.csv'):
    (folder / name).write_text(text)
    (folder / 'scene.yaml').write_text(f'gait: {{table: {table}}}\n')
    return folder / 'scene.yaml'


def test_a_scene_names_a_file_beside_it(tmp_path):
    scene = load_scene(written(tmp_path, f'{HEADER}\n0,0.1,10\n1,0.2,20\n\n'))
    rows = np.zeros((2, 10, 2))
    rows[:, 0, 0], rows[:, 1, 1] = (0.1, 0.2), np.radians([10, 20])
    assert scene.gait.table == Table.of([0.0, 1.0], rows)
    assert scene_from_text(scene_to_text(scene)) == scene
    again = written(tmp_path, f'{HEADER}\n0,0.1,10\n1,0.1,10\n', '{file: gait.csv, repeat: true}')
    assert load_scene(again).gait.table.repeat
    set_by_file = with_settings(load_scene('sidewinding'), {'gait.table': tmp_path / 'gait.csv'})
    assert set_by_file.gait.table == replace(load_scene(again).gait.table, repeat=False)


def test_recorded_runs_are_tables(tmp_path):
    time, angle = np.array([0.0, 0.5, 1.0]), np.linspace(0.0, 0.3, 60).reshape(3, 10, 2)
    np.savez(tmp_path / 'run.npz', time=time, joint_angle=angle, position=np.zeros(3))
    names = [f'joint_{j}_{axis} angle [rad]' for j in range(1, 11) for axis in ('yaw', 'pitch')]
    rows = [
        ','.join(map(str, (t, *row.ravel(), 'planar'))) for t, row in zip(time, angle, strict=True)
    ]
    text = '\n'.join([','.join(['time [s]', *names, 'level']), *rows])
    of_csv = load_scene(written(tmp_path, text, 'run.csv', 'run.csv'))
    of_npz = load_scene(written(tmp_path, '', 'run.npz', 'unused'))
    assert of_csv.gait.table == of_npz.gait.table == Table.of(time, angle)


@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('', 'no column time; the header must be time, joint_1_yaw, ...'),
        (f'{HEADER}\n0,0,0\n', 'a table of joint angles must have 2 rows or more, got 1'),
        (f'{HEADER}\n0,0,0\n0,1,1\n', 'time must increase from row to row, got 0 s after 0 s'),
        (f'{HEADER}\n0,0,0\n1,1\n', 'row 2 must have 3 cells, as the header has, got 2'),
        (f'{HEADER}\n0,0,0\n1,x,1\n', "joint_1_yaw in row 2 must be a number, got 'x'"),
        (f'{HEADER}\n0,0,0\n1,nan,1\n', 'angle must be finite, got nan rad'),
        (f'{HEADER},joint_1_yaw_deg\n', 'joint_1_yaw is given in two columns'),
        (
            'time,joint_11_yaw\n0,0\n1,0\n',
            "unknown column 'joint_11_yaw'; the columns are time and joint_1_yaw to "
            'joint_10_pitch, with _deg for degrees',
        ),
    ],
)
def test_files_that_are_refused(tmp_path, text, sentence):
    assert refusal(load_scene, written(tmp_path, text)) == f'scene.yaml: gait.csv: {sentence}'


def test_tables_that_are_refused(tmp_path):
    path = written(tmp_path, f'{HEADER}\n0,0,0\n1,0.1,0\n', '{file: gait.csv, repeat: true}')
    assert refusal(load_scene, path) == (
        'scene.yaml: gait.csv: a table that repeats must end as it begins, got joint_1_yaw 0 rad '
        'in the first row and 0.1 rad in the last one'
    )
    path = written(tmp_path, '', 'other.csv')
    assert refusal(load_scene, path) == f'scene.yaml: gait.table: no file {tmp_path}/other.csv'
    path = written(tmp_path, '', 'bad.npz', 'bad.npz')
    assert 'must be an npz file with the arrays time and joint_angle' in refusal(load_scene, path)
    path = written(tmp_path, '', '{file: a.csv, repeats: true}')
    assert "gait.table: unknown key 'repeats'; did you mean 'repeat'?" in refusal(load_scene, path)
    assert refusal(Table.of, [0, 1], np.zeros((2, 20))) == (
        'angle must have the shape (rows, n-1, 2), (yaw, pitch) of every joint at 2 times, got '
        '(2, 20)'
    )
    assert refusal(Table.of, [[0, 1]], 0) == 'time must have the shape (rows,), got (1, 2)'
    assert refusal(Table.of, 'x', 0) == 'time must be an array of numbers, got str'
    three = Gait(table=Table.of([0, 1], np.zeros((2, 3, 2))))
    assert refusal(with_settings, load_scene('sidewinding'), {'gait': three}) == (
        'gait.table must have the 10 joints of the robot, got 3 joints'
    )
