# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Nodes that publish on the same topic, where one alone should: commands and the clock."""

from collections.abc import Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock

CLOCK = '/clock'
COUNTS = 'the last message counts'  # of commands
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # of a node that is about to come, or has just gone
HEARD = 1000  # messages that may come between two looks


class OtherPublishers:
    """
    Warns, once each, of topics on which messages of several nodes come.

    The graph tells who may publish. It still has a node that was killed for up to 20 s, so nobody
    is named for being there: after the first look at several publishers of a topic, the messages
    on it are heard, and the second look tells whether they come from several.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._told: list[tuple[str, set[str]]] = []  # topics and names
        self._before: set[str] = set()  # topics with commands in the interval before
        self._listeners: dict[str, Listener] = {}

    def look(self, commands: Mapping[str, Any], *, clock: bool) -> None:
        """
        Look for topics with several publishers, and warn of those that are new.

        Parameters
        ----------
        commands : mapping
            Topics on which commands came since the last look, with the types of messages.
        clock : bool
            Whether this node publishes /clock itself.

        """
        kinds = {self._node.resolve_topic_name(name): kind for name, kind in commands.items()}
        speakers = {topic: self._speakers(topic) for topic in sorted(kinds)}
        for topic, nodes in speakers.items():
            self._look_at(topic, kinds[topic], nodes, COUNTS)
        lasting = sorted(self._before & speakers.keys())
        if all(len(speakers[topic]) == 1 for topic in lasting):
            several = sorted({name for topic in lasting for name in speakers[topic]})
            if len(several) > 1:
                self._tell(f'{" and ".join(lasting)} have', several, COUNTS)
        self._before = set(speakers)
        if clock:
            advice = 'start all sims but one with publish_clock:=false'
            self._look_at(CLOCK, Clock, self._speakers(CLOCK), advice)
        for topic in self._listeners.keys() - {*speakers, CLOCK}:
            self._listeners.pop(topic).close()

    def _speakers(self, topic: str) -> list[str]:
        return sorted(
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(topic)
            if info.node_name not in ('', UNKNOWN)
        )

    def _look_at(self, topic: str, kind: Any, nodes: list[str], advice: str) -> None:
        """Warn if messages of a topic come from several of its publishers, at the second look."""
        what, listener = f'{topic} has', self._listeners.pop(topic, None)
        if len(nodes) > 1 and not self._is_told(what, nodes):
            self._listeners[topic] = listener or Listener(self._node, topic, kind)
            if listener and listener.hears_several():
                self._tell(what, nodes, advice)
        elif listener:
            listener.close()

    def _is_told(self, what: str, nodes: list[str]) -> bool:
        return any(what == told and set(nodes) <= names for told, names in self._told)

    def _tell(self, what: str, nodes: list[str], advice: str) -> None:
        if not self._is_told(what, nodes):
            self._told.append((what, set(nodes)))
            self._node.get_logger().warning(
                f'{what} {len(nodes)} publishers, {", ".join(nodes)}: {advice}'
            )


class Listener:
    """Hears on a topic whether its messages come from several publishers, who count them each."""

    def __init__(self, node: Node, topic: str, kind: Any) -> None:
        # The executor of the node, EventsExecutor, cannot pass on the number of a message. A name
        # that begins with an underscore is hidden in lists of nodes.
        self._node = Node(
            f'_{node.get_name()}_hears',
            namespace=node.get_namespace(),
            context=node.context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._kind, self._last = kind, 0
        self._subscription = self._node.create_subscription(
            kind, topic, lambda message: None, QoSProfile(depth=HEARD), raw=True
        )

    def hears_several(self) -> bool:
        """Return whether messages came that one publisher alone cannot have counted so."""
        several = False
        with self._subscription.handle:
            for _ in range(HEARD):
                taken = self._subscription.handle.take_message(self._kind, True)
                if taken is None:
                    break
                number = taken[1]['publication_sequence_number']
                # A middleware that does not count says nothing: then the graph is believed.
                several = several or number is None or number <= self._last
                self._last = number or 0
        return several

    def close(self) -> None:
        """Listen no more."""
        self._node.destroy_node()
