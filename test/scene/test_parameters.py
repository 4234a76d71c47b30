# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every value of a scene is checked; what is refused is named in one sentence."""

from dataclasses import fields, FrozenInstanceError, is_dataclass
import math

import numpy as np
import pytest

from snake_sim_ros import Friction, Gait, Ground, ParameterError, Pegs, Robot, Scene, Solver, Wave
from snake_sim_ros.scene.checked_records import from_mapping
from snake_sim_ros.scene.parameters import with_settings

pytestmark = pytest.mark.fast

FIELDS = [
    (record, item)
    for record in (Robot, Friction, Ground, Pegs, Wave, Gait, Solver, Scene)
    for item in fields(record)
]


def fields_of(*kinds):
    """Return record and field of every field whose default is of one of the given types."""
    found = [(record, item) for record, item in FIELDS if type(item.default) in kinds]
    assert found
    return found


def refusal(function, *arguments, **keywords):
    """Return the one sentence with which something is refused."""
    with pytest.raises(ParameterError) as caught:
        function(*arguments, **keywords)
        pytest.fail(f'{function} takes {arguments} {keywords}')
    message = str(caught.value)
    assert '\n' not in message
    return message


def with_unit(item, number):
    unit = item.metadata['unit']
    return number if unit == '1' else f'{number} {unit}'


# ---- values -----------------------------------------------------------------------------------


def test_every_field_has_unit_and_meaning():
    for _, item in FIELDS:
        if not is_dataclass(item.default):
            assert {'unit', 'meaning'} <= item.metadata.keys()


def test_numbers_must_be_finite():
    for record, item in fields_of(float):
        for value in (math.nan, math.inf, -math.inf):
            expected = f'{item.name} must be finite, got {with_unit(item, value)}'
            assert refusal(record, **{item.name: value}) == expected, record


def test_numbers_are_not_made_of_other_things():
    for record, item in fields_of(float):
        for value in ('0.1', True, None, {'value': 0.1}, np.True_):
            expected = f'{item.name} must be a number, got {value!r}'
            assert refusal(record, **{item.name: value}) == expected, record


def test_counts_must_be_whole_numbers():
    for record, item in fields_of(int):
        for value in (math.nan, math.inf, 2.5, '3', True, None, [3]):
            expected = f'{item.name} must be a whole number, got {value!r}'
            assert refusal(record, **{item.name: value}) == expected, record


def test_numbers_must_be_in_their_range():
    for record, item in fields_of(float, int):
        limits = item.metadata
        whole = isinstance(item.default, int)
        if math.isfinite(limits['above']):
            for value in (limits['above'], limits['above'] - 1):
                bound = f'above {limits["above"]:g}'
                expected = f'must be {with_unit(item, bound)}, got {with_unit(item, f"{value:g}")}'
                assert refusal(record, **{item.name: value}) == f'{item.name} {expected}', record
        for limit, sign, word in (('minimum', -1, 'at least'), ('maximum', 1, 'at most')):
            edge = limits[limit]
            if math.isfinite(edge):
                assert getattr(record(**{item.name: edge}), item.name) == edge, record
                value = edge + sign * (1 if whole else 0.25)
                if value <= limits['above']:
                    value = (limits['above'] + edge) / 2
                bound = f'{word} {edge:g}'
                expected = f'must be {with_unit(item, bound)}, got {with_unit(item, f"{value:g}")}'
                assert refusal(record, **{item.name: value}) == f'{item.name} {expected}', record


def test_signs_of_lengths_masses_and_gains_are_checked():
    # Guards the table that the test above runs on.
    assert 'must be above 0 kg' in refusal(Robot, link_mass=0)
    assert 'must be at least 0' in refusal(Friction, transversal=-0.1)
    assert 'must be at most 0.1 s' in refusal(Scene, dt=0.2)
    assert 'must be at most 200' in refusal(Robot, link_count=201)
    assert 'got 6: their number is link_count' in refusal(Robot, links=6)


def test_texts_must_be_texts():
    for record, item in fields_of(str):
        check_text(record, item)


def check_text(record, item):
    for value in (3, None, ['paper']):
        assert refusal(record, **{item.name: value}) == f'{item.name} must be text, got {value!r}'
    if item.metadata['choices']:
        choices = ', '.join(item.metadata['choices'])
        expected = f"{item.name} must be one of {choices}; got 'midpont'"
        assert refusal(record, **{item.name: 'midpont'}) == expected


