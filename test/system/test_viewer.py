# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The viewer in a real browser: a live robot, its controls, and a recorded run."""

import re
import signal
import socket
import sys

from browser import Browser
from forks import command, node
from geometry_msgs.msg import PoseArray, Twist
from nav_msgs.msg import Path
import numpy as np
from programs import next_domain, Process
import pytest
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from snake_sim_ros import Robot
from snake_sim_ros.commands.main import main
from snake_sim_ros.scene.robot_description import robot_description

pytestmark = pytest.mark.long

pytest.importorskip('viser')
PNG = b'\x89PNG\r\n\x1a\n'
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SIZE = (860, 400)  # pixels; Chromium draws in software here
RATE = 'publish_rate:=50.0'  # few messages; the viewer shows 30 a second at most
COMMANDS = [sys.executable, '-m', 'snake_sim_ros.commands']
VIEW = ['view', '--port', '0', '--no-browser']


def address(process):
    """Return the address at which a process serves its page."""
    process.wait_for('the viewer is at ', 60)
    return re.search(r'http://127\.0\.0\.1:\d+', process.output)[0]


def seconds(browser):
    """Return the time that the page shows, -1 if none."""
    found = re.search(r'time\s+(\d+\.\d+) s', browser.text)
    return float(found[1]) if found else -1.0


def test_error_of_a_live_view_is_told_once(tmp_path, monkeypatch):
    (tmp_path / 'viser').mkdir()
    (tmp_path / 'viser' / '__init__.py').write_text('raise ImportError\n')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    process = Process([*COMMANDS, *VIEW], next_domain())
    assert process.wait(60) == 1
    assert process.count('the viewer needs viser, which is not installed') == 1, process.output
    assert process.lines[-1] == 'snake-sim view: viewer ended with status 2'


def test_port_in_use():
    with socket.create_server(('127.0.0.1', 0)) as server:
        port = server.getsockname()[1]
        process = node('viewer', '-p', f'port:={port}', domain=next_domain())
        assert process.wait() == 2
    assert process.lines == [
        f'error: port {port} of 127.0.0.1 is in use; choose another one, or 0 for any free one'
    ]


@pytest.fixture(scope='module')
def graph(make_graph):
    """Return a live robot with its viewer."""
    graph = make_graph()
    # At half the speed there is half as much to compute, to send, and to show.
    graph.start('sim', 'scene:=sidewinding', RATE, 'real_time_factor:=0.5')
    graph.start('gait', 'scene:=sidewinding', 'use_sim_time:=true', RATE)
    graph.viewer = graph.start('viewer', 'port:=0')
    graph.clock = graph.record(Clock, '/clock')
    return graph


@pytest.fixture(scope='module')
def page(graph, tmp_path_factory):
    """Return a browser that shows the live robot."""
    browser = Browser(tmp_path_factory.mktemp('live'), SIZE)
    browser.open(address(graph.viewer))
    browser.until(lambda: seconds(browser) > 0.0, 'the time on the page')
    yield browser
    browser.close()


def parameter(graph, node, name):
    """Return the value of a number of a node."""
    request = GetParameters.Request(names=[name])
    return graph.call(GetParameters, f'/{node}/get_parameters', request).values[0].double_value


def test_robot_moves_and_nothing_leaves_the_machine(page, graph, tmp_path):
    before, begin = page.picture(), seconds(page)
    page.until(lambda: seconds(page) > begin + 0.5, 'half a second')
    after = page.picture()
    assert before.startswith(PNG) and before != after
    (tmp_path / 'live.png').write_bytes(after)
    for text in ('distance', 'real-time factor', 'joint angles [deg]', 'joint torques [N m]'):
        assert text in page.text
    own = address(graph.viewer).replace('http', '')
    for url in page.requests:
        assert url.startswith(('data:', f'http{own}', f'ws{own}', f'blob:http{own}')), url
    assert f'http{own}/' in page.requests
    assert not page.errors


