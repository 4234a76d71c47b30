# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Hostile YAML files: each is refused with one short sentence, and soon."""

from itertools import pairwise
import math
import resource
import time
from types import SimpleNamespace

import pytest

from snake_sim_ros import ParameterError, Robot, Scene, Simulation
from snake_sim_ros.recording.from_messages import scene_of
from snake_sim_ros.recording.sensors import Sensors
from snake_sim_ros.scene.checked_records import quoted
from snake_sim_ros.scene.files import MOST_CHARACTERS, parse_yaml
from snake_sim_ros.scene.parameters import load_scene, samples_of, with_settings
from snake_sim_ros.scene.robot_description import robot_description, robot_of
from snake_sim_ros.stepping.samples import make_samples
from snake_sim_ros.studies.problem import load_problem
from snake_sim_ros.studies.study import load_study

pytestmark = pytest.mark.fast

# Each name stands for ten of the one before: 10^9 values from 300 characters.
BOMB = 'a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]\n' + ''.join(
    f'{name}: &{name} [{", ".join([f"*{before}"] * 10)}]\n'
    for before, name in zip('abcdefgh', 'bcdefghi', strict=True)
)
HOSTILE = {
    'date that is none': 'soft_start: 2001-99-99',
    'date in a month that has fewer days': 'dt: 2024-02-30',
    'whole number of letters': 'dt: !!int abc',
    'number of nothing': 'dt: !!float ""',
    'truth value of a word': 'self_contact: !!bool maybe',
    'date of a letter': 'dt: !!timestamp x',
    'digits without a digit': 'dt: 0x_',
    '5000 digits': f'dt: {"9" * 5000}',
    '5000 hexadecimal digits': f'dt: 0x{"f" * 5000}',
    'sixties of sixties': f'dt: 1{":59" * 5000}',
    'brackets': '[' * 3000,
    'brackets in a value': f'dt: {"[" * 100}1{"]" * 100}',
    'mappings in each other': ''.join(' ' * k + 'a:\n' for k in range(1000)),
    'bomb of aliases': BOMB,
    'bomb of merged keys': 'a: &a {x: 1}\n'
    + ''.join(
        f'{name}: &{name} {{<<: [{", ".join([f"*{before}"] * 10)}]}}\n'
        for before, name in zip('abcdefgh', 'bcdefghi', strict=True)
    ),
    'list of itself': 'robot: &a [*a]',
    'name of 256 characters': f'robot: {"a" * 256}',
    'name with a zero': 'robot: "a\\0b"',
    'object of Python': 'robot: !!python/object/apply:os.system ["true"]',
    'long text': f'method: {"x" * 100_000}',
    'long key': f'{"x" * 100_000}: 1',
    'long list': f'gravity: [{"0, " * 5000}0]',
    'many keys': ''.join(f'{k}: 1\n' for k in range(5000)),
    'binary': 'dt: !!binary aGVsbG8=',
    'control character': 'dt: "\x07"',
    'no end': 'dt: "',
    'long objectives': f'scene: sidewinding\nvary: {{dt: {{low: 0.01, high: 0.02}}}}\n'
    f'objectives: {"x" * 20_000}',
    'long robust measure': f'scene: sidewinding\nvary: {{dt: {{low: 0.01, high: 0.02}}}}\n'
    f'maximize: speed\nrobust: {{over: {{friction: 0.3}}, measure: {"x" * 20_000}}}',
    'table of brackets': f'gait: {{table: \'{{"a": {"[" * 100_000}\'}}',
    'table with a long name': f'gait: {{table: {"a" * 300}}}',
    'unknown tag': 'dt: !!nonsense 1',
    'alias of nothing': 'dt: *nothing',
}
LONGEST = 1000  # characters of a message, in which names of all keys or files may be


@pytest.mark.parametrize('name', HOSTILE)
@pytest.mark.parametrize('load', [load_scene, load_study, load_problem])
def test_hostile_files_are_refused_in_one_sentence(name, load, tmp_path):
    path = tmp_path / 'hostile.yaml'
    path.write_text(HOSTILE[name])
    begin = time.process_time()
    with pytest.raises(ParameterError) as caught:
        load(path)
    assert time.process_time() - begin < 2.0
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < LONGEST + 2 * len(str(path))


def test_a_bomb_takes_no_memory():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for text in (HOSTILE['bomb of aliases'], HOSTILE['bomb of merged keys']):
        with pytest.raises(ParameterError, match='more than 100000 values'):
            parse_yaml(text)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 100_000  # kB