def test_records_are_made_of_records():
    for record, item in fields_of(Robot, Friction, Ground, Pegs, Wave, Gait, Solver):
        expected = f'{item.name} must be a mapping of names to values, got 0.2'
        assert refusal(record, **{item.name: 0.2}) == expected, record


@pytest.mark.parametrize(
    ('value', 'expected'),
    [
        ((0.0, -9.81), 'gravity must have 3 components, got 2'),
        ((0.0, 0.0, math.nan), 'gravity must be finite, got nan m/s^2'),
        ((0.0, 0.0, 'down'), "gravity must be a number, got 'down'"),
        (9.81, 'gravity must be numbers, got 9.81'),
        ('down', "gravity must be numbers, got 'down'"),
    ],
)
def test_gravity_is_a_vector(value, expected):
    assert refusal(Scene, gravity=value) == expected


def test_a_number_too_large_for_floating_point_is_refused():
    assert refusal(Scene, duration=10**400).startswith('duration must be')


PER_LINK = [
    'link_length',
    'link_mass',
    'inertia_transversal',
    'inertia_axial',
    'contact_offset',
    'contact_radius',
]


@pytest.mark.parametrize('name', PER_LINK)
def test_per_link_lists(name):
    values = [0.1, 0.2, 0.3]
    for sequence in (values, tuple(values), np.array(values)):
        robot = Robot(link_count=3, **{name: sequence})
        assert getattr(robot, name) == (0.1, 0.2, 0.3)
        assert robot.per_link(name).tolist() == values
    for length in (0, 2, 4):
        message = refusal(Robot, link_count=3, **{name: [0.1] * length})
        expected = f'one number or one for each of the 3 links, got {length} numbers'
        assert message == f'{name} must be {expected}'
    # Every entry is checked like a single number.
    assert refusal(Robot, link_count=3, **{name: [0.1, math.inf, 0.1]}).startswith(
        f'{name} must be finite, got inf'
    )
    assert refusal(Robot, link_count=3, **{name: [0.1, -1, 0.1]}).startswith(f'{name} must be a')
    assert refusal(Robot, link_count=3, **{name: [0.1, 'x', 0.1]}) == (
        f"{name} must be a number, got 'x'"
    )


GAINS = ['yaw_stiffness', 'yaw_damping', 'pitch_stiffness', 'pitch_damping']


@pytest.mark.parametrize('name', GAINS)
def test_per_joint_lists(name):
    values, (axis, kind) = [10.0, 20.0], name.split('_')
    for sequence in (values, tuple(values), np.array(values)):
        robot = Robot(link_count=3, **{name: sequence})
        assert getattr(robot, name) == (10.0, 20.0)
        gains, column = robot.per_joint(kind), ('yaw', 'pitch').index(axis)
        assert gains[:, column].tolist() == values
        assert (
            gains[:, 1 - column].tolist()
            == Robot(link_count=3).per_joint(kind)[:, 1 - column].tolist()
        )
    for length in (0, 1, 3):
        message = refusal(Robot, link_count=3, **{name: [1.0] * length})
        expected = f'one number or one for each of the 2 joints, got {length} numbers'
        assert message == f'{name} must be {expected}'
    assert refusal(Robot, link_count=3, **{name: [1.0, -1.0]}).startswith(
        f'{name} must be at least 0 N m'
    )


def test_one_gain_is_for_all_joints():
    assert Robot(link_count=3).per_joint('stiffness').tolist() == [[40.0, 800.0]] * 2
    assert Robot(link_count=3).per_joint('damping').tolist() == [[0.2, 0.2]] * 2
    assert Robot(link_count=1).per_joint('stiffness').shape == (0, 2)


def test_consistent_inertia_is_that_of_a_uniform_cylinder():
    # Integrals of the density m/(pi r^2 L) in cylinder coordinates: r^2/2 along the axis, and
    # across it r^2/4 of the disc and L^2/12 of the rod, times m.
    lengths, masses, radii = (0.1, 0.122, 0.3), (1.0, 7.5 / 11, 2.0), (0.05, 0.0525, 0.1)
    robot = Robot(
        link_count=3, inertia='consistent',
        link_length=lengths, link_mass=masses, contact_radius=radii,
    )  # fmt: skip
    for i, (L, m, r) in enumerate(zip(lengths, masses, radii, strict=True)):
        across, along = m * (r**2 / 4 + L**2 / 12), m * r**2 / 2
        assert robot.per_link('inertia_transversal')[i] == pytest.approx(across, rel=1e-15)
        assert robot.per_link('inertia_axial')[i] == pytest.approx(along, rel=1e-15)
    aiko = Robot(inertia='consistent')
    assert aiko.per_link('inertia_transversal') == pytest.approx([1.3155e-3] * 11, rel=5e-5)
    assert aiko.per_link('inertia_axial') == pytest.approx([9.3963e-4] * 11, rel=5e-5)