def test_curves_of_a_joint_have_different_colors(page):
    marker = 'getComputedStyle(item.querySelector(".u-marker")).borderTopColor'
    series = f'[...document.querySelectorAll(".u-series")].map(item => [item.innerText, {marker}])'
    colors = dict(page.until(lambda: page.run(f'{series}.slice(0, 4)'), 'the legend'))
    assert list(colors) == ['yaw', 'pitch', 'yaw, commanded', 'pitch, commanded']
    assert len({*colors.values()}) == 4


def test_one_button_is_the_first_one(page):
    color = f'getComputedStyle({page.button("NAME")}).backgroundColor'
    first, *others = (
        page.run(color.replace('NAME', name))
        for name in ('pause', 'reset', 'Draw a path', 'Clear')
    )
    assert len({*others}) == 1 and first not in others


def test_robot_and_plots_are_seen_in_a_narrow_window(page):
    sheet = (
        '[...document.querySelectorAll("div")].find(d => getComputedStyle(d).maxHeight === "40%")'
    )
    joints = '[...document.querySelectorAll("[role=button]")].find(b => b.innerText === "Joints")'
    page.resize(400, 800)
    try:
        top = page.until(lambda: page.run(f'({sheet})?.getBoundingClientRect().top'), 'the sheet')
        assert top >= 400  # The robot is above it.
        assert 'Orange: forces along the floor' in page.text
        # What a person moves comes before what a person reads.
        places = [page.text.index(text) for text in ('gait', 'amplitude', 'distance', 'Orange')]
        assert places == sorted(places)
        page.until(lambda: page.run(f'!!({joints})'), 'the panel of the plots')
        page.run(f'({joints}).click(), ({joints}).scrollIntoView()')
        page.until(lambda: 'joint angles [deg]' in page.text, 'the plots')
        place = page.run(f'({joints}).getBoundingClientRect().bottom')
        assert top < place < 800
    finally:
        page.resize(*SIZE)
    page.until(lambda: not page.run(f'!!({sheet})'), 'two panels again')


def test_a_path_is_drawn_followed_and_cleared(page, graph):
    follow = graph.start('follow', 'scene:=sidewinding', 'use_sim_time:=true')
    paths, steered = graph.record(Path, 'path'), graph.record(Twist, 'cmd_vel')
    links = graph.record(PoseArray, 'link_poses', 1)
    page.press_until('Follow', lambda: 'A path needs two points' in page.text, 'the reason')
    graph.until(lambda: follow.count('waiting for a path'), 'the node follow')
    page.press_until('Draw a path', lambda: 'Click on the floor' in page.text, 'the hint')
    for k, place in enumerate([(430, 330), (400, 260)]):  # between the panels
        page.click(*place)
        page.until(lambda k=k: f'Points: {k + 1}.' in page.text, 'the point')
    assert not paths and not steered  # a robot that is watched keeps its gait
    page.press('Follow')
    graph.until(lambda: paths, 'the path')
    points = np.array([(at.pose.position.x, at.pose.position.y) for at in paths[0].poses])
    robot = np.mean([(at.position.x, at.position.y) for at in links[-1].poses], axis=0)
    assert np.hypot(*(points[0] - robot)) < 0.5  # it has gone on
    assert len(points) == 3 and np.hypot(*(points - points[0]).T).max() < 10.0
    graph.until(lambda: any(each.linear.x > 0.0 for each in steered), 'the robot to be led')
    page.press('Clear')
    graph.until(lambda: not paths[-1].poses, 'an empty path')
    graph.until(lambda: steered[-1] == Twist(), 'the robot to stop')


def test_buttons_act_on_the_simulation(page, graph):
    page.press_until('pause', lambda: page.has('resume'), 'the pause')
    graph.drain(graph.clock)
    paused, count = graph.clock[-1].clock, len(graph.clock)
    graph.spin(0.3)
    assert len(graph.clock) == count
    page.press('step')
    graph.until(lambda: len(graph.clock) > count, 'a step')
    step = graph.clock[-1].clock.nanosec - paused.nanosec
    assert step % 10**9 == 20_000_000  # a publish period
    at_start = re.compile(r'distance\s+0\.00')
    page.press_until('reset', lambda: at_start.search(page.text), 'the start of the scene')
    page.press_until('resume', lambda: page.has('pause'), 'the run to go on')
    graph.until(lambda: len(graph.clock) > count + 5, 'the clock')


