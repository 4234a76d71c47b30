# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Input that is not usable: the nodes report it in one sentence and keep working."""

from array import array
import math
import re
import signal

from builtin_interfaces.msg import Time
from forks import Forked
import numpy as np
from offline import held_then_commanded, largest_difference, NAMES, nanoseconds, Offline, PERIOD
from programs import next_domain, node_command, Process
import pytest
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, SetParameters
from sensor_msgs.msg import JointState
from sim_client import SimClient
from std_srvs.srv import Trigger

from snake_sim_ros.nodes import control_node, follow_node, gait_node, sim_node
from snake_sim_ros.scene.parameters import load_scene

GOOD = {name: 0.2 if name.endswith('yaw') else 0.0 for name in NAMES}
HELD = '; the last good command is held'


def changed(position=None, velocity=None):
    """Return a command for all joints with some values replaced."""
    positions, velocities = np.full(20, 0.1), np.zeros(20)
    for values, changes in ((positions, position), (velocities, velocity)):
        for name, value in (changes or {}).items():
            values[NAMES.index(name)] = value
    return JointState(
        name=NAMES,
        position=array('d', positions.tobytes()),
        velocity=array('d', velocities.tobytes()),
    )


# Every kind of mistake once: (message, sentence).
MISTAKES = [
    # Within 0.5 s of a good command: later a NaN would be a joint that nobody commands.
    (
        changed(position={'joint_2_pitch': math.nan}),
        'joint_command: position of joint_2_pitch must be finite, got nan',
    ),
    (
        JointState(name=['joint_1_yaw', 'joint_3_jaw'], position=[0.1, 0.1]),
        "joint_command: unknown joint 'joint_3_jaw'; did you mean joint_3_yaw?",
    ),
    (
        JointState(position=[0.1] * 20),
        'joint_command names no joints; name some of joint_1_yaw to joint_10_pitch',
    ),
    (
        JointState(name=NAMES, position=[0.1] * 19),
        'joint_command must have one position a name: got 19 positions for 20 names',
    ),
    (
        changed(velocity={'joint_10_pitch': 12.5}),
        'joint_command: velocity of joint_10_pitch must be within +-10 rad/s, got 12.5 rad/s',
    ),
    (
        JointState(name=['joint_1_yaw', 'joint_1_yaw'], position=[0.1, 0.3]),
        'joint_command names joint joint_1_yaw more than once',
    ),
]
# Two kinds that are above as well; they go to another node, because warnings are throttled.
MORE_MISTAKES = [
    (
        JointState(name=NAMES[:2], position=[0.1] * 2, velocity=[0.1]),
        'joint_command must have no velocity or one a name: got 1 velocities for 2 names',
    ),
    (
        changed(velocity={'joint_9_yaw': -math.inf}),
        'joint_command: velocity of joint_9_yaw must be finite, got -inf',
    ),
]
PARAMS_FILE = """
/**:
  ros__parameters:
    scene: sidewinding
    gravity: [0.5, 0.0, -9.8]
    friction.longitudinal: 0.25
    pegs: {x: '[]', y: '[]'}
    ground.heights: '[]'
    robot:
      yaw_damping: 0.3
"""
DIVERGING = (
    *('robot.yaw_damping:=100.0', 'pd_scheme:=midpoint'),
    *('robot.joint_stop:=false', 'robot.rate_stop:=false'),  # which would hold the joints
)


@pytest.fixture(scope='module')
def params_file(tmp_path_factory):
    path = tmp_path_factory.mktemp('parameters') / 'sim.yaml'
    path.write_text(PARAMS_FILE)
    return path


@pytest.fixture(scope='module')
def sims(make_graph, params_file):
    """A sim with a scene, one with a file of parameters and one that diverges."""
    starts = (
        ['scene:=sidewinding'],
        [f'--params-file {params_file}', 'publish_rate:=50.0'],
        DIVERGING,
    )
    clients = [SimClient(make_graph(), *parameters) for parameters in starts]
    for client in clients[:2]:
        client.wait_until_connected()
    return clients


