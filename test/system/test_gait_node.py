"""The gait node before a plain listener, under a clock of the test, and with the sim node."""

import signal

import numpy as np
from offline import NAMES
from offline import nanoseconds
from offline import Offline
from offline import PERIOD
from offline import positions
import pytest
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from sim_client import SimClient
from std_srvs.srv import Trigger

from snake_sim_ros import gait
from snake_sim_ros.nodes.messages import stamp_from
from snake_sim_ros.parameters import load_scene

SCENES = ('lateral_undulation', 'sidewinding')


@pytest.fixture(scope='module')
def started(make_graph):
    """All nodes of this module, started together, in four domains."""
    lone = {scene: make_graph() for scene in SCENES}
    for scene, graph in lone.items():
        graph.start('gait', f'scene:={scene}')
    clocked, live = make_graph(), make_graph()
    clocked.start('gait', 'use_sim_time:=true')
    live.start('gait', 'use_sim_time:=true')
    return lone, clocked, live, SimClient(live, 'start_paused:=true')


def assert_reference(messages, scene, begin):
    for message in messages:
        # The same formula at the same nanoseconds.
        time = 1e-9 * (nanoseconds(message) - begin)
        angle, rate = gait.reference(scene.gait, time, 10)
        assert list(message.name) == NAMES
        assert np.abs(np.array(message.position) - angle.ravel()).max() < 1e-9
        assert np.abs(np.array(message.velocity) - rate.ravel()).max() < 1e-9


def beginning(messages, scene):
    """Return the stamp of the newest message that is the beginning of the gait, or None."""
    angle, rate = (value.ravel() for value in gait.reference(scene.gait, 0.0, 10))
    for message in reversed(messages):
        same = np.abs(np.array(message.position) - angle).max() < 1e-12
        if same and np.abs(np.array(message.velocity) - rate).max() < 1e-12:
            return nanoseconds(message)
    return None


@pytest.mark.parametrize('name', SCENES)
def test_gait_begins_when_someone_listens_and_again_after_restart(started, name):
    graph, scene = started[0][name], load_scene(name)
    (process,) = graph.processes
    response = graph.call(Trigger, 'gait/restart')
    assert (response.success, response.message) == (True, 'the gait begins again')
    graph.spin(0.3)
    assert not process.count('the gait begins'), process.output
    messages = graph.record(JointState, 'joint_command')
    graph.until(lambda: len(messages) > 20, 'commands')
    process.wait_for('the gait begins')
    assert process.count('the gait begins') == 1

    heard = len(messages)
    assert graph.call(Trigger, 'gait/restart').success
    graph.until(lambda: beginning(messages[heard:], scene) is not None, 'the beginning')
    begin = beginning(messages[heard:], scene)
    graph.until(lambda: len(messages) > heard + 100, 'half a second of commands')
    after = [message for message in messages if nanoseconds(message) >= begin]
    assert_reference(after, scene, begin)
    stamps = [nanoseconds(message) for message in messages]
    assert stamps == sorted(set(stamps))
    # 200 Hz by default; the timer of a busy machine may be late, but not in the mean.
    assert np.median(np.diff(stamps)) == pytest.approx(PERIOD, rel=0.2)
    number = signal.SIGINT if scene.gait.soft_start else signal.SIGTERM
    assert process.stop(number) == 0, process.output


def test_gait_follows_a_clock_of_others_and_pauses_with_it(started):
    graph = started[1]
    (process,) = graph.processes
    messages = graph.record(JointState, 'joint_command')
    clock = graph.node.create_publisher(Clock, '/clock', QoSProfile(depth=1))
    graph.until(clock.get_subscription_count, 'a reader of /clock')
    graph.until(lambda: graph.node.count_publishers('joint_command'), 'joint_command')
    now = 10_000_000_000

    def tick():
        nonlocal now
        now += PERIOD
        clock.publish(Clock(clock=stamp_from(now)))
        graph.spin(0.005)
        return messages

    graph.until(tick, 'the first command')
    process.wait_for('the gait begins')
    # Nobody hears the first command for certain; a restart is heard.
    assert graph.call(Trigger, 'gait/restart').success
    heard = len(messages)
    scene = load_scene('lateral_undulation')
    graph.until(lambda: tick() and len(messages) > heard + 50, 'commands')
    begin = beginning(messages[heard:], scene)
    assert begin is not None
    after = [message for message in messages if nanoseconds(message) >= begin]
    assert_reference(after, scene, begin)
    assert all(nanoseconds(message) % PERIOD == 0 for message in messages)
    assert nanoseconds(messages[-1]) <= now

    graph.drain(messages)
    count = len(messages)
    graph.spin(0.3)
    assert len(messages) == count
    # A clock that begins anew begins the gait anew.
    now = 1_000_000_000
    graph.until(lambda: tick() and nanoseconds(messages[-1]) < begin, 'commands of the new time')
    graph.until(lambda: tick() and len(messages) > count + 20, 'more commands')
    new = [m for m in messages[count:] if nanoseconds(m) < begin]
    assert_reference(new[1:], scene, beginning(new, scene))
    assert process.stop(signal.SIGTERM) == 0, process.output


def test_sim_and_gait_get_as_far_as_the_offline_run(started):
    *_, graph, live = started
    commands = graph.record(JointState, 'joint_command')
    live.wait_until_connected()
    graph.until(lambda: graph.node.count_publishers('joint_command') > 1, 'the gait node')
    assert live.pause(False).success
    graph.until(lambda: commands, 'the gait')
    begin, duration = nanoseconds(commands[0]), 3.0
    live.advance_to(1e-9 * begin + duration)
    last = begin + round(duration * 1e9)
    graph.until(lambda: nanoseconds(live.link_poses[-1]) >= last, 'the last poses')
    poses = {nanoseconds(message): positions(message)[5] for message in live.link_poses}
    moved = np.linalg.norm((poses[last] - poses[begin])[:2])

    scene = load_scene('lateral_undulation')
    twin = Offline(scene)
    start = twin.sample().position[5]
    for _ in range(round(duration * 200)):
        times = twin.simulation.midpoints(20)
        twin.simulation.advance(*gait.reference(scene.gait, times, 10))
    distance = np.linalg.norm((twin.sample().position[5] - start)[:2])
    assert distance > 0.2
    # Commands come a period or two late, extrapolated by their rate: 5 % is asked for.
    assert moved == pytest.approx(distance, rel=0.05)
    assert int(live.values()['rejected_commands']) == 0
    assert all(nanoseconds(message) % PERIOD == 0 for message in commands)
