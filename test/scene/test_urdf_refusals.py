# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files that are no URDF of a robot: each is refused with one sentence that says why."""

from xml.etree import ElementTree

import numpy as np
import pytest
from urdf_texts import FINE, fixed, HUGE, joint, link, MESH, refusal, shape, SPHERE, urdf

from snake_sim_ros import ParameterError, Robot
from snake_sim_ros.scene.urdf import robot_of_urdf

pytestmark = pytest.mark.fast

GOOD = urdf(
    link('a', shapes=shape('<cylinder radius="0.05" length="0.2"/>')),
    link('b', shapes=shape('<box size="0.1 0.1 0.1"/>') + shape()),
    link('c', shapes=shape(MESH.format('m.stl'), kind='visual')),
    link('d'),
    joint('j', 'a', 'b', more='<dynamics friction="0" damping="0"/>'),
    joint('k', 'b', 'c'),
    fixed('c', 'd'),
)
ENDS = '<parent link="a"/><child link="b"/>'
TURNING = 'must be revolute, continuous or fixed, got'
POSITIVE = 'must be a number of at least 0, got'
KINDS = 'must be one of box, cylinder, sphere, capsule, mesh, got'
FLAT = (
    'must have principal moments above 0, each at most the sum of others, got principal moments of'
)
BAD = {
    # what of GOOD is replaced, by what, and how the sentence begins
    GOOD: {
        '': 'not readable as XML: no element found',
        '<sdf/>': 'must be a URDF, <robot>, got <sdf>',
        '<robot/>': 'must have links, got none',
    },
    '</robot>': {'': 'not readable as XML: no element found'},
    '<robot name="r">': {
        '<robot xmlns:xacro="http://ros.org/wiki/xacro"><xacro:if/>': (
            'must be a URDF, got xacro: the command xacro makes a URDF of it'
        ),
        '<robot><xacro:if/>': 'not readable as XML: unbound prefix',
        f'<robot>{link("e")}': 'joints must connect all links to one root, got the roots e, a',
        f'<robot>{link("e")}{link("f")}{joint("l", "a", "e")}{joint("m", "a", "f")}': (
            'must be a chain, with at most two moving joints on a link, got l, m, j on link a; '
            'make joints beside the chain fixed'
        ),
        f'<robot>{link("e")}{joint("l", "b", "e")}': (
            'must be a chain, with at most two moving joints on a link, got j, l, k on link b; '
            'make joints beside the chain fixed'
        ),
        '<robot><snake_sim head="x"/>': (
            "head must be a link at an end of the chain, such as a or c, got 'x'"
        ),
    },
    '<link name="b">': {
        '<link>': 'a <link> must have a name, got none',
        '<link name="a">': "links must differ in name, got 'a' 2 times",
    },
    '<joint name="k"': {'<joint name="j"': "joints must differ in name, got 'j' 2 times"},
    'name="k" type="revolute"': {'name="k"': 'joint k must have a type, got none'},
    'name="j" type="revolute"': {
        'name="j" type="prismatic"': f"joint j {TURNING} 'prismatic'",
        'name="j" type="floating"': f"joint j {TURNING} 'floating'",
        'name="j" type="planar"': f"joint j {TURNING} 'planar'",
        'name="j" type="hinge"': f"joint j {TURNING} 'hinge'",
    },
    '<dynamics': {
        '<mimic joint="k"/><dynamics': (
            "joint j must turn by itself, got <mimic> of 'k'; remove it, or make the joint fixed"
        )
    },
    ENDS: {
        '<child link="b"/>': '<parent> of joint j must have a link, got none',
        '<parent link="a"/>': '<child> of joint j must have a link, got none',
        '<parent/><child link="b"/>': '<parent> of joint j must have a link, got none',
        ENDS.replace('"b"', '"x"'): "joint j: there is no link 'x'",
        ENDS.replace('"b"', '"d"'): 'link d must be the child of one joint, got j and c_d',
        ENDS.replace('"a"', '"d"'): 'joints must connect all links to one root, got a circle',
    },
    'xyz="0.1 0.0 0.0"': {
        'xyz="0.1 0.0"': "xyz of <origin> of joint j must be 3 numbers, got '0.1 0.0'",
        'xyz=""': "xyz of <origin> of joint j must be 3 numbers, got ''",
    },
    'rpy="0.0 0.0 0.0"': {
        'rpy="0 nan 0"': "rpy of <origin> of joint j must be 3 numbers, got '0 nan 0'"
    },
    '<axis xyz="0.0 0.0 1.0"/>': {
        '<axis xyz="0 0 inf"/>': "xyz of <axis> of joint j must be 3 numbers, got '0 0 inf'",
        '<axis xyz="0 0 0"/>': 'axis of j must not be 0, got [0.0, 0.0, 0.0]',
    },
    'lower="-1"': {
        'lower="left"': "lower of <limit> of joint j must be a number, got 'left'",
        'lower="1"': (
            'lower of <limit> of joint j must be below upper, got 1 and 1 rad; a joint that does '
            'not turn is fixed'
        ),
    },
    'effort="2"': {'effort="-2"': f"effort of <limit> of joint j {POSITIVE} '-2'"},
    'friction="0"': {'friction="nan"': f"friction of <dynamics> of joint j {POSITIVE} 'nan'"},
    '<mass value="1.0"/>': {
        '': f'value of <mass> of link a {POSITIVE} none',
        '<mass/>': f'value of <mass> of link a {POSITIVE} none',
        '<mass value="nan"/>': f"value of <mass> of link a {POSITIVE} 'nan'",
        '<mass value="-1"/>': f"value of <mass> of link a {POSITIVE} '-1'",
        '<mass value="1e31"/>': f"value of <mass> of link a {POSITIVE} '1e31'",
        '<mass value="1e-9"/>': 'inertia of link a is too large for 1e-09 kg within 0.112 m of',
        '<mass value="0"/>': 'inertia of link a must be 0 without a mass, got principal moments',
    },
    f'<mass value="1.0"/><inertia {FINE}/>': {
        '<mass value="0"/>': 'link a must have a mass above 0, got none; give it an <inertial>'
    },
    f'<inertial><mass value="1.0"/><inertia {FINE}/></inertial>': {
        '': 'link a must have a mass above 0, got none; give it an <inertial>, or make a joint'
    },
    f'<inertia {FINE}/>': {
        '': (
            'inertia of link a is missing; correct it, or take that of uniform solids with '
            'replace_inertia'
        )
    },
    'ixx="1e-3"': {
        '': 'ixx of <inertia> of link a must be a number, got none',
        'ixx="a"': "ixx of <inertia> of link a must be a number, got 'a'",
        'ixx="-1e-3"': f'inertia of link a {FLAT} -0.001, 0.001, 0.001 kg m^2',
        'ixx="3e-3"': f'inertia of link a {FLAT} 0.001, 0.001, 0.003 kg m^2',
    },
    FINE: {
        HUGE: (
            'inertia of link a is too large for 1 kg within 0.112 m of its center, got principal '
            'moments of 100, 100, 100 kg m^2; correct it, or take that of uniform solids with '
            'replace_inertia'
        )
    },
    'radius="0.05" length': {
        'length': 'radius of <cylinder> of link a must be a number above 0, got none'
    },
    'length="0.2"': {
        'length="0"': "length of <cylinder> of link a must be a number above 0, got '0'"
    },
    '<box size="0.1 0.1 0.1"/>': {
        '<box size="0.1"/>': "size of <box> of link b must be 3 numbers above 0, got '0.1'",
        '<plane/>': f'<geometry> of link b {KINDS} plane',
        '': f'<geometry> of link b {KINDS} none',
        SPHERE * 2: f'<geometry> of link b {KINDS} sphere, sphere',
    },
    ' filename="m.stl"': {'': '<mesh> of link c must have a filename, got none'},
    'scale="0.001 0.001 -0.001"': {
        'scale="1"': "scale of <mesh> of link c must be 3 numbers, got '1'"
    },
}
CASES = [(old, new, sentence) for old, found in BAD.items() for new, sentence in found.items()]