def test_printed_inertia_is_taken_as_given():
    robot = Robot(link_count=2, inertia_transversal=(1e-3, 2e-3), inertia_axial=3e-4)
    assert robot.per_link('inertia_transversal').tolist() == [1e-3, 2e-3]
    assert robot.per_link('inertia_axial').tolist() == [3e-4, 3e-4]


def test_a_cylinder_has_a_radius():
    for radius in (0.0, 1e-170, 1e-9):  # m, of whose inertias the first two are 0
        robot = {'link_count': 2, 'inertia': 'consistent', 'contact_radius': (0.05, radius)}
        assert refusal(Robot, **robot) == (
            'contact_radius must make the inertia of a cylinder (consistent) at least 1e-18 '
            f'kg m^2, got {radius:g} m'
        )
    assert Robot(link_count=1, contact_radius=0.0).per_link('inertia_axial') == [2.35e-4]


def test_one_number_is_for_all_links():
    assert Robot(link_count=4).per_link('link_mass').tolist() == [7.5 / 11] * 4
    assert Robot().middle_link == 5
    assert Robot(link_count=6).middle_link == 3
    assert Robot(link_count=1).middle_link == 0


def test_records_are_frozen():
    for record, item in fields_of(float, int, str, tuple, Robot, Gait):
        with pytest.raises(FrozenInstanceError):
            setattr(record(), item.name, item.default)
            pytest.fail(f'{record.__name__}.{item.name} is not frozen')


def test_numbers_of_other_types_are_converted():
    assert Robot(link_count=3.0).link_count == 3
    scene = Scene(dt=np.float32(0.25) / 256, gravity=[0, 0, -1], duration=2)
    assert (scene.dt, scene.gravity, scene.duration) == (2.0**-10, (0.0, 0.0, -1.0), 2.0)
    assert {type(scene.dt), type(scene.gravity[0]), type(scene.duration)} == {float}


# ---- names ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ('mapping', 'where', 'wrong', 'right'),
    [
        ({'frictoin': {}}, 'scene', 'frictoin', 'friction'),
        ({'robot': {'link_lenght': 1}}, 'scene: robot', 'link_lenght', 'link_length'),
        ({'friction': {'longitudnal': 1}}, 'scene: friction', 'longitudnal', 'longitudinal'),
        ({'gait': {'soft_strat': 1}}, 'scene: gait', 'soft_strat', 'soft_start'),
        ({'gait': {'yaw': {'amplitud': 1}}}, 'scene: gait: yaw', 'amplitud', 'amplitude'),
        ({'gait': {'pitch': {'ofset_deg': 1}}}, 'scene: gait: pitch', 'ofset_deg', 'offset'),
        ({'solver': {'tolerence': 1}}, 'scene: solver', 'tolerence', 'tolerance'),
    ],
)
def test_misspelt_keys_name_the_nearest(mapping, where, wrong, right):
    expected = f'{where}: unknown key {wrong!r}; did you mean {right!r}?'
    assert refusal(from_mapping, Scene, mapping, 'scene') == expected


def test_keys_like_none_name_all():
    message = refusal(from_mapping, Friction, {'x': 1}, 'friction')
    assert message == (
        "friction: unknown key 'x'; choose from: backward, kinetic_ratio, longitudinal, rolling, "
        'stribeck_speed, transversal, viscous_longitudinal, viscous_transversal'
    )
    assert refusal(from_mapping, Scene, {7: 1}, 'scene').startswith(
        'scene: unknown key 7; choose '
    )


def test_errors_name_file_and_place():
    message = refusal(from_mapping, Scene, {'gait': {'yaw': {'amplitude': math.nan}}}, 'my.yaml')
    assert message == 'my.yaml: gait: yaw: amplitude must be finite, got nan rad'
    message = refusal(from_mapping, Scene, {'solver': [1]}, 'my.yaml')
    assert message == 'my.yaml: solver must be a mapping of names to values, got [1]'


