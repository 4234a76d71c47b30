# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Named gaits: the formulas of their sources, where they go, and how scenes name them."""

from dataclasses import replace
from itertools import permutations
import math

import numpy as np
import pytest
from scipy.optimize import brentq

from snake_sim_ros import (
    Concertina,
    EelLike,
    LateralUndulation,
    LinearProgression,
    load_scene,
    ParameterError,
    Robot,
    Rolling,
    RollingHelix,
    run,
    Scene,
    Sidewinding,
    study,
    TurnInPlace,
)
from snake_sim_ros.gaits.blending import Blend, check_limits, shortest_blend
from snake_sim_ros.scene import gait
from snake_sim_ros.scene.checked_records import flat_fields
from snake_sim_ros.scene.gait_library import GAITS, named_gait
from snake_sim_ros.scene.parameters import scene_from_text, scene_to_text, with_settings

A, OMEGA, WAVES = 0.3, 1.1, 1.3
SHAPE = {'amplitude': A, 'angular_frequency': OMEGA, 'soft_start': 0.0}
WAVY = {**SHAPE, 'waves': WAVES}
RADIUS, LENGTH = 0.0525, 0.122  # of a link of Aiko [m]


def formula(name, t, j, joints):
    """Return yaw and pitch of joint j = 1 to N as the sources print them [rad]."""
    wave = OMEGA * t - (j - 1) * 2 * math.pi * WAVES / joints
    if name == 'lateral_undulation':
        return A * math.sin(wave) + 0.05, 0.0
    if name == 'eel_like':
        n, from_tail = joints + 1, joints + 1 - j
        return (n - from_tail) / (n + 1) * A * math.sin(wave), 0.0
    if name == 'sidewinding':
        return A * math.sin(wave), -0.1 * math.cos(wave)
    if name == 'rolling':
        return A * math.sin(OMEGA * t), A * math.cos(OMEGA * t)
    if name == 'rolling_helix':
        return A * math.sin(wave), A * math.cos(wave)
    if name == 'linear_progression':
        return 0.0, A * math.sin(OMEGA * t + (j - 1) * 2 * math.pi * WAVES / joints)
    # A quarter of a cycle ahead at the first joint, half a cycle more at the last one.
    lead = math.pi / 2 + math.pi * (j - 1) / (joints - 1)
    return A * math.sin(wave), 0.1 * math.sin(wave + lead)


CASES = [
    LateralUndulation(**WAVY, offset=0.05), EelLike(**WAVY), Rolling(**SHAPE),
    RollingHelix(**WAVY), LinearProgression(**WAVY), TurnInPlace(**WAVY, lift=0.1),
    Sidewinding(**WAVY, lift=0.1, side='right'),
]  # fmt: skip


@pytest.mark.fast
@pytest.mark.parametrize('joints', [2, 10, 16])
@pytest.mark.parametrize('named', CASES, ids=[each.name for each in CASES])
def test_angles_are_those_of_the_formula(named, joints):
    for t in (0.0, 0.7, 9.3):
        angle, _ = gait.reference(named.gait(joints), t, joints)
        wanted = [formula(named.name, t, j, joints) for j in range(1, joints + 1)]
        assert angle == pytest.approx(np.array(wanted), abs=1e-13)


@pytest.mark.fast
def test_a_fold_is_closed_and_passes_to_both_sides():
    fold = Concertina(amplitude=0.6, width=6.0, period=2.0, soft_start=0.0)
    times = np.linspace(0.0, 2.0, 81)
    (there, _), (back, _) = (
        gait.reference(fold.gait(16), times + begin, 16) for begin in (0.0, 2.0)
    )
    assert there == pytest.approx(-back, abs=1e-12)
    assert there[0] == pytest.approx(np.zeros((16, 2)), abs=1e-12)
    # The center of the fold passes from behind the last joint to before the first one.
    center = 15 + 3.0 - times / 2.0 * (15 + 6.0)
    inside = (center > 3.0) & (center < 12.0)
    # Its angles add to 0: the trapezoidal rule is exact for three harmonics of one period.
    assert np.abs(there[inside, :, 0].sum(axis=1)).max() < 2e-3
    assert np.abs(there[:, :, 0]).max() == pytest.approx(0.6, abs=0.01)


