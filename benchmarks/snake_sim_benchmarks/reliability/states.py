# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Random sequences of what anybody may do to `sim`: messages, requests and parameters.

The sequences are those of hypothesis, which is an optional package.
"""

from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
import os
import time
from typing import Any

from snake_sim_benchmarks.reliability.attack_checks import SimCheck
from snake_sim_benchmarks.reliability.attacked_node import AttackedNode, on_own_domain
from snake_sim_benchmarks.reliability.hostile_messages import TOPICS
from snake_sim_benchmarks.reliability.message_attack import MessageAttack
from snake_sim_benchmarks.reliability.messages import CONNECT, START, STARTED, started, SUBJECTS
from snake_sim_benchmarks.reliability.trials import Trial

EXAMPLES = 3  # sequences of one seed
PRINTED = 20_000  # bytes that the node may print in a second


def trials(seconds: float, seed: int) -> Iterator[Trial]:
    """Run sequences on one node for some time."""
    with on_own_domain(60 + os.getpid() % 40):
        (subject,) = (each for each in SUBJECTS if each.words == 'sim')
        attacked = started(subject)
        try:
            if attacked.wait_until_said(STARTED['sim'], START):
                yield sequences(attacked, seconds, seed)
            else:
                words = ' / '.join(list(attacked.lines)[-3:])
                yield Trial('states', 'sim', 'rules', 0, 1, 0.0, first=f'no start: {words}')
        finally:
            attacked.end()


def sequences(attacked: AttackedNode, seconds: float, seed: int) -> Trial:
    """Run sequences on a `sim` that has started, and return the trial."""
    if find_spec('hypothesis') is None:
        figures = 'not tried, since hypothesis is not installed: pip install hypothesis'
        return Trial('states', 'sim', 'rules', 0, 0, 0.0, figures=figures)
    states: Any = import_module('snake_sim_benchmarks.reliability.sim_states')
    attack = MessageAttack('sim', TOPICS['sim'], 1, seed)
    check = SimCheck(attack)
    own = {'node': attacked, 'attack': attack, 'check': check}
    machine: Any = type('Machine', (states.SimStates,), own)
    begin, printed, count, first = time.monotonic(), attacked.printed, 0, ''
    try:
        if not attack.until(lambda: attack.is_connected() and check.last, CONNECT):
            first = 'sim could not be reached'
        while not first and (count == 0 or time.monotonic() - begin < seconds):
            number = seed + count
            count += 1
            try:
                states.run_states(machine, EXAMPLES, number)
            except AssertionError as error:
                steps = ' / '.join(getattr(error, '__notes__', ()))
                first = f'seed {number}: {error}; {steps}'
    finally:
        attack.close()
    spent, said = time.monotonic() - begin, attacked.printed - printed
    if said > PRINTED * spent:
        first = first or f'seed {seed}: sim printed {said} bytes in {spent:.0f} s'
    figures = f'{count * EXAMPLES} sequences, {said / spent:.0f} bytes printed in a second'
    return Trial(
        'states', 'sim', 'rules', machine.tried, int(bool(first)), spent,
        attack.longest_answer, figures=figures, first=first,
    )  # fmt: skip