def test_degrees():
    keys = {'amplitude_deg': 30, 'angular_frequency_deg': 80.0, 'phase_lag_deg': -50, 'offset': 1}
    wave = from_mapping(Wave, keys, 'wave')
    # 180 deg = pi rad
    expected = Wave(
        amplitude=math.radians(30),
        angular_frequency=math.radians(80),
        phase_lag=math.radians(-50),
        offset=1.0,
    )
    assert wave == expected
    assert from_mapping(Robot, {'joint_limit_deg': 90}, 'robot').joint_limit == math.pi / 2
    message = refusal(from_mapping, Wave, {'amplitude_deg': 'large'}, 'wave')
    assert message.endswith("amplitude_deg must be a number, got 'large'")


@pytest.mark.parametrize(
    ('record', 'name'),
    [
        (Scene, 'dt'),
        (Scene, 'gravity'),
        (Scene, 'method'),
        (Gait, 'soft_start'),
        (Robot, 'link_mass'),
        (Robot, 'yaw_stiffness'),
        (Friction, 'rolling'),
    ],
)
def test_degrees_are_for_angles(record, name):
    message = refusal(from_mapping, record, {f'{name}_deg': 1}, 'here')
    assert message == f'here: {name}_deg: {name} is not an angle'


@pytest.mark.parametrize('name', ['robot', 'friction', 'gait', 'solver'])
def test_groups_are_not_in_degrees(name):
    assert f'{name}_deg' in refusal(from_mapping, Scene, {f'{name}_deg': {}}, 'scene')


def test_a_value_is_given_once():
    for keys in (('amplitude', 'amplitude_deg'), ('amplitude_deg', 'amplitude')):
        message = refusal(from_mapping, Wave, dict.fromkeys(keys, 1), 'wave')
        assert message == 'wave: amplitude is given twice, as amplitude and as amplitude_deg'


# ---- settings ---------------------------------------------------------------------------------


def test_settings_replace_values():
    settings = {
        'dt': 1e-3,
        'friction.longitudinal': 0.3,
        'friction.rolling': 0.01,
        'gait.yaw.amplitude': 0.4,
        'robot.link_count': 3,
        'robot.link_mass': [1, 2, 3],
    }
    scene = with_settings(Scene(), settings)
    expected = Scene(
        dt=1e-3,
        friction=Friction(longitudinal=0.3, rolling=0.01),
        gait=Gait(yaw=Wave(amplitude=0.4)),
        robot=Robot(link_count=3, link_mass=(1.0, 2.0, 3.0)),
    )
    assert scene == expected
    assert with_settings(scene, {}) == scene


def test_angles_may_be_set_in_degrees_as_in_files():
    scene = with_settings(Scene(), {'gait.yaw.amplitude_deg': 30, 'robot.joint_limit_deg': 60})
    assert scene.gait.yaw.amplitude == math.radians(30)
    assert scene.robot.joint_limit == math.radians(60)
    twice = {'gait.yaw.phase': 0.1, 'gait.yaw.phase_deg': 10}
    expected = 'gait.yaw.phase is given twice, as phase and as phase_deg'
    assert refusal(with_settings, Scene(), twice) == expected


@pytest.mark.parametrize(
    ('name', 'value', 'expected'),
    [
        ('tolerance', 1, "unknown name 'tolerance'; choose from: "),
        ('fricton.rolling', 1, "unknown name 'fricton'; did you mean 'friction'?"),
        ('friction.roling', 1, "unknown name 'friction.roling'; did you mean 'rolling'?"),
        ('gait.yow.phase', 1, "unknown name 'gait.yow'; did you mean 'yaw'?"),
        ('gait.yaw.fase', 1, "unknown name 'gait.yaw.fase'; did you mean 'phase'?"),
        ('dt.fine', 1, 'dt is a value, it has no parts'),
        ('friction.rolling.x', 1, 'friction.rolling is a value, it has no parts'),
        ('friction.rolling', -1, 'friction.rolling must be at least 0, got -1'),
        ('gait.yaw.phase', math.inf, 'gait.yaw.phase must be finite, got inf rad'),
        ('dt', 'fast', "dt must be a number, got 'fast'"),
        ('gait.yaw.phase_deg', 'half', "phase_deg must be a number, got 'half'"),
        ('gait.yaw.fase_deg', 1, "unknown name 'gait.yaw.fase_deg'; did you mean 'phase'?"),
        ('dt_deg', 1, 'dt_deg: dt is not an angle'),
    ],
)
def test_settings_that_are_refused(name, value, expected):
    assert refusal(with_settings, Scene(), {name: value}).startswith(expected)
