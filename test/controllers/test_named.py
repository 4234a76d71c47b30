# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Controllers by name: in scenes, in files, in studies; and what is refused."""

import numpy as np
import pytest

from snake_sim_ros import CentralPatternGenerator, ParameterError, run
from snake_sim_ros.controllers.named import controller_of
from snake_sim_ros.scene.checked_records import NamedRecord
from snake_sim_ros.scene.parameters import (
    load_scene,
    scene_from_text,
    scene_to_text,
    with_settings,
)
from snake_sim_ros.studies.variations import check_names

OWN = """
import numpy as np

class Bent:
    sees_poses = False

    def __init__(self, angle=0.1, period=0.05):
        self.angle, self.period = angle, period

    def start(self, scene):
        self.joints = scene.robot.link_count - 1

    def control(self, measured, time):
        return lambda t: (np.full((len(t), self.joints, 2), self.angle),
                          np.zeros((len(t), self.joints, 2)))

class Half:
    period = 1.0

NUMBER = 3
"""


def named(**values):
    return with_settings(load_scene('lateral_undulation'), values)


def test_named_controller_has_the_bits_of_its_object():
    by_name = run(
        'lateral_undulation', controller={'name': 'oscillators', 'coupling': 5}, duration=0.5
    )
    by_object = run(
        'lateral_undulation', controller=CentralPatternGenerator(coupling=5), duration=0.5
    )
    assert (by_name.position == by_object.position).all()


def test_scene_keeps_its_controller():
    scene = named(**{'controller.name': 'oscillators', 'controller.coupling': 5.0})
    assert scene_from_text(scene_to_text(scene)) == scene
    changed = with_settings(scene, {'controller.gain': 3})
    assert changed.controller.values == (('coupling', 5.0), ('gain', 3))
    assert controller_of(changed).coupling == 5.0
    assert controller_of(changed).gain == 3
    assert with_settings(scene, {'controller.name': 'gait'}).controller == NamedRecord(name='gait')
    check_names(scene, ['controller.coupling'], 'vary')  # a study may vary it


def test_gait_alone_is_a_choice_where_there_is_a_path():
    assert controller_of(named(**{'follow.center': [0.0, -1.0], 'controller': 'gait'})) is None
    assert controller_of(named(**{'follow.center': [0.0, -1.0]})).period == 0.1
    assert controller_of(named()) is None


def test_file_beside_a_scene_has_the_controller(tmp_path):
    (tmp_path / 'own.py').write_text(OWN)
    (tmp_path / 'scene.yaml').write_text(
        'controller: {name: own.py:Bent, angle: 0.2}\nduration: 0.5\n'
    )
    bent = run(tmp_path / 'scene.yaml')
    assert bent.scene.controller.name == f'{tmp_path / "own.py"}:Bent'
    assert np.mean(bent.joint_angle[-1]) == pytest.approx(0.2, abs=0.05)


@pytest.mark.parametrize(
    ('settings', 'message'),
    [
        ({'controller.name': 'oscilators'}, "unknown controller 'oscilators'; did you mean 'osc"),
        ({'controller.gain': 3}, 'controller: gain needs a name beside it'),
        ({'controller': 3}, 'controller must be a name, or a mapping with a name, got 3'),
        ({'controller': ''.join('os:path')}, 'controller os:path must be a class or a function'),
        ({'controller': 'nowhere:Name'}, 'cannot be imported: ModuleNotFoundError: No module nam'),
        ({'controller': 'nowhere.py:Name'}, 'cannot be imported: FileNotFoundError'),
        ({'controller': '{own}:Nobody'}, 'cannot be imported: AttributeError'),
        ({'controller': '{own}:NUMBER'}, 'must be a class or a function, got a int'),
        ({'controller': '{own}:Half'}, 'must have period, sees_poses, start and control, got a H'),
        ({'controller': {'name': '{own}:Bent', 'bend': 1}}, 'takes angle, period; got bend: '),
        ({'controller': {'name': 'oscillators', 'gain': -1}}, 'oscillators: gain must be above 0'),
        ({'controller': {'name': 'gait', 'gain': 1}}, 'controller gait has no values, got gain'),
        ({'controller': {'name': 'oscillators', 'a b': 1}}, 'names of values must be words, got'),
        ({'controller': {'name': 'oscillators', 'gain': float('nan')}}, 'gain must be finite'),
        ({'controller': {'name': 'oscillators', 'gain': {}}}, 'gain must be a number, got {}'),
    ],
)
def test_what_is_no_controller_is_refused(tmp_path, settings, message):
    (tmp_path / 'own.py').write_text(OWN)
    own = str(tmp_path / 'own.py')

    def placed(value):
        if isinstance(value, dict):
            return {key: placed(each) for key, each in value.items()}
        return value.replace('{own}', own) if isinstance(value, str) else value

    with pytest.raises(ParameterError) as error:
        controller_of(named(**placed(settings)))
    assert message in str(error.value)
