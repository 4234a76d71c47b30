# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What must hold of a node after each second of an attack: sentences on what does not."""

from collections.abc import Callable, Iterator
import math
import time
from typing import Any
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
from rcl_interfaces.srv import SetParameters
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from snake_sim_benchmarks.reliability.hostile_messages import good_message, NAMES, TIME
from snake_sim_benchmarks.reliability.message_attack import ANSWER, MessageAttack
from snake_sim_ros import Robot
from snake_sim_ros.nodes.messages import seconds_from

PERIOD = 0.005  # s of a publish period
OBEYED = 2  # periods after which a good command is obeyed, besides one that was under way
COMMANDS = 3  # that are given when a flood was served, of which the fastest is judged
SERVED = 0.02  # s for an answer when nothing waits before it
STILL = 0.1  # s for which joints hold still before a good command
WAIT = 2.0  # s for a message that must come at once
BEYOND = 0.01  # by which joints may be beyond limits: a stop ends a motion at the end of a step
TOO_FAST = 0.03  # as a share; rates at the end of a step are measured with the drift of joints
SLOW = 0.5  # rad/s of a joint that holds still
# Angle [rad] by which a joint is commanded to turn, and from which on it has obeyed: the travel of
# two periods at its rate limit, 10 rad/s. Damping of a joint at rest adds 0.05 rad at most.
TURN, TURNED = 0.3, 0.1
DEFAULTS: dict[str, float | bool] = {
    **{'robot.yaw_stiffness': 40.0, 'friction.longitudinal': 0.1, 'real_time_factor': 1.0},
    'use_sim_time': False,
}


class SimCheck:
    """
    Watches `sim`: its time, its joints, and whether it obeys.

    Attributes
    ----------
    resets : int
        How often the robot had to be put back to its start, since a step diverged.
    angle, rate : float
        Largest of all joint_states [rad], [rad/s].
    under_flood : list of float
        Times after which a good command was obeyed under a flood of damaged ones [s].
    periods : list of int
        Publish periods after which good commands were obeyed when a flood was served.
    last : JointState
        The newest of all joint_states.
    stamp : float
        Its time [s].

    """

    def __init__(self, attack: MessageAttack) -> None:
        self.attack, self.robot = attack, Robot()
        self.resets, self.angle, self.rate = 0, 0.0, 0.0
        self.under_flood, self.periods = list[float](), list[int]()
        self._wrong, self.stamp = '', -math.inf
        self._begin, self._published, self._told = -math.inf, -math.inf, math.inf
        self.last: Any = None
        attack.node.create_subscription(
            JointState, 'joint_states', self._on_states, QoSProfile(depth=50)
        )
        self.commands = attack.node.create_publisher(JointState, 'joint_command', 1)

    def _on_states(self, message: JointState, info: dict[str, int]) -> None:
        stamp = seconds_from(message.header.stamp)
        self._published = 1e-9 * info['source_timestamp']
        if self._published <= self._told:
            self._begin = stamp
        if stamp < self.stamp:
            self._wrong = f'the stamp went back from {self.stamp:g} s to {stamp:g} s'
        self.last, self.stamp = message, stamp
        angle, rate = (np.array(part) for part in (message.position, message.velocity))
        if not np.isfinite([*angle, *rate, *message.effort]).all():
            self._wrong = 'joint_states are not finite'
            return
        self.angle = max(self.angle, float(np.abs(angle).max()))
        self.rate = max(self.rate, float(np.abs(rate).max()))

    def problems(self) -> Iterator[str]:
        """Yield a sentence on each promise that is broken."""
        attack = self.attack
        if why := attack.set(DEFAULTS):
            yield f'good parameters were refused: {why}'
        if not attack.ask(attack.services['pause'], SetBool.Request(data=False)):
            yield 'no answer of ~/pause'
        before = self.stamp
        if not attack.until(lambda: self.stamp > before, WAIT):
            self.resets += 1
            attack.ask(attack.services['reset'], Trigger.Request())
            attack.ask(attack.services['pause'], SetBool.Request(data=False))
            if not attack.until(lambda: self.stamp > before, WAIT):
                yield 'time stands still, even after ~/reset'
                return
        yield from self._disobedience()
        yield from self.excesses()

    def excesses(self) -> Iterator[str]:
        """Yield a sentence on each limit that a state since the last call was beyond."""
        if self.angle > self.robot.joint_limit + BEYOND:
            yield f'a joint was at {self.angle:.4g} rad'
        if self.rate > self.robot.joint_rate_limit * (1.0 + TOO_FAST):
            yield f'a joint turned at {self.rate:.4g} rad/s'
        if self._wrong:
            yield self._wrong
        self.angle, self.rate, self._wrong = 0.0, 0.0, ''

    def _disobedience(self) -> Iterator[str]:
        """Yield a sentence if good commands are not obeyed at once."""
        attack, (turn, obeys) = self.attack, self._turn()
        under_flood = attack.flood_until(obeys, serialize_message(turn), WAIT)
        if math.isnan(under_flood):
            yield 'a good command under a flood of damaged ones was not obeyed'
        self.under_flood.append(under_flood)
        if not attack.until(self._is_served, ANSWER):
            yield f'the flood was not served within {ANSWER:g} s'
        for _ in range(COMMANDS):
            self._told = math.inf
            turn, obeys = self._turn()
            if not attack.until(lambda: obeys() or self._send(turn), WAIT):  # noqa: B023
                yield 'a good command was not obeyed'
                return
            self.periods.append(round((self.stamp - self._begin) / PERIOD))
        if min(self.periods[-COMMANDS:]) > OBEYED + 1:
            yield f'good commands were obeyed after {self.periods[-COMMANDS:]} periods'

    def _send(self, command: JointState) -> bool:
        """
        Publish a command once more, as a stream does, since a single one may get lost.

        Time runs from the last state that was published before the first of them, which may still
        wait to be read here: this process may have to wait for the machine, too.
        """
        self.commands.publish(command)
        self._told = min(self._told, time.time())
        return False

    def _is_served(self) -> bool:
        """Return whether a request is answered at once, so that none waits before it."""
        begin = time.monotonic()
        self.attack.ask(self.attack.parameters, SetParameters.Request())
        return time.monotonic() - begin < SERVED

    def _turn(self) -> tuple[JointState, Callable[[], bool]]:
        """Have joints hold still; return a command that turns one, and whether it is obeyed."""
        command = JointState(name=NAMES, position=list(self.last.position))
        self.commands.publish(command)
        k, end = NAMES.index('joint_5_yaw'), time.time() + STILL
        self.attack.until(lambda: self._published > end, WAIT)
        self.attack.until(lambda: abs(self.last.velocity[k]) < SLOW, WAIT)
        before = self._reference(k)
        way = -1.0 if before > 0.0 else 1.0
        command.position[k] = before + way * TURN
        return command, lambda: (self._reference(k) - before) * way > TURNED

    def _reference(self, joint: int) -> float:
        """
        Return the reference of a joint [rad], estimated from its angle and torque.

        A robot that was thrown may press on a joint so hard that it neither turns much when
        commanded nor needs more torque: a large torque already held it at another reference.
        """
        torque = self.last.effort[joint]
        return float(self.last.position[joint] + torque / DEFAULTS['robot.yaw_stiffness'])