def test_the_robot_that_is_spoilt_is_good():
    found = robot_of_urdf(GOOD)
    assert len(found.values['links']) == 3
    assert found.remarks == ('meshes that are not found, and not shown: m.stl',)


@pytest.mark.parametrize('old, new, sentence', CASES)
def test_bad_input_is_refused_with_a_sentence(old, new, sentence):
    assert old in GOOD
    assert refusal(GOOD.replace(old, new, 1)).startswith(f'robot_description: {sentence}')
    assert refusal(GOOD.replace(old, new, 1), name='my.urdf').startswith('my.urdf: ')


def test_a_small_mass_is_refused_with_the_name_of_its_link():
    text = urdf(link('a', 1e-12, FINE.replace('1e-3', '1e-17')))
    assert refusal(text).startswith('robot_description: link a: mass must be at least 1e-09 kg')


def test_text_without_end_is_refused():
    assert 'must have at most 2500000 characters' in refusal('<robot>' + ' ' * 3_000_000)
    assert 'not readable as XML' in refusal('<robot>\ud800</robot>')
    assert 'not readable as XML' in refusal('<robot>\0</robot>')
    bomb = '<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">{}]><robot>&x7;</robot>'
    levels = ''.join(f'<!ENTITY x{k} "{(f"&x{k - 1};" if k else "&a;") * 50}">' for k in range(8))
    assert 'not readable as XML' in refusal(bomb.format(levels))


def test_long_chains_of_fixed_parts_are_one_link():
    parts = [link(f'l{k}') for k in range(3000)]
    joints = [fixed(f'l{k}', f'l{k + 1}', (1e-4, 0, 0)) for k in range(2999)]
    (found,) = robot_of_urdf(urdf(*parts, *joints)).values['links']
    assert found.mass == 3000.0


JUNK = (*'x nan -1 0 1e400 1e30 1e-300 a b'.split(), '', '1 2', '1 2 3', '\u0663', '9' * 400)


def test_whatever_is_spoilt_is_refused_or_a_robot():
    rng, taken = np.random.default_rng(7), 0
    for _ in range(600):
        root = ElementTree.fromstring(GOOD)
        every = [(above, each) for above in root.iter() for each in above]
        for _ in range(rng.integers(1, 4)):
            above, each = every[rng.integers(len(every))]
            if rng.uniform() < 0.3 and each in above:
                above.remove(each)
            elif each.attrib:
                each.set(str(rng.choice(list(each.attrib))), str(rng.choice(JUNK)))
        text = ElementTree.tostring(root, encoding='unicode')
        try:
            Robot(**robot_of_urdf(text, replace_inertia=bool(rng.integers(2))).values)
            taken += 1
        except ParameterError as error:
            assert '\n' not in str(error)
    assert 20 < taken < 580
