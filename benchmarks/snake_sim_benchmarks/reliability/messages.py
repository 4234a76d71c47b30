# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Hostile messages at real nodes: a second of a flood, then a look at what must hold, and so on.

The nodes are processes of their own in a domain of this machine. A flood is of 5000 messages a
second at most, mixed with good ones, calls of services and parameters.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
import math
import os
import time
from typing import Any

import numpy as np

from snake_sim_benchmarks.reliability.attack_checks import GaitCheck, SimCheck, ViewerCheck
from snake_sim_benchmarks.reliability.attacked_node import AttackedNode, node, on_own_domain
from snake_sim_benchmarks.reliability.hostile_messages import TIME, Topic, TOPICS
from snake_sim_benchmarks.reliability.message_attack import MessageAttack
from snake_sim_benchmarks.reliability.trials import Trial
from snake_sim_ros.nodes.node_process import NO_BUFFERS

START = 120.0  # s for a node to start, which may have to compile the physics
CONNECT = 20.0  # s for all publishers to find the node
FLOOD = 1.0  # s between two looks
PRINTED = 20_000  # bytes that a node may print in a second of a flood
COPIES = 3  # of a message on its way: in the middleware, as bytes in Python, and what is read
FEW = 6  # floods before memory is judged
WARM = 0.05  # s between two of the largest messages, with which an attack begins
PUBLISHERS = (1, 20)
# The GNU C library gives blocks of this size and more back as soon as they are free [B]. It begins
# with that by itself, but keeps ever larger ones in the heap once a larger one was freed, up to
# 32 MB. Memory would then be that of a heap with holes, and not what a node uses.
GIVEN_BACK = {'MALLOC_MMAP_THRESHOLD_': '131072'}
STARTED = {'sim': 'physics ready', 'gait': 'waiting for a robot', 'viewer': r'http://\S+'}


@dataclass(frozen=True)
class Subject:
    """
    A node that is attacked.

    Attributes
    ----------
    words : str
        What the table calls it.
    node : str
    parameters : tuple of str
        As ``name:=value``.
    topics : tuple of Topic
        On which it is flooded.

    """

    words: str
    node: str
    parameters: tuple[str, ...]
    topics: tuple[Topic, ...]


SUBJECTS = (
    Subject('sim', 'sim', (), TOPICS['sim']),
    Subject('gait', 'gait', ('start_from:=now',), TOPICS['gait']),
    Subject(
        'gait on /clock',
        'gait',
        ('start_from:=now', 'use_sim_time:=true'),
        (*TOPICS['gait'], TIME),
    ),
    Subject('viewer', 'viewer', ('port:=0',), TOPICS['viewer']),
)


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Flood sim, gait and viewer, each from 1 and from 20 publishers of a topic or more."""
    share = seconds / (len(SUBJECTS) * len(PUBLISHERS))
    with on_own_domain(60 + os.getpid() % 40):
        for subject in SUBJECTS:
            attacked = started(subject)
            try:
                if not attacked.wait_until_said(STARTED[subject.node], START):
                    yield _no_start(subject, attacked)
                    continue
                said = attacked.found(STARTED[subject.node])
                for count in PUBLISHERS:
                    yield flooded(subject, attacked, said, count, share, seed)
            finally:
                attacked.end()


def started(subject: Subject) -> AttackedNode:
    """Start a node that keeps no buffers and no large blocks: its memory is what it uses."""
    return node(subject.node, *subject.parameters, environment=NO_BUFFERS | GIVEN_BACK)


def _no_start(subject: Subject, attacked: AttackedNode) -> Trial:
    words = ' / '.join(list(attacked.lines)[-3:])
    first = f'{subject.node} did not start: {words}'
    return Trial('messages', subject.words, 'messages', 0, 1, 0.0, first=first)


def _check(name: str, attack: MessageAttack, said: str) -> Any:
    if name == 'viewer':
        return ViewerCheck(attack, said)
    return SimCheck(attack) if name == 'sim' else GaitCheck(attack)


def flooded(
    subject: Subject, attacked: AttackedNode, said: str, count: int, seconds: float, seed: int
) -> Trial:
    """
    Flood a node from some publishers.

    Parameters
    ----------
    subject : Subject
    attacked : AttackedNode
        Its process.
    said : str
        What it said when it had started; of the viewer it is the address of the page.
    count : int
        How many publishers, at least one a topic.
    seconds : float
        How long.
    seed : int

    Returns
    -------
    Trial
        What came of it.

    """
    name = subject.node
    attack = MessageAttack(name, subject.topics, count, seed)
    check = _check(name, attack, said)
    most_growth = COPIES * max(len(data) for data in attack.large) / 1e6
    first, violations, floods, most = '', 0, 0, 0.0
    begin, memory = time.monotonic(), list[float]()
    try:
        if not attack.until(attack.is_connected, CONNECT):
            violations, first = 1, f'{name} could not be reached'
        attack.send_largest(WARM)
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
            if len(memory) >= FEW and _growth(memory) > most_growth:
                problems.append(f'{name} grew by {_growth(memory):.0f} MB')
            violations += len(problems)
            if problems:
                first = f'seed {seed}, second {floods}: {problems[0]}'
    finally:
        attack.close()
    figures = f'{floods} floods, {most:.0f} bytes printed in a second at most'
    figures += f', {max(memory, default=math.nan):.0f} MB at most{_times(attack, check)}'
    publishers = f'{count} publisher{"s" * (count > 1)}'
    return Trial(
        'messages', f'{subject.words}, {publishers}', 'messages', attack.sent, violations,
        time.monotonic() - begin, attack.longest_answer, _growth(memory), figures, first,
    )  # fmt: skip


def _times(attack: MessageAttack, check: Any) -> str:
    """Return how long answers took, and a simulated robot to obey, as words."""
    words = ''
    if attack.answers:
        words = f', services in floods answered within {_spread(attack.answers)} s'
    if isinstance(check, SimCheck):
        words += f', {check.resets} resets after a divergence'
        words += f', good commands obeyed within {_spread(check.periods)} periods'
        words += f', under a flood within {_spread(check.under_flood)} s'
    return words


def _spread(values: Sequence[float]) -> str:
    """Return the median and the largest of some numbers, as words."""
    return f'{np.median(values):.2g} (at most {max(values):.2g})' if values else '?'


def _growth(memory: list[float]) -> float:
    """
    Return how much memory grew from the first half of some floods to the last one [MB].

    The least of a half counts, since each largest message takes memory for a while.
    """
    half = len(memory) // 2
    return min(memory[half:]) - min(memory[:half]) if half else math.nan
