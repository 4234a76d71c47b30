"""Nodes that publish on the same topic, where one alone should: commands and the clock."""

from collections.abc import Iterable

from rclpy.node import Node


class OtherPublishers:
    """Warns, once each, of topics that several nodes publish on."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._told: set[tuple[str, ...]] = set()

    def look(self, commands: Iterable[str], *, clock: bool) -> None:
        """
        Look for topics with several publishers, and warn of those that are new.

        Parameters
        ----------
        commands : iterable of str
            Topics on which commands came.
        clock : bool
            Whether this node publishes /clock itself.

        """
        topics = sorted(map(self._node.resolve_topic_name, commands))
        speakers = {topic: self._speakers(topic) for topic in topics}
        for topic, nodes in speakers.items():
            self._tell(f'{topic} has {len(nodes)} publishers', nodes, 'the last message counts')
        if all(len(nodes) < 2 for nodes in speakers.values()):
            several = sorted({name for nodes in speakers.values() for name in nodes})
            what = f'{" and ".join(topics)} have {len(several)} publishers'
            self._tell(what, several, 'the last message counts')
        if clock:
            nodes = self._speakers('/clock')
            self._tell(
                f'/clock has {len(nodes)} publishers',
                nodes,
                'start all sims but one with publish_clock:=false',
            )

    def _speakers(self, topic: str) -> list[str]:
        return sorted(
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(topic)
        )

    def _tell(self, what: str, nodes: list[str], advice: str) -> None:
        if len(nodes) > 1 and (what, *nodes) not in self._told:
            self._told.add((what, *nodes))
            self._node.get_logger().warning(f'{what}, {", ".join(nodes)}: {advice}')
