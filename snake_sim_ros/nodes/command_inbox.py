# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The joint commands that the node `sim` receives, and the reference that holds after them."""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeVar

from builtin_interfaces.msg import Time
import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory

from snake_sim_ros.gaits.joint_reference import (
    JointReference,
    LimitedReference,
    Motion,
    start_posture,
)
from snake_sim_ros.nodes.control_modes import ControlModes
from snake_sim_ros.nodes.executors import Refusals, ThrottledWarnings
from snake_sim_ros.nodes.messages import seconds_from
from snake_sim_ros.nodes.received_commands import (
    extrapolated,
    joint_command,
    joint_trajectory,
    jump_between,
    KINDS,
    position_commands,
    ReceivedCommand,
    ReceivedTrajectory,
    RejectedCommand,
    STREAM,
)
from snake_sim_ros.nodes.sim_parameters import Settings
from snake_sim_ros.scene.parameters import Array, Robot
from snake_sim_ros.stepping.controlled import command_effort, commanded_effort
from snake_sim_ros.stepping.levels import is_vertical, what_is_commanded
from snake_sim_ros.stepping.sampling import joint_motion
from snake_sim_ros.stepping.simulation import Simulation

C = TypeVar('C', bound=ReceivedCommand)
LATEST = QoSProfile(depth=1)  # A newer command replaces one that waits.
# Bytes of a trajectory, read in half a publish period of 5 ms: 275 points of 20 joints with
# velocities, or 500 without. rclpy makes objects of them, 6 us a point, and holds the GIL for it,
# so that a second thread would not help; 10 000 points take 60 ms, and 30 ms to be checked.
LARGEST = 100_000
# Distance of all joints from their commands [rad] up to which a JointStateTopicSystem of
# ros2_control sends no more commands: its default trigger_joint_command_threshold.
REACHED = 1e-5


class Tracked(NamedTuple):
    """Where the joints of a trajectory are commanded to be and where they are, shape (k,)."""

    commanded_angle: Array  # [rad]
    commanded_rate: Array  # [rad/s]
    angle: Array  # [rad]
    rate: Array  # [rad/s]


