# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Hostile messages at real nodes: a second of a flood, then a look at what must hold, and so on.

The nodes are processes of their own in a domain of this machine. A flood is of 5000 messages a
second at most, mixed with good ones, calls of services and parameters.
"""

from collections.abc import Iterator
from contextlib import closing
import math
import os
import socket
import time
from typing import Any

from snake_sim_ros.nodes.tools.attack_checks import GaitCheck
from snake_sim_ros.nodes.tools.attack_checks import SimCheck
from snake_sim_ros.nodes.tools.attack_checks import ViewerCheck
from snake_sim_ros.nodes.tools.attacked_node import AttackedNode
from snake_sim_ros.nodes.tools.attacked_node import node
from snake_sim_ros.nodes.tools.attacked_node import on_own_domain
from snake_sim_ros.nodes.tools.hostile_messages import TOPICS
from snake_sim_ros.nodes.tools.message_attack import MessageAttack
from snake_sim_ros.reliability.trials import Trial

START = 120.0  # s for a node to start, which may have to compile the physics
CONNECT = 20.0  # s for all publishers to find the node
FLOOD = 1.0  # s between two looks
PRINTED = 20_000  # bytes that a node may print in a second of a flood
GROWTH = 50.0  # MB that a node may grow from the second third to the last third of many floods
MANY = 90  # floods; until then buffers grow to the size of the largest message of each topic
PUBLISHERS = (1, 20)
STARTED = {'sim': 'physics ready', 'gait': 'waiting for a robot', 'viewer': 'http://'}


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Flood sim, gait and viewer, each from 1 and from 20 publishers of a topic or more."""
    share = seconds / (len(TOPICS) * len(PUBLISHERS))
    with on_own_domain(60 + os.getpid() % 40):
        for name in TOPICS:
            port = _free_port()
            parameters = {'viewer': (f'port:={port}',), 'gait': ('start_from:=now',)}
            attacked = node(name, *parameters.get(name, ()))
            try:
                if not attacked.wait_until_said(STARTED[name], START):
                    yield _no_start(name, attacked)
                    continue
                for count in PUBLISHERS:
                    yield _flooded(name, attacked, port, count, share, seed)
            finally:
                attacked.end()


def _free_port() -> int:
    with closing(socket.socket()) as listener:
        listener.bind(('127.0.0.1', 0))
        return int(listener.getsockname()[1])


def _no_start(name: str, attacked: AttackedNode) -> Trial:
    words = ' / '.join(list(attacked.lines)[-3:])
    return Trial('messages', name, 'messages', 0, 1, 0.0, first=f'{name} did not start: {words}')


def _check(name: str, attack: MessageAttack, port: int) -> Any:
    if name == 'viewer':
        return ViewerCheck(attack, port)
    return SimCheck(attack) if name == 'sim' else GaitCheck(attack)


def _flooded(
    name: str, attacked: AttackedNode, port: int, count: int, seconds: float, seed: int
) -> Trial:
    """Flood a node for some time, from some publishers, and return what came of it."""
    # The clock of gait is that of the machine: a hostile /clock is one more robot's.
    topics = tuple(each for each in TOPICS[name] if each.name != '/clock')
    attack = MessageAttack(name, topics, count, seed)
    check = _check(name, attack, port)
    first, violations, floods, most = '', 0, 0, 0.0
    begin, memory = time.monotonic(), list[float]()
    try:
        if not attack.until(attack.is_connected, CONNECT):
            violations, first = 1, f'{name} could not be reached'
        while not first and (floods == 0 or time.monotonic() - begin < seconds):
            printed = attacked.printed
            attack.flood(FLOOD)
            floods += 1
            problems = list(check.problems()) if attacked.is_alive else []
            most = max(most, attacked.printed - printed)
            if not attacked.is_alive:
                problems.append(f'{name} ended: {" / ".join(list(attacked.lines)[-3:])}')
            if attacked.printed - printed > PRINTED:
                problems.append(f'{name} printed {attacked.printed - printed} bytes in a second')
            memory.append(attacked.memory)
            if len(memory) > MANY and _growth(memory) > GROWTH:
                problems.append(f'{name} grew by {_growth(memory):.0f} MB')
            violations += len(problems)
            if problems:
                first = f'seed {seed}, second {floods}: {problems[0]}'
    finally:
        attack.close()
    figures = f'{floods} floods, {most:.0f} bytes printed in a second at most'
    figures += f', {max(memory, default=math.nan):.0f} MB at most'
    if isinstance(check, SimCheck):
        figures += f', {check.resets} resets after a divergence'
    publishers = f'{count} publisher{"s" * (count > 1)}'
    return Trial(
        'messages', f'{name}, {publishers}', 'messages', attack.sent, violations,
        time.monotonic() - begin, attack.longest_answer, _growth(memory), figures, first,
    )  # fmt: skip


def _growth(memory: list[float]) -> float:
    """
    Return how much memory grew from the second third of some floods to the last one [MB].

    The least of a third counts, since each largest message takes memory for a while.
    """
    third = len(memory) // 3
    return min(memory[2 * third :]) - min(memory[third : 2 * third]) if third else math.nan