def test_what_is_wrong_is_said():
    for text, sentence in (
        ('dt: !!int abc', "'abc' is no int"),
        ('soft_start: 2001-99-99', "'2001-99-99' is no timestamp"),
        ('[' * 3000, 'more than 30 levels'),
        ('&a [*a]', "alias 'a' is inside"),
        (' ' * (MOST_CHARACTERS + 1), 'more than 2500000 characters'),
    ):
        with pytest.raises(ParameterError, match=sentence):
            parse_yaml(text)


def test_aliases_of_small_things_are_read():
    assert parse_yaml('a: &a [1, 2]\nb: *a\nc: {<<: &c {d: 3}}\n') == {
        'a': [1, 2],
        'b': [1, 2],
        'c': {'d': 3},
    }


def test_a_scene_too_long_to_be_read_is_refused(tmp_path):
    path = tmp_path / 'long.yaml'
    path.write_text('#\n' * (MOST_CHARACTERS // 2 + 1))
    with pytest.raises(ParameterError, match='more than 2500000 characters'):
        load_scene(path)


def test_quoted_values_are_short():
    for value in ('x' * 10**6, [['y' * 1000] * 1000] * 1000, 10**5000, dict.fromkeys(range(1000))):
        assert len(quoted(value)) <= 80


def test_short_values_are_quoted_whole():
    for value in (1.5, 'text', [1, 2, 3], {'a': [None, True]}, (1.0,)):
        assert quoted(value) == repr(value)


@pytest.mark.parametrize(
    ('name', 'value'),
    [('dt', 1e-310), ('duration', 1e300), ('dt', 1e-13), ('gravity', (0.0, 0.0, -1e200))],
)
def test_numbers_of_which_nothing_can_be_computed_are_refused(name, value):
    with pytest.raises(ParameterError, match=f'{name} must be at (least|most)'):
        Scene(**{name: value})


def test_scenes_that_need_too_much_memory_are_refused():
    late = Robot(link_count=3, command_delay=10.0)
    with pytest.raises(ParameterError, match='command_delay must be at most 100000 steps'):
        Simulation(Scene(robot=late, dt=1e-7))
    with pytest.raises(ParameterError, match='needs more memory than there is for the 98905'):
        Simulation(Scene(robot=Robot(link_count=200), self_contact=True, method='bdf2'))
    for count in (10**13, 10**20):
        with pytest.raises(ParameterError, match=f'{count} samples need more memory'):
            make_samples(Scene(), 1, count)


@pytest.mark.parametrize(
    'urdf',
    [
        '<robot>' * 100_000,
        f'{"<a>" * 50_000}{"</a>" * 50_000}',
        robot_description(Robot(link_count=2)).replace('mass value="', 'mass value="x' * 1000),
        '<!DOCTYPE a [<!ENTITY a "aaaaaaaaaa">'
        + ''.join(f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in pairwise('abcdefghijk'))
        + ']><robot>&k;</robot>',
    ],
)
def test_hostile_descriptions_of_a_robot_are_refused(urdf):
    with pytest.raises(ParameterError) as caught:
        robot_of(urdf)
    assert len(str(caught.value)) < LONGEST


@pytest.mark.parametrize('size', [0.0, 1e-9, 1e-310, math.nan, math.inf])
def test_a_ground_of_too_many_cells_is_refused(size):
    corners = [SimpleNamespace(x=x, y=0.0, z=0.0) for x in (0.0, 1e3)]
    scale = SimpleNamespace(x=size, y=size, z=0.1)
    marker = SimpleNamespace(ns='scene', type=6, action=0, scale=scale, points=corners)
    with pytest.raises(ParameterError, match=r'at most 1000 by 1000 cells|cell must be'):
        scene_of(robot_description(Robot(link_count=2)), [marker])


@pytest.mark.parametrize('rate', [5e-324, 1e-310, 1e-30])
def test_periods_that_never_end_are_refused(rate):
    for name in ('control_rate', 'reference_rate'):
        with pytest.raises(ParameterError, match='period must be at most 9007199254740992 steps'):
            Simulation(Scene(robot=Robot(link_count=3, **{name: rate})))
    with pytest.raises(ParameterError, match='dt must divide the duration'):
        samples_of(Scene(duration=1 / 3 + rate), 100.0)
    with pytest.raises(
        ParameterError, match='sampling period must be at most 9007199254740992 steps'
    ):
        samples_of(Scene(), rate)
    with pytest.raises(ParameterError, match='sensor_rate must divide'):
        Sensors(sensor_rate=rate).states_in_sample(200.1)


@pytest.mark.parametrize('part', [None, 1, {}, 'aiko'])
def test_a_part_that_is_replaced_by_none_and_set_is_refused(part):
    with pytest.raises(ParameterError, match='robot must be a mapping of names to values'):
        with_settings(Scene(), {'robot': part, 'robot.link_count': 3})