class CommandInbox:
    """
    Takes joint commands from three topics and keeps the reference that the joints follow.

    Parameters
    ----------
    node : Node
        The node that subscribes.
    simulation : Simulation
        The inbox reads the scene and the simulated time from it.
    settings : Settings
    warn : ThrottledWarnings

    Attributes
    ----------
    settings : Settings
        The node replaces them when its parameters change.
    clamped : int
        How many commands were clamped to the joint limit.
    limiter : LimitedReference
        Leads joints to their commands, no faster than they may turn.
    modes : ControlModes
        Which joints follow torques alone.
    is_open : bool
        Whether commands are taken, see `open`.
    watch : callable, optional
        Called with the simulated time before every sample [s].

    """

    def __init__(
        self, node: Node, simulation: Simulation, settings: Settings, warn: ThrottledWarnings
    ) -> None:
        self.settings = settings
        self.clamped = 0
        self.watch: Callable[[float], None] | None = None
        self._warn, self._log = warn, node.get_logger()
        self._confirmed = False  # whether the first command was
        self._refusals = Refusals(warn)
        self._topics: dict[str, Any] = {}  # with types, on which commands came in this interval
        self._others = OtherPublishers(node)
        self.begin(simulation)
        self._subscribe(node)

    def begin(self, simulation: Simulation) -> None:
        """Lead the robot of a simulation from its start on; commands are taken after `open`."""
        self.is_open = False
        self._simulation, self.modes = simulation, ControlModes(simulation)
        self._unclaimed = np.ones((len(KINDS), self.modes.free.size), dtype=bool)
        self._reference = start_posture(simulation.scene)
        self.limiter = LimitedReference(self._reference.angle)
        self._heard: float | None = None  # simulated time of the last command [s]
        self._void = 0.0  # time up to which stamped commands are void [s]
        self._stream = ''  # topic on which commands follow each other
        self._silent = ''  # topic of a stream that stopped
        self._early: dict[str, Callable[[], None]] = {}  # topic -> how to take its last command
        self._limited: JointReference | None = None  # the last one reported to exceed the limit

    def _subscribe(self, node: Node) -> None:
        node.create_subscription(
            JointState,
            'joint_command',
            partial(self._on_command, 'joint_command', self._read),
            LATEST,
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )
        node.create_subscription(
            Float64MultiArray,
            'position_commands',
            partial(self._on_command, 'position_commands', position_commands),
            LATEST,
        )
        # As bytes, whose number is known before time is spent on them.
        node.create_subscription(
            JointTrajectory, 'joint_trajectory', self._on_trajectory, LATEST, raw=True
        )

    # ---- what the joints follow -----------------------------------------------------------------

    def sample(self, times: Array) -> tuple[Array, Array]:
        """
        Return the joint reference at coming times; warn of silence and of the joint limit.

        Parameters
        ----------
        times : ndarray, shape (m,)
            Increasing, from the simulated time on [s].

        Returns
        -------
        angle, rate : ndarray, shape (m, n-1, 2)
            (yaw, pitch) [rad], [rad/s].

        """
        if self.watch:
            self.watch(self._simulation.time)
        self._reference = self._reference.settled(self._simulation.time)
        self._watch_silence()
        self._watch_limit(times[-1])
        return self.limiter.limited(
            times,
            *self._sampled(times, self.settings.command_horizon),
            period=1.0 / self.settings.publish_rate,
            limit=self._simulation.scene.robot.limits.rate,
        )

    @property
    def rejected(self) -> int:
        """How many commands were rejected."""
        return self._refusals.count

    def open(self) -> None:
        """Take commands from now on, first those that came while the physics was compiled."""
        self.is_open = True
        early, self._early = self._early, {}
        for take in early.values():
            take()

    def commanded_angle(self) -> Array:
        """Return the commanded joint angles at the simulated time [rad], shape (n-1, 2)."""
        angle, _ = self._sampled(np.array([self._simulation.time]), 0.0)
        return angle[0]

    def hold(self, angle: Array | None = None, *, runs: bool = False) -> None:
        """
        Make all commands void; hold an angle instead.

        Parameters
        ----------
        angle : ndarray, shape (n-1, 2), optional
            Joint angles that hold from the simulated time on [rad]; default: those of the start.
        runs : bool, optional
            Whether time runs by itself. Commands stamped up to now are then those that were
            under way, and void, too; in lock-step they may be answers to the new state.

        """
        self._early.clear()
        now = self._simulation.time
        if angle is not None:
            angle = np.where(self.modes.free, self._measured_angle(), angle)
        self.modes.reset()
        self._unclaimed[:] = True
        self._void = now + 1e-6 if runs else 0.0  # stamps are rounded
        if angle is None:
            self._reference = start_posture(self._simulation.scene, now)
        else:
            stamp = np.full(angle.shape, now)
            self._reference = JointReference(stamp, angle, np.zeros_like(angle))
        self.limiter.start(self._reference.angle, now)
        self._heard, self._stream, self._silent = None, '', ''

    def take_trajectory(self, message: JointTrajectory) -> Motion:
        """Take a trajectory at once; raise RejectedCommand if it is not usable."""

        def read() -> ReceivedTrajectory:
            if not self.is_open:
                raise RejectedCommand('early', 'no goal is taken before the physics is ready')
            return self._placed(message)

        return self._take('joint_trajectory', read).motion

    def follows(self, motion: Motion) -> bool:
        """Return whether the joints of a trajectory still follow it, or wait for its begin."""
        return any(
            item.times is motion.times and np.array_equal(item.axes, motion.axes)
            for item in self._reference.motions
        )

    def tracked(self, motion: Motion) -> Tracked:
        """Return where the joints of a trajectory are commanded to be, and where they are."""
        state, now = self._simulation.state, np.array([self._simulation.time])
        numbers = (
            *self._sampled(now, 0.0),
            *joint_motion(self._simulation.scene.robot, state.q[None], state.u[None]),
        )
        signs = self._simulation.scene.robot.place_signs[motion.axes]
        return Tracked(*(signs * values.reshape(-1)[motion.axes] for values in numbers))

    def stop(self, motion: Motion) -> None:
        """Hold the joints of a trajectory where they are commanded to be at the simulated time."""
        angle, axes = self.commanded_angle().ravel()[motion.axes], motion.axes
        now, still = self._simulation.time, np.zeros(len(axes))
        self._reference = self._reference.commanded(axes, now, angle, still)

    def _measured_angle(self) -> Array:
        """Return the joint angles as they are, shape (n-1, 2) [rad]."""
        state = self._simulation.state
        angle, _ = joint_motion(self._simulation.scene.robot, state.q[None], state.u[None])
        return angle[0]

    def _sampled(self, times: Array, horizon: float) -> tuple[Array, Array]:
        return self._reference.sample(times, horizon, self._simulation.scene.robot.limits)

    # ---- what came ------------------------------------------------------------------------------

    def _on_command(
        self, topic: str, read: Callable[..., ReceivedCommand], message: JointState
    ) -> None:
        stamp = seconds_from(message.header.stamp) if hasattr(message, 'header') else 0.0
        if not 0.0 < stamp <= self._void or not self.settings.publish_clock:
            self._when_open(topic, type(message), lambda: self._command_with(topic, read, message))

    def _read(
        self, message: JointState, last: JointReference, robot: Robot, now: float
    ) -> ReceivedCommand:
        if self._heard is None or now - self._heard > STREAM:
            self._unclaimed[:] = True  # Controllers may have been started anew.
        horizon = self.settings.command_horizon
        return joint_command(message, last, robot, now, horizon, self._unclaimed)

    def _on_trajectory(self, data: bytes) -> None:
        def read() -> ReceivedTrajectory:
            if len(data) > LARGEST:
                raise RejectedCommand(
                    'large',
                    f'joint_trajectory: a message of {len(data)} bytes takes too long to read; at '
                    f'most {LARGEST}, about 275 points of 20 joints with velocities. Send the '
                    f'rest as trajectories that begin later',
                )
            try:
                message = deserialize_message(data, JointTrajectory)
            except (RuntimeError, UnicodeDecodeError):
                raise RejectedCommand('bytes', 'joint_trajectory: a message is damaged') from None
            return self._placed(message)

        self._when_open('joint_trajectory', JointTrajectory, read)

    def _when_open(self, topic: str, kind: Any, read: Callable[[], ReceivedCommand]) -> None:
        """Take a command now or, as the last one of its topic, when commands are taken."""
        self._topics[topic] = kind
        if self.is_open:
            with suppress(RejectedCommand):
                self._take(topic, read)
        else:
            self._early.pop(topic, None)  # It goes to the end.
            self._early[topic] = lambda: self._when_open(topic, kind, read)

    def _command_with(
        self, topic: str, read: Callable[..., ReceivedCommand], message: Any
    ) -> ReceivedCommand:
        """Return the effect of a command, and whether joints jump to it."""
        if not self.settings.publish_clock and hasattr(message, 'header'):
            # The stamp belongs to a clock that another node makes. Zero means now.
            message.header.stamp = Time()
        scene, now = self._simulation.scene, self._simulation.time
        last = self._reference_from_torques(now)
        command, settings = read(message, last, scene.robot, now), self.settings
        if self._heard is None:  # There was no command yet, from which joints could have come.
            last = replace(last, stamp=np.full_like(last.stamp, -np.inf))
        jump = jump_between(
            *(topic, last, command.reference, scene.robot, now),
            horizon=settings.command_horizon,
            period=1.0 / settings.publish_rate,
        )
        return replace(command, jump=jump) if jump else command

    def _placed(self, message: JointTrajectory) -> ReceivedTrajectory:
        """Return the effect of a trajectory that begins now or at its stamp."""
        if not self.settings.publish_clock:
            message.header.stamp = Time()
        now, horizon = self._simulation.time, self.settings.command_horizon
        robot = self._simulation.scene.robot
        last = self._reference_from_torques(now)
        return joint_trajectory(message, last, robot, now, horizon)

    def _reference_from_torques(self, now: float) -> JointReference:
        """Return the reference with axes that follow torques where they are, for what is next."""
        if not self.modes.free.any():
            return self._reference
        free = np.flatnonzero(self.modes.free)
        limits = self._simulation.scene.robot.limits
        angle = np.clip(self._measured_angle(), limits.low, limits.high).ravel()[free]
        self.limiter.resume(free, angle)
        there = self._reference.commanded(free, now, angle, np.zeros(len(free)))
        return replace(there, stamp=self._reference.stamp)

    def _take(self, topic: str, read: Callable[[], C]) -> C:
        """Take a command; if it is rejected, warn why and raise."""
        now = self._simulation.time
        try:
            command = read()
            if self._simulation.scene.level == 'planar':
                _refuse_vertical(topic, command, self._simulation.scene.robot)
        except RejectedCommand as error:
            self.reject(error)
            raise
        if not command.given[1].any():  # No controller has claimed a joint.
            return command
        self._reference = command.reference
        self._switch(command)
        if command.clamped:
            self.clamped += 1
            self._warn('clamped', command.clamped)
        if command.jump:
            self._warn('jump', command.jump)
        follows = self._heard is not None and now - self._heard <= self.settings.command_timeout
        self._stream = topic if follows else ''
        self._heard, self._silent = now, ''
        if not self._confirmed:
            self._confirmed = True
            self._log.info(f'first command taken: {topic} {what_of(command)}')
        return command

    def _switch(self, command: ReceivedCommand) -> None:
        """Let the joints of a command be moved by what it has: references, torques, or both."""
        axes, given = command.given
        self._unclaimed[:, axes] &= ~given
        if not (command.effort or self.modes.free.any()):  # All controllers are on, and stay so.
            return
        by_reference = given[0] | given[1]
        back = axes[by_reference & self.modes.free.flat[axes]]
        if command.effort or len(back):
            effort = commanded_effort(self._simulation)
            effort.flat[back] = 0.0
            if command.effort:
                which, torques = command.effort
                effort.flat[which] = torques
            command_effort(self._simulation, effort)
        some = by_reference | given[2]
        self.modes.switch(axes[some], off=~by_reference[some])
        self._reference = self._reference_from_torques(self._simulation.time)

    def reject(self, error: RejectedCommand) -> None:
        """Count a command that is rejected, and warn why."""
        self._refusals.add(error.kind, f'{error}; the last good command is held')

    def _watch_silence(self) -> None:
        """Warn when a stream of commands stops; its last command is held in any case."""
        timeout = self.settings.command_timeout
        if not self._stream or not timeout or self._reference.motions:
            return
        if self._heard is not None and self._simulation.time - self._heard > timeout:
            if self._has_arrived():
                return
            self._warn('silent', f'no {self._stream} for {timeout:g} s; the last one is held')
            self._stream, self._silent = '', self._stream

    def _has_arrived(self) -> bool:
        """Return whether all joints are at rest at their commands, so that nobody repeats them."""
        if self._reference.rate.any():
            return False
        off = np.abs(self._measured_angle() - self._reference.angle)
        return float(off[~self.modes.free].sum()) <= REACHED

    def _watch_limit(self, now: float) -> None:
        """Warn when a command goes beyond the joint limit with its velocity."""
        reference = self._reference
        if reference is self._limited or reference.motions:
            return
        clamped = extrapolated(
            reference, self._simulation.scene.robot, now, self.settings.command_horizon
        )
        if clamped:
            self._limited = reference
            self.clamped += 1
            self._warn('clamped', clamped)

    # ---- what is reported -----------------------------------------------------------------------

    def remarks(self) -> list[str]:
        """Return a sentence each on the last rejection and on a stream that stopped."""
        remarks = self._refusals.remarks()
        if self._silent:
            remarks.append(f'no {self._silent} any more; the last one is held')
        return remarks

    def close(self) -> None:
        """Listen to no other publishers any more."""
        self._others.close()

    def end_interval(self) -> None:
        """Begin the next interval of diagnostics, after a look for other publishers."""
        self._others.look(self._topics, clock=self.settings.publish_clock)
        self._topics = {}


