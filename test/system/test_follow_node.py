# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The node follow leads a simulated robot along paths, over ROS alone."""

import itertools
import math
import re
import shlex

from diagnostic_msgs.msg import DiagnosticArray
from forks import command
from geometry_msgs.msg import Pose, PoseArray, PoseStamped, Twist
from nav_msgs.msg import Path
import numpy as np
from programs import ROOT
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sim_client import SimClient
from std_msgs.msg import Float64

from snake_sim_ros import PlanarPath
from snake_sim_ros.nodes.messages import LATCHED, stamp_from

LENGTH = 11 * 0.14  # of the robot [m]


class Course:
    """A robot that is led along paths, and what is said about it."""

    def __init__(self, graph):
        self.graph = graph
        self.sim = SimClient(graph, 'real_time_factor:=2.5', 'publish_rate:=25.0')
        self.node = graph.start('follow', 'use_sim_time:=true', '-p tolerance:=0.2')
        graph.start('gait', 'use_sim_time:=true', 'publish_rate:=25.0')
        self.paths = graph.node.create_publisher(Path, 'path', QoSProfile(depth=1))
        self.errors = graph.record(Float64, 'cross_track_error')
        self.steered = graph.record(Twist, 'cmd_vel')

    def send(self, *points, frame='world'):
        """Publish a path through some points [m]."""
        message = Path()
        message.header.frame_id = frame
        for x, y in points:
            pose = PoseStamped()
            pose.pose.position.x, pose.pose.position.y = float(x), float(y)
            message.poses.append(pose)
        self.graph.until(self.paths.get_subscription_count, 'a reader of path')
        self.paths.publish(message)

    def says(self, text):
        """Wait until the node has logged a text."""
        self.graph.until(lambda: self.node.count(text), text)

    @property
    def center(self):
        """Center of the links in the last state [m]."""
        poses = self.sim.link_poses[-1].poses
        return np.mean([(each.position.x, each.position.y) for each in poses], axis=0)

    def state(self):
        """Return the state of the node in new diagnostics."""
        found = []
        reader = self.graph.node.create_subscription(
            DiagnosticArray, '/diagnostics', lambda message: found.extend(message.status), 10
        )
        mine = lambda: [each for each in found if each.name.startswith('follow')]  # noqa: E731
        self.graph.until(mine, 'diagnostics of follow')
        self.graph.node.destroy_subscription(reader)
        return mine()[-1].message


@pytest.fixture(scope='module')
def course(make_graph):
    found = Course(make_graph())
    found.sim.wait_until_connected()
    return found


# The tests of the course need this order.


def test_the_robot_waits_for_a_path(course):
    assert course.state() == 'waiting for a path'
    assert not course.steered


@pytest.mark.parametrize(
    ('points', 'frame', 'message'),
    [
        ([(0, 0), (1, 1)], 'map', "path: the frame must be world or odom, got 'map'"),
        ([(0, 0), (math.nan, 1)], 'world', 'path: poses of a path must be finite, got [nan, 1.0]'),
        ([(0, 0)], 'world', 'path: poses of a path must be two or more'),
    ],
)
def test_what_is_no_path_is_refused(course, points, frame, message):
    course.send(*points, frame=frame)
    course.says(message)
    assert not course.steered


