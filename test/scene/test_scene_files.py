# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Scenes as files: those that come with the package, round trips, and files that are refused."""

import math

import pytest
import yaml

from snake_sim_ros import Friction, Gait, ParameterError, Robot, Scene, Solver, Wave
from snake_sim_ros.scene.checked_records import flat_fields, from_mapping
from snake_sim_ros.scene.files import CONFIG
from snake_sim_ros.scene.parameters import load_scene, scene_from_text, scene_to_text

pytestmark = pytest.mark.fast

ROBOTS = ('aiko', 'reu', 'rsnake', 'scaled_snake', 'sea', 'slender')
SCENES = sorted(path.stem for path in CONFIG.glob('*.yaml') if path.stem not in ROBOTS)
CASES = ('lateral_undulation', 'lateral_undulation_isotropic', 'sidewinding', 'sinus_lifting')


def refusal(path):
    """Return the one sentence with which a file is refused."""
    with pytest.raises(ParameterError) as caught:
        load_scene(path)
    message = str(caught.value)
    assert '\n' not in message
    return message


@pytest.fixture
def written(tmp_path):
    """Return a function that writes a scene file and returns its path."""

    def write(text, name='scene.yaml'):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


# ---- the scenes that come with the package ------------------------------------------------------


def test_all_cases_are_there():
    assert set(CASES) <= set(SCENES)


@pytest.mark.parametrize('name', SCENES)
def test_scenes_load_by_name_and_by_file(name):
    scene = load_scene(name)
    assert scene == load_scene(f'{name}.yaml') == load_scene(CONFIG / f'{name}.yaml')
    assert scene.duration == 15.0
    if name in CASES:
        assert scene.robot == Robot()


def mapping_of(robot):
    return yaml.safe_load((CONFIG / f'{robot}.yaml').read_text(encoding='utf-8'))


def test_aiko_is_the_default_robot():
    mapping = mapping_of('aiko')
    assert from_mapping(Robot, mapping, 'aiko.yaml') == Robot()
    # Nothing is left to a default: the file says it all, angles in degrees or radians.
    names = {key.removesuffix('_deg') for key in mapping}
    assert names == set(flat_fields(Robot())) - {'links', 'joints', 'up'}


def test_paper_values():
    robot, scene, a = Robot(), Scene(), load_scene('lateral_undulation')
    # Section VIII-A: 11 links, 7.5 kg, N = 4000 steps a second; A_h = 30 deg, omega_h = 80 deg/s,
    # delta_h = -50 deg and mu = 0.1, 0.5 in VIII-B.
    assert robot.link_count * robot.link_mass == pytest.approx(7.5, rel=1e-15)
    assert scene.dt * 4000 == 1.0
    assert (scene.gravity, a.friction) == (
        (0, 0, -9.81),
        Friction(longitudinal=0.1, transversal=0.5),
    )
    yaw = Wave(
        amplitude=math.radians(30),
        angular_frequency=math.radians(80),
        phase_lag=math.radians(-50),
    )
    assert a.gait == Gait(yaw=yaw)
    assert load_scene('lateral_undulation_isotropic').gait == a.gait
    assert load_scene('sidewinding').gait.yaw == yaw


# ---- round trip ---------------------------------------------------------------------------------


@pytest.mark.parametrize('name', SCENES)
def test_text_round_trip(name):
    scene = load_scene(name)
    assert scene_from_text(scene_to_text(scene)) == scene


def test_text_round_trip_of_unusual_numbers():
    scene = Scene(
        robot=Robot(link_count=2, link_mass=(0.1, 1 / 3), joint_limit=1e-300),
        gait=Gait(pitch=Wave(phase=-1e22, offset=5e-324)),
        solver=Solver(tolerance=1e-17, iteration_limit=10**9),
        gravity=(0.1 + 0.2, -0.0, 1e5),
        pd_scheme='end',
    )
    assert scene_from_text(scene_to_text(scene)) == scene


def test_text_leaves_nothing_to_a_default():
    def names(mapping, prefix=''):
        for key, value in mapping.items():
            if isinstance(value, dict):
                yield from names(value, f'{prefix}{key}.')
            else:
                yield prefix + key

    assert set(names(yaml.safe_load(scene_to_text(Scene())))) == set(flat_fields(Scene()))


