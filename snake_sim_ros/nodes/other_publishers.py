"""Who speaks against whom: nodes that publish commands, or the clock, of one robot."""

from collections.abc import Iterable

from rclpy.node import Node


class Rivals:
    """Tells, once, which nodes publish what one alone should."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._told: set[tuple[str, ...]] = set()

    def look(self, commands: Iterable[str], *, clock: bool) -> None:
        """
        Look for several nodes that speak, and warn of those not told before.

        Parameters
        ----------
        commands : iterable of str
            Topics on which commands came.
        clock : bool
            Whether the node itself publishes /clock.

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
