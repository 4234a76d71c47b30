# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""All that clients may do to the node `sim`, in any order: a state machine of hypothesis."""

import random

from hypothesis import HealthCheck, Phase, seed, settings, strategies as st
from hypothesis.stateful import (
    initialize,
    invariant,
    rule,
    RuleBasedStateMachine,
    run_state_machine_as_test,
)
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from snake_sim_benchmarks.reliability.attack_checks import SimCheck
from snake_sim_benchmarks.reliability.attacked_node import AttackedNode
from snake_sim_benchmarks.reliability.hostile_messages import hostile_message, NAMES, TOPICS
from snake_sim_benchmarks.reliability.message_attack import MessageAttack

OBEYED = 10.0  # s for a joint to reach an angle, and for time to go on
REACHED = 0.1  # rad from an angle that counts as reached
MESSAGES = 20  # hostile ones in a row
YAW = NAMES.index('joint_5_yaw')
PARAMETERS = ('friction.longitudinal', 'command_horizon', 'no.such', 'dt')


class SimStates(RuleBasedStateMachine):
    """
    Messages, requests and parameters in random order, and what must hold after each of them.

    Attributes
    ----------
    node : AttackedNode
        The process of `sim`; a subclass has it.
    attack : MessageAttack
        On the topics of `sim`.
    check : SimCheck
    tried : int
        Rules so far.

    """

    node: AttackedNode
    attack: MessageAttack
    check: SimCheck
    tried = 0

    @initialize()
    def start(self) -> None:
        """Put the robot back to its start, and let time go on."""
        self.paused = False
        assert self.attack.ask(self.attack.services['pause'], SetBool.Request(data=False))
        assert self.attack.ask(self.attack.services['reset'], Trigger.Request())

    @rule(topic=st.integers(0, len(TOPICS['sim']) - 1), number=st.integers(0, 2**32))
    def hostile(self, topic: int, number: int) -> None:
        """Send hostile messages."""
        rng = random.Random(number)
        for _ in range(MESSAGES):
            self.attack.publish(topic, hostile_message(TOPICS['sim'][topic].kind, rng))

    @rule(angle=st.floats(-4.0, 4.0), axes=st.integers(1, 20), back=st.booleans())
    def far(self, angle: float, axes: int, back: bool) -> None:
        """Command angles that are far away, and maybe back and forth."""
        for k in range(4):
            way = -angle if back and k % 2 else angle
            command = JointState(name=NAMES[:axes], position=[way] * axes)
            self.check.commands.publish(command)
            self.attack.until(lambda: False, 0.005)

    @rule(paused=st.booleans())
    def pause(self, paused: bool) -> None:
        """Pause, or go on."""
        answer = self.attack.ask(self.attack.services['pause'], SetBool.Request(data=paused))
        assert answer and answer.success, 'no answer of ~/pause'
        self.paused = paused

    @rule()
    def reset(self) -> None:
        """Put the robot back to its start."""
        answer = self.attack.ask(self.attack.services['reset'], Trigger.Request())
        assert answer and answer.success, 'no answer of ~/reset'

    @rule(name=st.sampled_from(PARAMETERS), value=st.floats(allow_nan=True))
    def parameter(self, name: str, value: float) -> None:
        """Set a parameter, which the node may refuse."""
        why = self.attack.set({name: value})
        assert not why.startswith('no answer'), f'{name}: {why}'

    @rule()
    def good(self) -> None:
        """Give a good command, which is obeyed, whatever came before."""
        if self.paused:
            return
        target = -0.2 if self.check.last.position[YAW] > 0.0 else 0.2
        angles = [target if name.endswith('yaw') else 0.0 for name in NAMES]
        self.check.commands.publish(JointState(name=NAMES, position=angles))

        def is_there() -> bool:
            return abs(self.check.last.position[YAW] - target) < REACHED

        assert self.attack.until(is_there, OBEYED), 'a good command was not obeyed'

    @invariant()
    def holds(self) -> None:
        """Joints are within their limits; time goes on unless it is paused."""
        type(self).tried += 1
        assert self.node.is_alive, 'sim ended'
        stamp = self.check.stamp
        if not self.paused:
            going = self.attack.until(lambda: self.check.stamp > stamp, OBEYED)
            assert going, f'time stands still at {stamp:g} s'
        assert not (wrong := '; '.join(self.check.excesses())), wrong


def run_states(machine: type[SimStates], examples: int, number: int) -> None:
    """Run some sequences of rules that a number determines; raise AssertionError if one fails."""
    run_state_machine_as_test(
        seed(number)(machine),
        settings=settings(
            max_examples=examples, stateful_step_count=10, deadline=None, database=None,
            phases=[Phase.generate], suppress_health_check=list(HealthCheck),
        ),
    )  # fmt: skip
