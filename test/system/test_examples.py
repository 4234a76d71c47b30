# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every script of examples/ with real nodes and without any, in forked processes."""

import itertools
import re
import signal

import forks
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
import numpy as np
from programs import ROOT
import pytest

from snake_sim_ros.nodes.messages import stamp_from

RATE = 'publish_rate:=50.0'  # few messages, as several robots run faster than real time
SCRIPTS = ('crawl_and_turn', 'record_torque', 'sidewind_a_metre', 'step_response')
PNG = b'\x89PNG\r\n\x1a\n'
END = 60.0  # s for a script to end; each of its waits may take half of that


def script(graph, folder, name, *words, timeout=END / 2, is_background=False):
    """Start a script in the domain of a graph."""
    path, where = ROOT / 'examples' / f'{name}.py', {'folder': folder, 'domain': graph.domain}
    words = '--timeout', str(timeout), *words
    process = forks.script(path, *words, is_background=is_background, **where)
    process.graph = graph
    return process


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('examples')


@pytest.fixture(scope='module')
def watching(make_graph):
    """A client in a domain without nodes, and the commands of a script to a gait there."""
    graph = make_graph()
    graph.twists = graph.record(Twist, 'cmd_vel')
    return graph


@pytest.fixture(scope='module')
def started(make_graph, watching, folder):
    """All scripts, started together with the nodes that they need."""
    crawling, sidewinding, alone = make_graph(), make_graph(), make_graph()
    crawling.start('sim', 'real_time_factor:=3.0', RATE)
    sidewinding.start('sim', 'real_time_factor:=2.0', RATE, 'scene:=sidewinding')
    gaits = [graph.start('gait', 'use_sim_time:=true', RATE) for graph in (crawling, sidewinding)]
    alone.start('sim')
    scripts = {'step_response': script(alone, folder, 'step_response')}
    scripts['interrupted'] = script(watching, folder, 'crawl_and_turn', is_background=True)
    for gait in gaits:
        gait.wait_for(
            'the gait begins', END
        )  # simulated time runs fast while nodes find each other
    drawn = '--plot', 'crawl_and_turn.png'
    scripts['crawl_and_turn'] = script(crawling, folder, 'crawl_and_turn', *drawn)
    scripts['record_torque'] = script(crawling, folder, 'record_torque')
    drawn = '--plot', 'sidewind_a_metre.png'
    scripts['sidewind_a_metre'] = script(sidewinding, folder, 'sidewind_a_metre', *drawn)
    yield scripts
    for process in scripts.values():
        process.kill()


@pytest.fixture(scope='module')
def lonely(make_graph, folder):
    """All scripts in a domain without nodes."""
    nowhere = make_graph()
    return {name: script(nowhere, folder, name, timeout=0.2) for name in SCRIPTS}


def numbers(started, name, pattern):
    """Return the numbers of a line of a script that ends well; then end what only it needs."""
    process = started[name]
    assert process.wait(END) == 0, process.output
    others = [item for item in started.values() if item.graph is process.graph]
    if all(item.popen.poll() is not None for item in others):
        for node in tuple(process.graph.processes):
            process.graph.end(node)
    found = re.search(pattern.replace('#', r'(-?\d+(?:\.\d+)?)'), process.output)
    assert found, process.output
    return [float(number) for number in found.groups()]


@pytest.mark.parametrize('name', SCRIPTS)
def test_one_sentence_where_no_node_runs(lonely, name):
    process = lonely[name]
    assert process.wait() == 1
    (line,) = process.lines
    assert re.fullmatch(r'no .* for 0\.2 s: is snake_sim_ros (sim|gait) running\?', line)


@pytest.mark.parametrize('name', SCRIPTS)
def test_scripts_are_those_of_a_user(name):
    text = (ROOT / 'examples' / f'{name}.py').read_text(encoding='utf-8')
    assert not re.search(r'^\s*(import|from) snake_sim_ros', text, re.MULTILINE)


def test_sidewind_a_metre(started, folder):
    moved, seconds = numbers(started, 'sidewind_a_metre', 'moved # m in # s')
    assert 1.0 <= moved < 1.05
    assert 4.0 < seconds < 20.0  # 0.2 m/s is asked for
    assert (folder / 'sidewind_a_metre.png').read_bytes().startswith(PNG)


def test_record_torque(started, folder):
    count, largest = numbers(started, 'record_torque', '# states, largest yaw torque # N m')
    table = np.genfromtxt(folder / 'torque.csv', delimiter=',', names=True)
    names = table.dtype.names
    assert names[:3] == ('time', 'joint_1_yaw', 'joint_1_pitch')
    assert len(names) == 21
    periods = np.diff(table['time']) / 0.02
    assert np.abs(periods - periods.round()).max() < 1e-4
    assert periods.sum() == pytest.approx(250, abs=1.5)
    assert count == len(table) > 225  # a late reader loses messages
    torque = max(np.abs(table[name]).max() for name in names[1::2])
    assert largest == pytest.approx(torque, abs=0.01)
    # 40 N m/rad from one joint limit to the other would be 63 N m.
    assert 0.1 < largest < 63
    assert (folder / 'torque.png').read_bytes().startswith(PNG)


def test_crawl_and_turn(started, folder):
    # The script asks for 1.2 m and 52 degrees; the first wave turns the robot by itself, and a
    # busy machine takes some of the way, since the gait follows a clock that comes late.
    moved, turned = numbers(started, 'crawl_and_turn', 'moved # m, turned # degrees')
    assert 0.3 < moved < 1.3
    assert 15 < turned < 80
    assert (folder / 'crawl_and_turn.png').read_bytes().startswith(PNG)


def test_step_response(started, folder):
    turned, told, rise, overshoot = numbers(
        started, 'step_response', r'turned by # degrees of #\nrise time # ms, overshoot # %'
    )
    assert started['step_response'].lines[0] == 'same bits'
    # Stiffness is 40 N m/rad; friction of a link, some 0.1 N m, holds part of a degree.
    assert turned == pytest.approx(told, abs=1.0)
    assert 5 <= rise <= 30
    assert 0 <= overshoot < 20
    assert (folder / 'step_response.png').read_bytes().startswith(PNG)


def test_a_script_that_is_interrupted_stops_the_robot(watching, started):
    process, twists, ticks = started['interrupted'], watching.twists, itertools.count()
    odom = watching.node.create_publisher(Odometry, 'odom', 1)

    def tick():
        message = Odometry()
        message.header.stamp = stamp_from(next(ticks) * 100_000_000)
        odom.publish(message)

    watching.until(lambda: tick() or (twists and twists[-1].linear.x > 0), 'the robot to go')
    assert process.stop(signal.SIGINT) == 0
    watching.until(lambda: twists[-1] == Twist(), 'the robot to stop')
    assert process.count('t = ') == len(process.lines)