def test_numbers_are_those_of_the_nodes(page, graph):
    page.enter('friction across', '0.45')
    graph.until(
        lambda: parameter(graph, 'sim', 'friction.transversal') == pytest.approx(0.45), 'friction'
    )
    page.enter('frequency [Hz]', '0.3')
    for wave in ('yaw', 'pitch'):
        name = f'gait.{wave}.angular_frequency'
        graph.until(
            lambda name=name: parameter(graph, 'gait', name) == pytest.approx(1.885, abs=1e-3),
            name,
        )
    item = Parameter('real_time_factor', value=0.25).to_parameter_msg()
    graph.call(SetParameters, '/sim/set_parameters', SetParameters.Request(parameters=[item]))
    page.until(lambda: page.read('real-time factor') == '0.25', 'what another one changed')
    page.choose('gait', 'lateral_undulation')
    graph.until(lambda: parameter(graph, 'gait', 'gait.pitch.amplitude') == 0.0, 'another gait')


def test_a_refusal_is_told(page):
    page.enter('amplitude [deg]', '59')
    page.until(lambda: 'gait.yaw.amplitude' in page.text, 'the reason')
    page.until(lambda: page.read('amplitude [deg]') == '30', 'the value of the node')


def test_simulation_that_ends_is_told(page, graph):
    assert graph.processes.pop(0).stop() == 0
    page.until(lambda: 'sim is not running' in page.text, 'the remark')


def test_real_robot_is_shown_from_its_joints(page, graph):
    """A robot of five links, on a wall clock, without poses of links."""
    description = graph.node.create_publisher(String, 'robot_description', LATCHED)
    joints = graph.node.create_publisher(JointState, 'joint_states', 1)
    description.publish(String(data=robot_description(Robot(link_count=5))))
    page.until(lambda: page.read('show') == 'joint 3', 'a robot with four joints')
    names = Robot(link_count=5).axis_names
    graph.until(joints.get_subscription_count, 'the viewer')
    message = JointState(name=names, position=[0.2] * len(names))
    for offset in (0, 3):
        message.header.stamp.sec = 1_700_000_000 + offset
        joints.publish(message)
        page.until(lambda offset=offset: seconds(page) == offset, 'time since the first message')
    page.until(lambda: 'joint torques' not in page.text, 'no curves of what is not known')
    assert 'joint angles [deg]' in page.text
    assert 'Traceback' not in graph.viewer.output


def test_viewer_ends_while_it_is_watched(page, graph):
    assert graph.viewer.stop(signal.SIGTERM) == 0
    assert 'Traceback' not in graph.viewer.output


def test_recorded_run(page, tmp_path):
    file = str(tmp_path / 'run.mcap')
    run = ['run', 'lateral_undulation', '--duration', '1.1', '--accuracy', '0', '--bag', file]
    assert main(run) == 0
    process = command([*VIEW, file], next_domain())
    try:
        page.open(address(process))
        page.until(lambda: 'repeat' in page.text, 'the controls of a run')
        # viser drops clicks until it knows the page, and then the run begins.
        page.until(lambda: seconds(page) > 0.0, 'the run to begin')
        page.press_until('pause', lambda: page.has('play'), 'the run to pause')
        page.enter('time [s]', '1.05')
        page.until(lambda: seconds(page) == 1.05, 'the time that was chosen')
        assert 'play' in page.text and 'planar' in page.text
        page.press('play')
        page.until(lambda: seconds(page) != 1.05, 'another time')
    finally:
        status = process.stop()
    assert status == 0, process.output
    assert 'Traceback' not in process.output
    assert 'ignored' not in process.output  # the page of viser sends only what is heeded