def send_often(sim, message, sentence):
    """Send a bad message five times; return how often the node complains about it."""
    for _ in range(5):
        sim.publish(message)
    text = sentence + HELD
    sim.graph.until(lambda: sim.process.count(text), f'the warning {text!r}')
    return sim.process.count(text)


def assert_rejections(sim, kinds):
    """Check the number in /diagnostics; of five messages sent quickly some may replace others."""
    sim.graph.until(
        lambda: int(sim.values()['rejected_commands']) >= kinds, f'{kinds} rejected commands', 10
    )
    assert int(sim.values()['rejected_commands']) <= 5 * kinds


def test_bad_commands_are_refused_with_one_sentence_and_the_last_good_one_is_held(sims):
    sim = sims[0]
    sim.advance_to(0.5)
    start = np.array(sim.joint_states[-1].position)
    sim.send(GOOD)
    sim.graph.until(
        lambda: np.abs(np.array(sim.joint_states[-1].position) - start).max() > 1e-3,
        'the good command to be taken: a next one would replace it',
    )
    for message, sentence in MISTAKES:
        assert send_often(sim, message, sentence) == 1
    # A command is late if a newer one was taken: the good one, at 0.5 s or after.
    for _ in range(5):
        sim.send({'joint_1_yaw': -0.4}, stamp=Time(nanosec=200_000_000))
    late = 'joint_command is late: stamped'
    sim.graph.until(lambda: sim.process.count(late), f'the warning {late!r}')
    assert sim.process.count(late) == 1
    assert sim.process.count(HELD) == len(MISTAKES) + 1, sim.process.output
    kinds = len(MISTAKES) + 1
    assert_rejections(sim, kinds)
    # None of them was taken in part: the robot moved as if only the good command had come.
    samples = held_then_commanded(load_scene('sidewinding'), GOOD, sim.joint_states)
    poses = {nanoseconds(message): message for message in sim.link_poses}
    for message in sim.joint_states:
        stamp = nanoseconds(message)
        if stamp in poses:
            assert largest_difference(message, poses[stamp], samples[stamp // PERIOD]) < 1e-9
    assert sim.process.stop() == 0, sim.process.output
    assert 'Traceback' not in sim.process.output


def test_more_bad_commands(sims):
    sim = sims[1]
    for message, sentence in MORE_MISTAKES:
        assert send_often(sim, message, sentence) == 1
    assert sim.process.count(HELD) == len(MORE_MISTAKES), sim.process.output
    assert_rejections(sim, len(MORE_MISTAKES))


def get_parameters(sim, *names):
    response = sim.graph.call(
        GetParameters, 'sim/get_parameters', GetParameters.Request(names=list(names))
    )
    return response.values


def set_parameter(sim, name, value):
    kind = ParameterType.PARAMETER_DOUBLE
    item = Parameter(name=name, value=ParameterValue(type=kind, double_value=value))
    request = SetParameters.Request(parameters=[item])
    return sim.graph.call(SetParameters, 'sim/set_parameters', request).results[0]


def test_file_of_parameters_is_taken(sims):
    names = ('scene', 'friction.longitudinal', 'friction.transversal', 'robot.yaw_damping')
    values = get_parameters(sims[1], *names, 'gravity')
    assert values[0].string_value == 'sidewinding'
    # The values come from the file, the scene and the file.
    assert [value.double_value for value in values[1:4]] == [0.25, 0.2, 0.3]
    assert list(values[4].double_array_value) == [0.5, 0.0, -9.8]
    # The physics uses them: as an offline run with the same numbers it lies still on that slope,
    # and gravity along x, 0.5 of 9.8, is less than friction.
    last = sims[1].link_poses[-1].poses[5].position
    assert abs(last.x) < 1e-3


def test_real_time_factor_changes_while_running(sims):
    sim = sims[1]
    for value in (0.0, 0.5):
        result = set_parameter(sim, 'real_time_factor', value)
        assert result.successful, result.reason
        assert get_parameters(sim, 'real_time_factor')[0].double_value == value
    sim.graph.until(
        lambda: 0.4 < float(sim.values()['real_time_factor']) < 0.6, 'half of real time'
    )
    for value in (-1.0, math.nan, math.inf):
        result = set_parameter(sim, 'real_time_factor', value)
        assert not result.successful
        assert 'real_time_factor' in result.reason
        assert get_parameters(sim, 'real_time_factor')[0].double_value == 0.5


def test_what_needs_a_restart_is_read_only(sims):
    for name in ('robot.link_mass', 'dt', 'publish_rate'):
        before = get_parameters(sims[1], name)[0].double_value
        result = set_parameter(sims[1], name, 0.01)
        assert not result.successful
        assert 'read-only' in result.reason
        assert get_parameters(sims[1], name)[0].double_value == before
    assert sims[1].process.stop() == 0, sims[1].process.output


def test_diverged_sim_pauses_at_the_last_good_state_and_waits_for_reset(sims):
    sim = sims[2]
    sim.wait_until_connected()
    sim.send({'joint_1_yaw': 0.2})
    sim.graph.until(lambda: sim.process.count('[ERROR]'), 'the error of a diverged run', 10)
    said = 'diverged, paused at the last good state; call ~/reset: t = '
    assert sim.process.count(said) == 1, sim.process.output
    assert sim.process.count('rad in one step of 0.00025 s') == 1, sim.process.output
    sim.graph.until(
        lambda: sim.diagnostics and sim.diagnostics[-1].status[0].message[:3] == 't =',
        'diagnostics',
        10,
    )
    status = sim.diagnostics[-1].status[0]
    assert status.level == b'\x02'
    assert 'would turn by' in status.message
    refused = sim.pause(False)
    assert (refused.success, refused.message) == (False, 'diverged: call ~/reset first')
    step = sim.graph.call(Trigger, 'sim/step')
    assert (step.success, step.message) == (False, 'diverged: call ~/reset first')
    assert all(math.isfinite(v) for m in sim.joint_states for v in [*m.position, *m.effort])
    # Reset publishes the start, and the node goes on.
    sim.graph.drain(sim.joint_states)
    count, diverged_at = len(sim.joint_states), sim.now
    assert sim.reset().success
    sim.graph.until(lambda: len(sim.joint_states) > count + 5, 'states after ~/reset')
    start = Offline(load_scene('lateral_undulation')).sample()
    assert np.abs(np.array(sim.joint_states[count].position) - start.angle).max() <= 1e-12
    assert sim.now > diverged_at
    assert sim.process.count(said) == 1, sim.process.output
    assert sim.process.stop(signal.SIGINT) == 0, sim.process.output


SCENE_WITH_MISSPELT_KEY = 'robot: aiko.yaml\nfriction: {longitudnal: 0.1, transversal: 0.5}\n'
# (node, parameters, the sentence)
BAD_STARTS = {
    'misspelt parameter': (
        'sim',
        ['friction.longitudnal:=0.2'],
        "unknown parameter 'friction.longitudnal'; did you mean 'friction.longitudinal'?",
    ),
    'quality of service': (
        'sim',
        ['qos_overrides./joint_states.publisher.reliability:=bogus'],
        'qos_overrides of /joint_states.publisher.reliability: Unexpected QoS override for policy',
    ),
    'misspelt key': (
        'sim',
        ['scene:={folder}/misspelt.yaml'],
        "misspelt.yaml: friction: unknown key 'longitudnal'; did you mean 'longitudinal'?",
    ),
    'missing file': (
        'sim',
        ['scene:=nowhere.yaml'],
        'no file nowhere.yaml; the scenes that come with the package: aiko_with_servos, conc',
    ),
    'negative': (
        'sim',
        ['robot.link_mass:=-1.0'],
        'robot.link_mass must be above 0 kg, got -1 kg',
    ),
    'not finite': (
        'sim',
        ['robot.yaw_stiffness:=.nan'],
        'robot.yaw_stiffness must be finite, got nan N m/rad',
    ),
    'not a divisor': (
        'sim',
        ['dt:=0.0003'],
        'dt must divide the publish period: got dt=0.0003 s, period=0.005 s',
    ),
    'zero rate': ('sim', ['publish_rate:=0'], 'publish_rate must be at least 10 Hz, got 0 Hz'),
    'text': (
        'sim',
        ['friction.transversal:=much'],
        "friction.transversal must be a number, got 'much'",
    ),
    'empty list': ('sim', ['pegs.x:=[]'], 'a parameter is an empty list; write it as text: "[]"'),
    'method': ('sim', ['method:=magic'], "unknown method 'magic'; choose from: auto, bdf2, "),
    'scheme': (
        'sim',
        ['method:=bdf2', 'pd_scheme:=start'],
        'pd_scheme start is explicit, and method bdf2 takes the controller at the end of a step; ',
    ),
    'accuracy': ('sim', ['accuracy:=0.5'], 'accuracy must be at most 0.1, got 0.5'),
    'accuracy of a method': (
        'sim',
        ['accuracy:=0.001', 'method:=newton'],
        'accuracy 0.001 needs method bdf2, which divides steps, or auto; got method newton',
    ),
    'gains of following': (
        'follow',
        ['follow.lookahead:=0.0'],
        'follow.lookahead must be above 0',
    ),
    'path of following': (
        'follow',
        ['follow.center:=[0.0]'],
        'center must have 2 components, got 1',
    ),
    'follow': (
        'follow',
        ['folow.speed:=1.0'],
        "unknown parameter 'folow.speed'; did you mean 'follow.speed'?",
    ),
    'no controller': (
        'control',
        [],
        'scene lateral_undulation has no controller: give one by controller.name, or a path; ',
    ),
    'controller': (
        'control',
        ['controller.name:=oscillator'],
        "unknown controller 'oscillator'; did you mean 'oscillators'?",
    ),
    'values of a controller': (
        'control',
        ['controller.name:=oscillators', 'controller.gains:=2.0'],
        'controller oscillators takes coupling, gain, period; got gains',
    ),
    'gait': (
        'gait',
        ['gait.yaw.amplitud:=0.2'],
        "unknown parameter 'gait.yaw.amplitud'; did you mean 'gait.yaw.amplitude'?",
    ),
}


NODES = {'sim': sim_node, 'gait': gait_node, 'control': control_node, 'follow': follow_node}


def start_all(cases):
    """Start nodes one after the other, as their launchers do; none of them gets to run."""
    for name, arguments in cases:
        main = NODES[name].main
        print('ended with', main([name, '--ros-args', *arguments]), flush=True)
    return 0


@pytest.fixture(scope='module')
def bad_starts(tmp_path_factory):
    """What every bad start prints, and its exit status."""
    folder = tmp_path_factory.mktemp('scenes')
    (folder / 'misspelt.yaml').write_text(SCENE_WITH_MISSPELT_KEY)
    cases = [
        (node, [part for item in parameters for part in ('-p', item.format(folder=folder))])
        for node, parameters, _ in BAD_STARTS.values()
    ]
    process = Forked(start_all, cases, domain=next_domain())
    assert process.wait(60) == 0, process.output
    outputs = re.findall(r'(.*?)^ended with (\d)$', process.output, re.DOTALL | re.MULTILINE)
    return dict(zip(BAD_STARTS, outputs, strict=True))


@pytest.mark.parametrize('title', BAD_STARTS)
def test_bad_parameters_end_the_start_with_one_sentence(bad_starts, title):
    (output, status), sentence = bad_starts[title], BAD_STARTS[title][2]
    assert status == '2'
    (line,) = (line for line in output.strip().split('\n') if not line.startswith('[INFO]'))
    assert line.startswith('error: ')
    assert sentence in line


def test_bad_parameter_is_the_exit_status_of_a_node():
    process = Process(node_command('sim', '-p', 'dt:=0.0003'), next_domain())
    assert process.wait(60) == 2, process.output
    assert process.lines == [
        'error: dt must divide the publish period: got dt=0.0003 s, period=0.005 s'
    ]