class GaitCheck:
    """
    Watches the commands of `gait`, which wait while joint_states or the time are nonsense.

    Parameters
    ----------
    attack : MessageAttack
        If it attacks /clock, the node is to go by it, and has a good one after each flood.

    """

    def __init__(self, attack: MessageAttack) -> None:
        self.attack, self.robot, self._wrong, self.count = attack, Robot(), '', 0
        self.clock = None
        if TIME in attack.topics:
            self.clock = attack.node.create_publisher(TIME.kind, TIME.name, 1)
        attack.node.create_subscription(
            JointState, 'joint_command', self._on_command, QoSProfile(depth=50)
        )

    def _on_command(self, message: JointState) -> None:
        self.count += 1
        angle = np.abs(message.position).max(initial=0.0)
        rate = np.abs(message.velocity).max(initial=0.0)
        limits = self.robot.joint_limit, self.robot.joint_rate_limit
        if not (angle <= limits[0] + 1e-9 and rate <= limits[1] + 1e-9):
            self._wrong = f'a command had {angle:.4g} rad and {rate:.4g} rad/s'

    def problems(self) -> Iterator[str]:
        """Yield a sentence on each promise that is broken."""
        attack, before = self.attack, self.count
        if why := attack.set({'use_sim_time': self.clock is not None}):
            yield f'a good parameter was refused: {why}'
        if attack.ask(attack.services['restart'], Trigger.Request()) is None:
            yield 'no answer of ~/restart'
        if not attack.until(lambda: self._commands_after(before), 3 * WAIT):
            yield 'no commands after the attack'
        if self._wrong:
            yield self._wrong
        self._wrong = ''

    def _commands_after(self, count: int) -> bool:
        """Tell the time if the node goes by it; return whether more commands came."""
        if self.clock:
            self.clock.publish(good_message(TIME.kind, self.attack.rng))
        return self.count > count


class ViewerCheck:
    """Looks at the page of `viewer`."""

    def __init__(self, attack: MessageAttack, url: str) -> None:
        self.attack, self.url = attack, url

    def problems(self) -> Iterator[str]:
        """Yield a sentence on each promise that is broken."""
        try:
            with urlopen(self.url, timeout=WAIT) as page:
                page.read()
        except (OSError, URLError) as error:
            yield f'the page is not served: {error}'
        if why := self.attack.set({'use_sim_time': False}):
            yield f'a good parameter was refused: {why}'
