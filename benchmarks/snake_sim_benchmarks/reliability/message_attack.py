# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A flood of hostile messages, service calls and parameters at a node, and what it does then."""

from collections.abc import Callable, Mapping
import math
import random
import time
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter as Setting
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message
from std_srvs.srv import SetBool, Trigger

from snake_sim_benchmarks.reliability.hostile_messages import (
    damaged,
    good_message,
    hostile_message,
    largest_message,
    NUMBERS,
    TIME,
    Topic,
    WORDS,
)
from snake_sim_ros.nodes.executors import served_until

RATE = 5000.0  # messages a second
SLICE = 0.01  # s between two lots of messages
LOOK = 1e-3  # s between two looks for what comes back
GOOD = 0.1  # share of messages that the node can use
CUT = 8  # bytes that miss at the end of a message that is cut short
POOL = 400  # hostile messages that are made beforehand, and sent again with other damage
NEW = 20  # of them that are made anew every second
CALLS = 20  # of services a second
PENDING = 50  # calls without an answer; more are not made
ANSWER = 5.0  # s for an answer at most
SERVICES: dict[str, tuple[tuple[str, Any], ...]] = {
    'sim': (('reset', Trigger), ('pause', SetBool), ('step', Trigger)),
    'gait': (('restart', Trigger),),
    'viewer': (),
}
PARAMETERS = {
    'sim': (
        *('real_time_factor', 'command_horizon', 'command_timeout', 'friction.longitudinal'),
        *('robot.yaw_stiffness', 'gravity', 'push_link', 'push_duration', 'dt', 'use_sim_time'),
        *('no.such', ''),
    ),
    'gait': (
        *('gait.yaw.amplitude', 'gait.yaw.angular_frequency', 'gait.pitch.phase', 'stride'),
        *('scene', 'cmd_vel_timeout', 'blend_time', 'use_sim_time', 'no.such', ''),
    ),
    'viewer': ('port', 'scene', 'use_sim_time', 'no.such'),
}


