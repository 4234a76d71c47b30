# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A client of the sim node: it subscribes to all its topics and calls its services."""

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import Odometry
from offline import nanoseconds, Offline
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger


def connected(*clients):
    """Return the clients of sims that start beside each other, once all are connected."""
    for client in clients:
        client.wait_until_connected()
    return clients


def with_twin(sim, scene):
    """Return a sim in lock-step, back at its start, and its offline twin at the same time."""
    sim.reset()
    twin = Offline(scene)
    twin.simulation.step_count = round(sim.now / scene.dt)
    twin.reference.stamp[:] = sim.now
    twin.limiter.start(twin.reference.angle, twin.simulation.time)
    return sim, twin


class SimClient:
    """One sim node with its parameters, in a domain of its own and, maybe, a namespace."""

    def __init__(self, graph, *parameters, namespace='', constants=None):
        self.graph, self.namespace = graph, f'/{namespace}'.rstrip('/')
        self.joint_states = graph.record(JointState, f'{self.namespace}/joint_states')
        self.link_poses = graph.record(PoseArray, f'{self.namespace}/link_poses')
        self.odom = graph.record(Odometry, f'{self.namespace}/odom')
        self.clock = graph.record(Clock, '/clock')
        self.diagnostics = graph.record(DiagnosticArray, '/diagnostics')
        self.commands = graph.node.create_publisher(
            JointState, f'{self.namespace}/joint_command', QoSProfile(depth=1)
        )
        self.process = graph.start('sim', *parameters, constants=constants)

    def step_to_gait(self):
        """Step until a gait node, which was started, commands; return the list of its commands."""
        commands = self.graph.record(JointState, 'joint_command')
        self.wait_until_connected()
        publishers = self.graph.node.count_publishers
        self.graph.until(lambda: publishers('joint_command') > 1, 'the gait node')
        while not commands:
            self.step()
            self.graph.spin(0.01)
        return commands

    @property
    def states(self):
        """The lists of messages that every state is published in, the clock last."""
        states = [self.joint_states, self.link_poses, self.odom]
        return states if 'publish_clock:=false' in self.process.name else [*states, self.clock]

    def service(self, name):
        """Return the whole name of a service of the node."""
        return f'{self.namespace}/sim/{name}'

    def wait_until_connected(self):
        """Wait until the physics is compiled and messages pass in both directions."""
        graph = self.graph
        graph.until(lambda: self.process.count('physics ready'), 'the physics')
        graph.until(lambda: self.commands.get_subscription_count(), 'a reader of joint_command')
        graph.until(lambda: self.states_heard(), 'all state messages')

    def states_heard(self):
        """Return whether all state topics have messages; make a paused node publish them."""
        if not all(self.states) and self.process.count('physics ready') and self.is_paused():
            self.graph.call(Trigger, self.service('reset'))
            self.graph.spin(0.05)
        return all(self.states)

    def is_paused(self):
        """Return whether the node was started with start_paused."""
        return 'start_paused:=true' in self.process.name

    def send(self, angles, rates=None, stamp=None):
        """Publish a command and wait until the node has it."""
        message = JointState(name=list(angles), position=list(angles.values()))
        if rates:
            message.velocity = [rates.get(name, 0.0) for name in angles]
        if stamp is not None:
            message.header.stamp = stamp
        self.publish(message)

    def publish(self, message):
        """Publish a message and wait until the middleware of the node has it."""
        self.commands.publish(message)
        assert self.commands.wait_for_all_acked(Duration(seconds=10)), 'no one took the command'

    def reset(self):
        """Call ~/reset, and wait for the messages of the state that it leads to."""
        return self._and_messages('reset')[0]

    def pause(self, data):
        """Call ~/pause."""
        return self.graph.call(SetBool, self.service('pause'), SetBool.Request(data=data))

    def step(self):
        """Advance a paused node by one period; return its four messages."""
        response, new = self._and_messages('step')
        assert response.success, response.message
        assert [len(messages) for messages in new] == [1, 1, 1, 1]
        return [messages[0] for messages in new]

    def _and_messages(self, service):
        """Call a service; return its response and, if it took place, the messages after it."""
        counts = [len(messages) for messages in self.states]
        response = self.graph.call(Trigger, self.service(service))
        if response.success:
            self.graph.until(
                lambda: all(len(m) > n for m, n in zip(self.states, counts, strict=True)),
                f'the messages after {service}',
            )
        return response, [messages[n:] for messages, n in zip(self.states, counts, strict=True)]

    def advance_to(self, seconds):
        """Wait until a running node has reached a simulated time."""
        self.graph.until(
            lambda: nanoseconds(self.joint_states[-1]) >= 1e9 * seconds, f't = {seconds} s'
        )

    @property
    def now(self):
        """Simulated time of the last state that arrived [s]."""
        return 1e-9 * nanoseconds(self.joint_states[-1])

    def values(self):
        """Return the numbers of the newest /diagnostics message, waiting for a new one."""
        count = len(self.diagnostics)
        self.graph.until(lambda: len(self.diagnostics) > count, '/diagnostics')
        return {item.key: item.value for item in self.diagnostics[-1].status[0].values}

    def wait_for_value(self, key, value):
        """Wait until /diagnostics has a value; a message may be older than what was just sent."""
        self.graph.until(lambda: self.values()[key] == value, f'{key} = {value} in /diagnostics')