@pytest.mark.fast
@pytest.mark.parametrize('names', list(permutations(GAITS, 2)), ids=' to '.join)
def test_blends_have_no_jump_and_keep_limits(names):
    robot = Robot()
    before, after = (replace(GAITS[name]().gait(10), soft_start=0.0) for name in names)
    for each in (before, after):
        check_limits(each, robot)
    duration = shortest_blend(robot)
    blend = Blend.of(before, 10, duration)
    changed = blend.changed(3.0, after)
    for old, new in zip(blend.reference(3.0), changed.reference(3.0), strict=True):
        assert old == pytest.approx(new, abs=1e-12)
    angle, rate = changed.reference(3.0 + np.linspace(0.0, duration, 100))
    assert (np.abs(angle) <= robot.joint_limit).all()
    assert (np.abs(rate) <= robot.joint_rate_limit).all()


SCENES = {'to the right': 'sidewinding', 'turn right': 'turn_in_place'}
OTHER = {'to the right': Sidewinding(side='right'), 'turn right': TurnInPlace(side='right')}


@pytest.fixture(scope='module')
def moved():
    """Return name -> way (m, 2) ahead and to the left [m] and turn (m,) [rad] in 12 s."""
    found = {}
    for name in (*GAITS, *OTHER):
        made = OTHER.get(name) or GAITS[name]()
        recorded = run(SCENES.get(name, name), gait=made, duration=12.0, dt=1e-3)
        center = recorded.position[:, :, :2].mean(axis=1)
        ahead = recorded.position[:, 0, :2] - recorded.position[:, -1, :2]
        turn = np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))
        found[name] = center[0] - center, turn - turn[0]  # The head is at -x.
    return found


def test_where_gaits_go(moved):
    for name in ('lateral_undulation', 'eel_like'):
        (ahead, left), turn = (each[-1] for each in moved[name])
        assert ahead > 0.5 and abs(left) < 0.2 * ahead and abs(turn) < 0.3, name
    for name, side in (('sidewinding', 1.0), ('to the right', -1.0)):
        ahead, left = moved[name][0][-1]
        assert side * left > 0.5 and abs(ahead) < 0.3 * abs(left), name
    for name, side in (('turn_in_place', 1.0), ('turn right', -1.0)):
        (ahead, left), turn = (each[-1] for each in moved[name])
        assert side * turn > 3.0 and math.hypot(ahead, left) < 0.2, name
    (ahead, _), turn = (each[-1] for each in moved['linear_progression'])
    assert ahead > 0.1 and abs(turn) < 0.3