def what_of(command: ReceivedCommand) -> str:
    """Return how many joints a command moves, and by what, such as `20 joints by position`."""
    _, given = command.given
    kinds = [kind for kind, row in zip(KINDS, given, strict=True) if row.any()]
    count = int(given.any(axis=0).sum())
    joints = 'joint' if count == 1 else 'joints'
    return f'moves {count} {joints} by {" and ".join(kinds) or "nothing"}'


def _refuse_vertical(topic: str, command: ReceivedCommand, robot: Robot) -> None:
    """Raise if a command moves pitch joints, which the planar level cannot."""
    reference = command.reference
    commanded = 'a pitch joint is commanded to move' if command.moves_pitch else ''
    if is_vertical(reference.angle, reference.rate):
        commanded = what_is_commanded(robot, reference.angle, reference.rate)
    if commanded:
        raise RejectedCommand('pitch', f'{topic}: {commanded}, but level is planar')


# ---- other publishers ---------------------------------------------------------------------------

CLOCK = '/clock'
COUNTS = 'the last message counts'  # of commands
UNKNOWN = '_NODE_NAME_UNKNOWN_'  # of a node that is about to come, or has just gone
HEARD = 1000  # messages that may come between two looks


class OtherPublishers:
    """
    Warns, once each, of topics on which messages of several nodes come.

    The graph says who may publish. It still has a node that was killed for up to 20 s, so nobody
    is named for being there: after the first look at several publishers of a topic, the messages
    on it are heard, and the second look shows whether they come from several.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._said: list[tuple[str, set[str]]] = []  # topics and names
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

    def close(self) -> None:
        """Hear no more messages."""
        while self._listeners:
            self._listeners.popitem()[1].close()

    def _speakers(self, topic: str) -> list[str]:
        return sorted(
            f'{info.node_namespace.rstrip("/")}/{info.node_name}'
            for info in self._node.get_publishers_info_by_topic(topic)
            if info.node_name not in ('', UNKNOWN)
        )

    def _look_at(self, topic: str, kind: Any, nodes: list[str], advice: str) -> None:
        """Warn if messages of a topic come from several of its publishers, at the second look."""
        what, listener = f'{topic} has', self._listeners.pop(topic, None)
        if len(nodes) > 1 and not self._was_said(what, nodes):
            self._listeners[topic] = listener or Listener(self._node, topic, kind)
            if listener and listener.hears_several():
                self._tell(what, nodes, advice)
        elif listener:
            listener.close()

    def _was_said(self, what: str, nodes: list[str]) -> bool:
        return any(what == said and set(nodes) <= names for said, names in self._said)

    def _tell(self, what: str, nodes: list[str], advice: str) -> None:
        if not self._was_said(what, nodes):
            self._said.append((what, set(nodes)))
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
