# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The tour of docs/first_steps.md, line by line, and the tables of docs/nodes.md.

The packages of ROS 2 on PyPI have no command line `ros2`: the commands of snake-sim run its lines.
"""

import math
from pathlib import Path
import re
import shlex

from forks import command, script
from offline import nanoseconds
import pytest
from rcl_interfaces.srv import GetParameters
from sim_client import SimClient
import yaml

from snake_sim_ros.nodes.state_publishers import TransformMessages
from snake_sim_ros.scene.files import CONFIG

ROOT = Path(__file__).parents[2]
TUTORIAL = (ROOT / 'docs/first_steps.md').read_text(encoding='utf-8')
NODES = (ROOT / 'docs/nodes.md').read_text(encoding='utf-8')
RATE = 'publish_rate:=50.0'  # a quarter of the messages
TRIES = 20  # half seconds, for what a line asks for to happen
OF_ALL_NODES = {'/parameter_events', '/rosout'}
# Packages of services that all nodes have, or only where they are installed.
OTHERS = {'rcl_interfaces', 'type_description_interfaces', 'simulation_interfaces'}


def section(page, heading):
    """Return the text of a page from a heading to the next one."""
    return re.split(r'^#', page.partition(f'{heading}\n')[2], maxsplit=1, flags=re.MULTILINE)[0]


LINES = [
    line
    for block in re.findall(
        r'^```sh\n(.*?)^```', section(TUTORIAL, '## Ten minutes'), re.MULTILINE | re.DOTALL
    )
    for line in block.splitlines()
]


@pytest.fixture(scope='module')
def toured(make_graph):
    return Tour(make_graph())


class Tour:
    """The nodes and a client, while the lines are run one after the other."""

    def __init__(self, graph):
        self.graph = graph
        self.sim = self.gait = None

    def node(self, line):
        """Start what `ros2 run` starts."""
        name, *arguments = shlex.split(line)[3:]
        if name == 'sim':
            self.sim = SimClient(self.graph, 'real_time_factor:=3.0', RATE)
            self.sim.wait_until_connected()
        else:
            self.gait = self.graph.start(name, *arguments[2:], RATE)
            self.gait.wait_for('the gait begins')

    def speed(self, seconds=0.5):
        """Return the mean speed of the middle link over some simulated time [m/s]."""
        begin, first = self.sim.now, self.sim.odom[-1].pose.pose.position
        self.sim.advance_to(begin + seconds)
        last = self.sim.odom[-1].pose.pose.position
        return math.hypot(last.x - first.x, last.y - first.y) / (self.sim.now - begin)

    def angle(self, axis, seconds=0.5):
        """Return the angle of an axis after some simulated time [rad]."""
        self.sim.advance_to(self.sim.now + seconds)
        return self.sim.joint_states[-1].position[axis]

    def distance(self, seconds):
        """Return the distance of the middle link from the origin, after some time [m]."""
        self.sim.advance_to(self.sim.now + seconds)
        pose = self.sim.odom[-1].pose.pose.position
        return math.hypot(pose.x, pose.y)


def test_ten_minutes(toured, tmp_path):
    assert len(LINES) > 12
    done = [(line, act(toured, line, tmp_path)) for line in LINES]
    assert all(check for _, check in done), [line for line, check in done if not check]


def act(tour, line, folder):
    """Run a line and return whether it did what the tutorial says."""
    graph = tour.graph
    if line.startswith('ros2 run'):
        tour.node(line)
        return True
    if line.startswith('python3'):
        path, *words = [*shlex.split(line)[1:], '--duration', '1']
        process = script(ROOT / path, *words, folder=folder, domain=graph.domain)
        return process.wait(60) == 0 and (folder / 'torque.png').stat().st_size > 1000
    printed = run(graph, line)
    if ' echo ' in line:
        message = yaml.safe_load(printed.removesuffix('---'))
        return len(message.get('position', ())) == 20 or message.get('child_frame_id') == BASE
    if '/joint_command' in line:
        return any(abs(tour.angle(8) - 0.5) < 0.05 for _ in range(TRIES))
    if 'linear' in line:
        return any(tour.speed() > 0.02 for _ in range(TRIES))
    if '"{}"' in line:
        return any(tour.speed() < 0.01 for _ in range(TRIES))
    if line.startswith('ros2 param'):
        set_now = parameter(graph, *line.split()[3:5]) == float(line.split()[5])
        return printed == 'Set parameter successful' and set_now
    return 'success=True' in printed and services(tour, line)


def run(graph, line):
    """Return what a line of `ros2` prints."""
    process = command(shlex.split(line)[1:], graph.domain)
    graph.until(lambda: process.popen.poll() is not None, line)
    assert process.wait() == 0, process.output
    return process.output


BASE = 'base_link'


def parameter(graph, node, name):
    request = GetParameters.Request(names=[name])
    return graph.call(GetParameters, f'{node}/get_parameters', request).values[0].double_value


def services(tour, line):
    """Return whether simulated time did what a service should do."""
    sim, graph = tour.sim, tour.graph
    if 'true' in line or '/step' in line:
        graph.drain(sim.joint_states)
        stamp = nanoseconds(sim.joint_states[-1])
        graph.spin(0.1)
        return nanoseconds(sim.joint_states[-1]) == stamp
    sim.advance_to(sim.now + 0.1)
    # States from before the reset may still be on their way.
    return '/reset' not in line or any(tour.distance(0.5) < 0.1 for _ in range(TRIES))


# ---- the tables ---------------------------------------------------------------------------------


def table(heading):
    """Return direction, name and type of every row of the table in a section."""
    rows = re.findall(
        r'^\| (in|out|service) \| (.+?) \| (\S+) \|', section(NODES, heading), re.MULTILINE
    )
    return {
        (way, name, kind) for way, names, kind in rows for name in re.findall('`(.+?)`', names)
    }


def found(node, name):
    """Return the same rows for a running node, without those of `OTHERS` and of actions."""
    rows = set()
    for direction, entries in (
        ('in', node.get_subscriber_names_and_types_by_node(name, '/')),
        ('out', node.get_publisher_names_and_types_by_node(name, '/')),
        ('service', node.get_service_names_and_types_by_node(name, '/')),
    ):
        for topic, (kind,) in entries:
            package, _, short = kind.split('/')
            own = package not in OTHERS and '/_action/' not in topic
            if own and topic not in OF_ALL_NODES and topic not in ('/clock',) * (name == 'gait'):
                rows.add((direction, topic.replace(f'/{name}/', '~/'), f'{package}/{short}'))
    return rows


@pytest.mark.parametrize('name', ['sim', 'gait', 'control', 'follow'])
def test_tables_are_what_the_nodes_have(toured, name):
    said = table(f'## Interface of `{name}`')
    if not TransformMessages.available:
        said = {row for row in said if not row[2].startswith('tf2_msgs')}
    absolute = ('/', '~')
    said = {(d, n if n.startswith(absolute) else f'/{n}', k) for d, n, k in said}
    if name in ('control', 'follow'):
        toured.graph.start(name, 'follow.center:=[0.0, -1.5]')
        toured.graph.until(lambda: name in toured.graph.node.get_node_names(), name)
        toured.graph.until(lambda: found(toured.graph.node, name) == said, 'its topics', 20.0)
    assert found(toured.graph.node, name) == said


@pytest.mark.parametrize('file', ['foxglove.json', 'aiko.rviz'])
def test_layouts_of_viewers_name_topics_of_the_tables(file):
    rows = table('## Interface of `sim`') | table('## Interface of `gait`')
    known = {f'/{name.lstrip("/")}' for _, name, _ in rows}
    named = set(re.findall(r'(?<=[" ])/[a-z_]+', (CONFIG / file).read_text(encoding='utf-8')))
    assert named and named <= known