def test_the_robot_follows_a_path_to_its_end(course):
    start = course.center
    # It points to -x, the path 45 degrees to the left of that.
    end = start - 1.5
    course.send(start, end)
    course.says('following a path of 2.121 m')
    course.says('at the end of the path')
    course.graph.until(lambda: course.steered[-1] == Twist(), 'the robot to stop')
    late = [each.data for each in course.errors[-len(course.errors) // 5 :]]
    assert len(course.errors) > 100
    # Twice as much as without delays.
    assert math.sqrt(np.square(late).mean()) < 0.1 * LENGTH
    assert (end - course.center).max() < 0.4  # it may go on while others have the processor

    def stands():
        before = course.center
        course.graph.spin(0.2)
        return np.hypot(*(course.center - before)) < 1e-3

    course.graph.until(stands, 'the robot to stand')
    assert course.state() == 'at the end of the path'


def test_gains_change_and_bad_paths_do_not(course):
    begin = course.center
    count = len(course.steered)
    course.send(begin, begin - [5.0, 0.0])
    course.graph.until(lambda: len(course.steered) > count + 3, 'the robot to go')
    assert course.steered[-1].linear.x == pytest.approx(0.546 * 80 / 360)
    speed = Parameter('follow.speed', value=0.06).to_parameter_msg()
    request = SetParameters.Request(parameters=[speed])
    assert course.graph.call(SetParameters, 'follow/set_parameters', request).results[0].successful
    course.send((0, 0), (0, 0))
    course.says('path: poses of a path must be apart from each other, got [0.0, 0.0] twice')
    course.graph.until(lambda: course.steered[-1].linear.x == 0.06, 'another speed')
    assert course.state() == 'following'


def test_an_empty_path_stops_the_robot(course):
    course.send()
    course.graph.until(lambda: course.steered[-1] == Twist(), 'the robot to stop')
    assert course.state() == 'waiting for a path'
    # So does one that comes when there is no path: the gait may go on by itself.
    count = len(course.steered)
    course.send()
    course.graph.until(lambda: len(course.steered) > count, 'another stop')
    assert course.steered[-1] == Twist()


def test_a_line_of_the_page_sends_a_path(course):
    page = (ROOT / 'docs/controllers.md').read_text(encoding='utf-8')
    (line,) = re.findall('^ros2 (topic pub --once /path .+)$', page, re.MULTILINE)
    process = command(shlex.split(line), course.graph.domain)
    course.graph.until(lambda: process.popen.poll() is not None, line)
    assert process.wait() == 0, process.output
    length = PlanarPath.spline([[0.0, 0.0], [-1.5, -1.5], [-3.0, -1.5]]).length
    course.says(f'following a path of {length:.4g} m')


def test_a_path_from_before_and_poses_that_end(make_graph):
    graph = make_graph()
    paths = graph.node.create_publisher(Path, 'path', LATCHED)
    message = Path(poses=[PoseStamped(), PoseStamped()])
    message.poses[1].pose.position.x = 2.0
    paths.publish(message)
    node = graph.start('follow', 'pose_timeout:=0.5', 'scene:=sidewinding')
    steered = graph.record(Twist, 'cmd_vel')
    graph.until(lambda: node.count('following a path of 2 m'), 'the path')
    assert node.count('following a path') == 1
    robot = graph.node.create_publisher(PoseArray, 'link_poses', QoSProfile(depth=1))
    graph.until(robot.get_subscription_count, 'a reader of link_poses')
    short = PoseArray(poses=[Pose()] * 3)
    refused = 'link_poses: must be the 11 links, got 3 poses'
    graph.until(lambda: robot.publish(short) or node.count(refused), 'a refusal')
    whole = PoseArray(poses=[Pose() for _ in range(11)])
    for k, pose in enumerate(whole.poses):
        pose.position.y = 0.14 * (k - 5)  # the head to -y: it moves to +x
    graph.until(lambda: robot.publish(whole) or steered, 'the robot to go')
    assert steered[0].linear.x == pytest.approx(0.473 * 80 / 360)
    assert steered[0].angular.z == pytest.approx(0.0, abs=1e-9)
    graph.until(lambda: steered[-1] == Twist(), 'the robot to stop')
    graph.until(lambda: node.count('no link_poses for'), 'the reason')


def test_the_path_begins_anew_when_time_goes_back(make_graph):
    graph = make_graph()
    node = graph.start('follow', 'use_sim_time:=true', 'follow.center:=[0.0,-1.5]')
    clock = graph.node.create_publisher(Clock, '/clock', 1)
    steered, robot = graph.record(Twist, 'cmd_vel'), PoseArray(poses=[Pose() for _ in range(11)])
    places = graph.node.create_publisher(PoseArray, 'link_poses', 1)
    for k, pose in enumerate(robot.poses):
        pose.position.x = 0.14 * k

    def tick(seconds):
        clock.publish(Clock(clock=stamp_from(round(1e9 * seconds))))
        places.publish(robot)

    ticks = itertools.count(1000)
    graph.until(lambda: tick(0.1 * next(ticks)) or steered, 'the robot to go')
    assert node.count('following a path of 9.425 m') == 1
    ticks = itertools.count(1)
    again = lambda: node.count('following a path of 9.425 m') == 2  # noqa: E731
    graph.until(lambda: tick(0.1 * next(ticks)) or again(), 'the path')