def quality_of(topic: Topic) -> QoSProfile:
    """Return a quality of service that the node asks of a topic."""
    latched = topic.name == 'robot_description'
    return QoSProfile(
        depth=5,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


class MessageAttack:
    """
    A client that floods a node.

    Parameters
    ----------
    name : str
        The node: sim, gait or viewer.
    topics : sequence of Topic
    publishers : int
        At least one for each topic.
    seed : int

    Attributes
    ----------
    sent : int
        Messages so far.
    longest_answer : float
        Of a service that was asked alone [s].
    answers : list of float
        Times that services took to answer in floods [s].

    """

    def __init__(self, name: str, topics: tuple[Topic, ...], publishers: int, seed: int) -> None:
        self.name, self.topics, self.sent, self.longest_answer = name, topics, 0, 0.0
        self.rng = random.Random(seed)
        self.context = Context()
        rclpy.init(context=self.context)
        self.node = Node('attack', context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.publishers = [
            self.node.create_publisher(topic.kind, topic.name, quality_of(topic))
            for topic in (topics * publishers)[: max(publishers, len(topics))]
        ]
        self.pool = [self._hostile(k) for k in range(POOL)]
        self.good = [serialize_message(good_message(each.kind, self.rng)) for each in topics]
        self.large = [largest_message(each.kind, self.rng) for each in topics]
        self.parameters = self.node.create_client(SetParameters, f'{name}/set_parameters')
        self.services = {
            service: self.node.create_client(kind, f'{name}/{service}')
            for service, kind in SERVICES[name]
        }
        self.answers: list[float] = []
        self._pending: list[Any] = []

    def _hostile(self, number: int) -> bytes:
        return hostile_message(self.topics[number % len(self.topics)].kind, self.rng)

    def close(self) -> None:
        """Leave the graph."""
        self.executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)

    def until(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Serve the client until a condition holds; return whether it did in time."""
        return served_until(self.executor, condition, seconds, SLICE)

    def is_connected(self) -> bool:
        """Return whether all messages and requests reach the node."""
        found = all(each.get_subscription_count() for each in self.publishers)
        return found and self.parameters.service_is_ready()

    def send_largest(self, pause: float) -> None:
        """Have each publisher send its largest message, with a pause after each [s]."""
        for number in range(len(self.publishers)):
            self.sent += self.publish(number, self.large[number % len(self.topics)])
            self.until(lambda: False, pause)

    def flood(self, seconds: float) -> None:
        """Send hostile messages, good ones among them, and call services."""
        for _ in range(round(NEW * seconds)):
            k = self.rng.randrange(POOL)
            self.pool[k] = self._hostile(k)
        large, calls = self.rng.random() * seconds, 0

        def act(now: float) -> None:
            nonlocal large, calls
            if now >= large:
                k, large = self.rng.randrange(len(self.topics)), math.inf
                self.sent += self.publish(k, self.large[k])
            if calls < CALLS * now:
                calls += 1
                self._call()

        self._stream(seconds, self._send_one, act)

    def flood_until(self, condition: Callable[[], Any], good: bytes, seconds: float) -> float:
        """
        Send messages that are cut short, and good ones of the first topic among them.

        Parameters
        ----------
        condition : callable
        good : bytes
            Of the good messages.
        seconds : float
            After which it ends in any case.

        Returns
        -------
        float
            When the condition held [s], nan if it did not.

        """

        def send() -> bool:
            number = self.rng.randrange(len(self.publishers))
            k = number % len(self.topics)
            if k == 0 and self.rng.random() < GOOD:
                return self.publish(number, good)
            return self.publish(number, self._of_pool(k)[:-CUT])

        return self._stream(seconds, send, lambda now: None, condition)

    def _stream(
        self,
        seconds: float,
        send: Callable[[], bool],
        act: Callable[[float], object],
        condition: Callable[[], Any] = lambda: False,
    ) -> float:
        """Send at a rate, and act in between; return when a condition held [s], else nan."""
        begin, tried = time.monotonic(), 0
        while (now := time.monotonic() - begin) < seconds:
            due = min(int(RATE * now), tried + int(0.1 * RATE))
            self.sent += sum(send() for _ in range(due - tried))
            tried = due
            act(now)
            left = SLICE - (time.monotonic() - begin - now)
            # What comes back is read even where sending takes all the time.
            if served_until(self.executor, condition, max(left, SLICE / 2), LOOK):
                return time.monotonic() - begin
        return math.nan

    def publish(self, number: int, data: bytes) -> bool:
        """Publish a message; return whether the middleware lets it through."""
        try:
            self.publishers[number].publish(data)
        except RuntimeError:
            return False
        return True

    def _send_one(self) -> bool:
        rng, number = self.rng, self.rng.randrange(len(self.publishers))
        k = number % len(self.topics)
        what = rng.random()
        if what < GOOD:
            data = self._good(k)
        else:
            data = self._of_pool(k)
            if what < 0.3:
                data = damaged(data, rng)
        return self.publish(number, data)

    def _of_pool(self, number: int) -> bytes:
        """Return a hostile message of a topic."""
        topics = len(self.topics)
        return self.pool[self.rng.randrange(POOL // topics) * topics + number]

    def _good(self, number: int) -> bytes:
        """Return a message that the node can use; that of a clock has the time of now."""
        if self.topics[number] == TIME:
            return serialize_message(good_message(TIME.kind, self.rng))
        return self.good[number]

    def _call(self) -> None:
        """Call a service, or set a parameter, without waiting for an answer."""
        self._pending = [future for future in self._pending if not future.done()]
        if len(self._pending) >= PENDING:
            return
        rng = self.rng
        client: Any = self.parameters
        if self.services and rng.random() < 0.5:
            client = rng.choice(list(self.services.values()))
            request = client.srv_type.Request()
            if client.srv_type is SetBool:
                request.data = rng.random() < 0.5
        else:
            name = rng.choice(PARAMETERS[self.name])
            request = SetParameters.Request(parameters=[Parameter(name=name, value=self._value())])
        begin, future = time.monotonic(), client.call_async(request)
        future.add_done_callback(lambda _: self.answers.append(time.monotonic() - begin))
        self._pending.append(future)

    def _value(self) -> ParameterValue:
        """Return a value of a random type; a type that no parameter has, too."""
        rng = self.rng
        return ParameterValue(
            type=rng.randrange(11),
            bool_value=rng.random() < 0.5,
            integer_value=rng.choice((0, 1, -1, 2**63 - 1, -(2**63))),
            double_value=rng.choice((*NUMBERS, 0.3, 1.0)),
            string_value=rng.choice((*WORDS, 'sidewinding', '[' * 3000, '!!int x')),
            double_array_value=rng.choice(([], [0.0, 0.0, -9.81], list(NUMBERS))),
        )

    def ask(self, client: Any, request: Any) -> Any:
        """Return the answer of a service, None if there is none in time."""
        begin = time.monotonic()
        future = client.call_async(request)
        if not self.until(future.done, ANSWER):
            return None
        self.longest_answer = max(self.longest_answer, time.monotonic() - begin)
        return future.result()

    def set(self, values: Mapping[str, float | bool]) -> str:
        """Set parameters; return an empty text, or why the node did not take them."""
        parameters = [
            Setting(name, value=value).to_parameter_msg() for name, value in values.items()
        ]
        response = self.ask(self.parameters, SetParameters.Request(parameters=parameters))
        if response is None:
            return f'no answer within {ANSWER:g} s'
        return '; '.join(each.reason for each in response.results if not each.successful)