def test_rolling_balances_the_slip_of_all_links(moved):
    # Link k of the arc rolls along its normal with the speed omega R; the robot moves sideways at
    # the speed at which the components of Coulomb's forces in that direction add to 0, with
    # equal loads: sum of (v - cos psi_k)/|(sin psi_k, v - cos psi_k)| = 0, v in units of omega R.
    way, psi = moved['rolling'][0], Rolling().amplitude * (np.arange(11) - 5)

    def balance(v):
        slip = v - np.cos(psi)
        return (slip / np.hypot(np.sin(psi), slip)).sum()

    ahead, left = way[-1] - way[len(way) // 3]  # once the arc is bent
    wanted = brentq(balance, 0.3, 1.2) * RADIUS * Rolling().angular_frequency * 8.0
    # Loads differ, since the ends of the arc are lifted in turn: 1 to 2 % of the speed.
    assert -left == pytest.approx(wanted, rel=0.02)
    assert abs(ahead) < 0.05 * wanted


def test_concertina_advances_by_what_the_fold_shortens():
    fold = Concertina(amplitude=0.6, width=6.0, period=2.0, soft_start=0.0)
    scene = load_scene('concertina')
    recorded = run(scene, gait=fold, duration=8.0, dt=1e-3)
    ahead = -(recorded.position[-1, :, 0] - recorded.position[0, :, 0])
    # The fold in the middle of the body: headings of the links are sums of the angles.
    angle, _ = gait.reference(fold.gait(10), 1.0, 10)
    heading = np.concatenate([[0.0], np.cumsum(angle[:, 0])])
    shortened = LENGTH * (1.0 - np.cos(heading)).sum()
    # Links at rest creep back while less than half of the weight is drawn: up to a tenth.
    assert ahead.mean() / 4 == pytest.approx(shortened, rel=0.1)


@pytest.mark.fast
def test_scenes_name_gaits():
    scene = scene_from_text('gait: {name: rolling, amplitude_deg: 20, soft_start: 1.0}')
    assert scene.gait == Rolling(amplitude=math.radians(20), soft_start=1.0).gait(10)
    assert scene_from_text(scene_to_text(scene)) == scene
    short = scene_from_text('{robot: {link_count: 5}, gait: {name: eel_like}}')
    assert short.gait == EelLike().gait(4)
    settings = {'gait.name': 'rolling', 'gait.amplitude_deg': 20, 'robot.link_count': 5}
    changed = with_settings(Scene(), settings)
    assert changed.gait == Rolling(amplitude=math.radians(20)).gait(4)
    assert with_settings(Scene(), {'gait': TurnInPlace()}).gait == TurnInPlace().gait(10)
    for name in GAITS:
        if name not in ('lateral_undulation', 'sidewinding'):  # Cases A and C of the paper.
            assert load_scene(name).gait == GAITS[name]().gait(10)


@pytest.mark.fast
@pytest.mark.parametrize(
    ('text', 'sentence'),
    [
        ('{name: roling}', "scene: gait.name: unknown gait 'roling'; did you mean 'rolling'?"),
        ('{name: 7}', 'scene: gait.name: unknown gait 7; choose from: concertina'),
        (
            '{name: rolling, waves: 1}',
            "scene: gait rolling: unknown key 'waves'; choose from: amplitude",
        ),
        ('{name: rolling, yaw: {}}', "scene: gait rolling: unknown key 'yaw'"),
        (
            '{name: concertina, width: 1}',
            'scene: gait concertina: width must be at least 3, got 1',
        ),
        (
            '{name: rolling, amplitude: .nan}',
            'scene: gait rolling: amplitude must be finite, got nan rad',
        ),
        (
            '{name: sidewinding, side: up}',
            "scene: gait sidewinding: side must be one of left, right; got 'up'",
        ),
    ],
)  # fmt: skip
def test_gaits_that_are_none_are_one_sentence(text, sentence):
    with pytest.raises(ParameterError) as caught:
        scene_from_text(f'gait: {text}')
    assert str(caught.value).startswith(sentence)


def test_parameters_of_a_named_gait_are_values_of_its_scene():
    scene = load_scene('eel_like')
    by_name = with_settings(scene, {'gait.name': 'eel_like', 'gait.waves': 1.0})
    changed = with_settings(scene, {'gait.waves': 1.0, 'duration': 3.0})
    assert changed.gait == by_name.gait
    assert changed.gait != scene.gait
    assert changed.duration == 3.0
    again = with_settings(changed, {'gait.amplitude_deg': 20})
    both = {'gait.name': 'eel_like', 'gait.waves': 1.0, 'gait.amplitude_deg': 20}
    assert again.gait == with_settings(scene, both).gait
    assert with_settings(scene, {'gait.soft_start': 1.0}).gait.soft_start == 1.0
    fewer = with_settings(scene, {'gait.waves': 1.0, 'robot.link_count': 6})
    assert fewer.gait == named_gait({'name': 'eel_like', 'waves': 1.0}, 5)


def test_a_gait_whose_waves_changed_has_no_name_any_more():
    scene = with_settings(load_scene('eel_like'), {'gait.yaw.amplitude': 0.3})
    with pytest.raises(ParameterError, match=r"unknown name 'gait\.waves'"):
        with_settings(scene, {'gait.waves': 1.0})
    with pytest.raises(ParameterError, match=r'gait\.waves is of gait eel_like: its waves'):
        with_settings(load_scene('eel_like'), {'gait.waves': 1.0, 'gait.yaw.amplitude': 0.3})


def test_a_study_varies_parameters_of_a_named_gait():
    table = study('eel_like', {'gait.waves': [1.0, 1.4]}, ['distance'], set={'duration': 1.0})
    single = [
        run('eel_like', duration=1.0, gait={'name': 'eel_like', 'waves': waves}).distance
        for waves in (1.0, 1.4)
    ]
    assert table['distance'].to_list() == pytest.approx(single, rel=1e-9)
    assert single[0] != single[1]


def test_all_values_of_a_named_gait_as_a_node_has_them_are_its_waves():
    scene = load_scene('rolling')
    values = flat_fields(scene.gait, 'gait.').items()
    given = {name: value for name, (value, _) in values if '.table.' not in name}
    assert with_settings(scene, given).gait == scene.gait