def test_flat_fields_name_value_and_unit():
    flat = flat_fields(Scene(gait=Gait(yaw=Wave(amplitude=0.4))))
    value, about = flat['gait.yaw.amplitude']
    assert (value, about['unit'], about['meaning']) == (0.4, 'rad', 'amplitude A')
    assert flat['dt'][0] == Scene().dt


# ---- files of one's own -------------------------------------------------------------------------


def test_a_file_with_a_robot_of_its_own(written):
    path = written('robot: {link_count: 3, link_mass: [1, 2, 3]}\ndt: 0.001\nfriction:\n')
    expected = Scene(robot=Robot(link_count=3, link_mass=(1.0, 2.0, 3.0)), dt=0.001)
    assert (
        load_scene(path) == load_scene(str(path)) == load_scene(path.with_suffix('')) == expected
    )


def test_a_robot_file_beside_the_scene(written):
    written('link_count: 4', 'mine.yaml')
    assert load_scene(written('robot: mine.yaml')).robot == Robot(link_count=4)
    assert load_scene(written('robot: mine')).robot == Robot(link_count=4)


def test_a_robot_file_in_a_folder_beside_the_scene(written):
    written('link_count: 4', 'robots/mine.yaml')
    assert load_scene(written('robot: robots/mine.yaml')).robot == Robot(link_count=4)


def test_a_scene_does_not_depend_on_the_working_directory(written, monkeypatch):
    # A robot of the same name where the program happens to be started is another robot.
    monkeypatch.chdir(written('link_count: 4', 'elsewhere/aiko.yaml').parent)
    assert load_scene('sidewinding').robot == Robot()


def test_missing_files_are_refused(tmp_path):
    for path in ('sidewindig', tmp_path / 'scene.yaml', tmp_path, ''):
        message = refusal(path)
        assert message.startswith(f'no file {path}; ')
        assert all(name in message for name in SCENES)


def test_a_missing_file_is_not_replaced_by_a_scene_of_the_package(tmp_path):
    path = tmp_path / 'sidewinding.yaml'
    assert refusal(path).startswith(f'no file {path}; ')


def test_a_missing_robot_is_refused(written):
    assert refusal(written('robot: aika')) == (
        "scene.yaml: robot: no file aika; did you mean 'aiko'? the robots that come with the "
        f'package: {", ".join(ROBOTS)}'
    )


def test_scenes_that_a_message_names_are_no_robots():
    assert refusal('nowhere').endswith(
        f'the scenes that come with the package: {", ".join(SCENES)}'
    )


@pytest.mark.parametrize('text', ['gait: [30', 'dt: 0.001\n\tx: 1', b'dt: \xff', '? {a: 1}\n: 2'])
def test_unreadable_files_are_refused(written, text):
    path = written(text)
    assert refusal(path).startswith(f'{path}: not readable as YAML: ')


@pytest.mark.parametrize(
    ('text', 'value'), [('', None), ('# nothing\n', None), ('- dt\n', ['dt']), ('dt', 'dt')]
)
def test_files_without_names_are_refused(written, text, value):
    path = written(text)
    assert refusal(path) == f'{path}: must be a mapping of names to values, got {value!r}'


@pytest.mark.parametrize(
    ('text', 'expected'),
    [
        ('frictoin: {}', "scene.yaml: unknown key 'frictoin'; did you mean 'friction'?"),
        ('dt: 0', 'scene.yaml: dt must be above 0 s, got 0 s'),
        ('dt: .nan', 'scene.yaml: dt must be finite, got nan s'),
        ('robot: {link_mass: [1]}', 'scene.yaml: robot: link_mass must be one number or one for '),
        ('gait: {yaw: {phase_deg: 1, phase: 1}}', 'scene.yaml: gait: yaw: phase is given twice'),
        ('robot: 11', 'scene.yaml: robot must be a mapping of names to values, got 11'),
    ],
)
def test_errors_name_the_file(written, text, expected):
    assert refusal(written(text)).startswith(expected)


def test_a_key_is_written_once(written):
    # YAML itself demands it; which of the two was meant nobody can know.
    assert 'dt' in refusal(written('dt: 0.001\nduration: 1.0\ndt: 0.002\n'))
