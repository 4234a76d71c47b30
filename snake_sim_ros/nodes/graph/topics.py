# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The commands `topic list`, `topic echo`, `topic hz` and `topic pub`."""

from functools import partial
from itertools import pairwise
import statistics
import time
from typing import Any

from rclpy.duration import Duration
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import DurabilityPolicy, qos_profile_sensor_data, QoSProfile, ReliabilityPolicy
from rclpy.validate_full_topic_name import validate_full_topic_name

from snake_sim_ros.nodes.graph.client import absolute, Client, GraphError, QUIET
from snake_sim_ros.nodes.graph.message_fields import (
    as_yaml,
    field_of,
    filled,
    interface,
    is_message,
)

SENT_TIMEOUT = 1.0  # s for readers to confirm the last message
REPORT_PERIOD = 1.0  # s between two rates
SUBSCRIBERS_PERIOD = 1.0  # s between two lines that say what is waited for


def list_topics(client: Client, show_types: bool, count: bool, hidden: bool) -> None:
    """Print the names of topics."""
    client.look_around()
    print_names(client.topics(hidden), show_types, count)


def print_names(found: list[tuple[str, list[str]]], show_types: bool, count: bool) -> None:
    """Print names, with their types if wanted, or only how many there are."""
    if count:
        print(len(found))
        return
    for name, types in found:
        print(f'{name} [{", ".join(types)}]' if show_types else name)


def echo(
    client: Client,
    topic: str,
    type_name: str | None,
    *,
    field: str,
    once: bool,
    timeout: float,
    longest: int | None,
    flow_style: bool,
) -> None:
    """
    Print the messages of a topic.

    Parameters
    ----------
    client : Client
    topic : str
    type_name : str, optional
        Default: what the graph says.
    field : str
        Names with dots between them; '' is the whole message.
    once : bool
        End after the first message.
    timeout : float
        Time after which it ends [s].
    longest : int, optional
        Elements of an array or a text that are shown; default: all.
    flow_style : bool
        On one line.

    """
    topic = _checked(topic)
    kind = interface(type_name, 'msg') if type_name else None
    kind = _kind_of(client, topic, type_name, kind)
    field_of(kind(), field)
    messages: list[Any] = []
    client.node.create_subscription(kind, topic, messages.append, _offered(client, topic))
    end = time.monotonic() + timeout
    while (left := end - time.monotonic()) > 0:
        client.spin(left)
        while messages:
            value = field_of(messages.pop(0), field)
            print(
                as_yaml(value, longest, flow_style) if is_message(value) else f'{value}\n',
                end='---\n',
            )
            if once:
                return


def rate(client: Client, topic: str, window: int) -> None:
    """
    Print once a second how often messages of a topic come.

    Parameters
    ----------
    client : Client
    topic : str
    window : int
        Periods to average over, at most.

    """
    topic = _checked(topic)
    kind = _kind_of(client, topic, None, None)
    times: list[float] = []
    take = partial(_note_time, times)
    client.node.create_subscription(kind, topic, take, qos_profile_sensor_data, raw=True)
    reported = time.monotonic()
    while True:
        client.spin(1.0)
        del times[: -window - 1]
        if len(times) > 1 and times[-1] > reported + REPORT_PERIOD:
            reported = times[-1]
            print(_rate_of(times))


def _note_time(times: list[float], data: bytes) -> None:
    times.append(time.monotonic())


def _rate_of(times: list[float]) -> str:
    periods = [later - earlier for earlier, later in pairwise(times)]
    return (
        f'average rate: {len(periods) / (times[-1] - times[0]):.3f}\n'
        f'\tmin: {min(periods):.3f}s max: {max(periods):.3f}s '
        f'std dev: {statistics.pstdev(periods):.5f}s window: {len(periods)}'
    )


def publish(
    client: Client,
    topic: str,
    type_name: str,
    values: str,
    *,
    frequency: float,
    times: int,
    readers: int,
    patience: float,
    print_each: int,
) -> None:
    """
    Publish a message on a topic.

    Parameters
    ----------
    client : Client
    topic, type_name : str
    values : str
        YAML.
    frequency : float
        [Hz]
    times : int
        0 is without end.
    readers : int
        Subscriptions to wait for.
    patience : float
        Time to wait for them [s].
    print_each : int
        Every how manyth message is printed; 0 is none.

    """
    topic = _checked(topic)
    kind = interface(type_name, 'msg')
    message = filled(kind(), values)
    publisher = client.node.create_publisher(kind, topic, 10)
    wanted = partial(_heard_by, client, topic, full_name(kind), publisher, readers)
    end, announced = time.monotonic() + patience, False
    while not client.until(wanted, SUBSCRIBERS_PERIOD if announced else QUIET):
        announced = True
        if time.monotonic() > end:
            count = publisher.get_subscription_count()
            raise GraphError(
                f'Timed out waiting for subscribers: Expected {readers} subscribers of {topic} '
                f'but only got {count} subscribers'
            )
        print(f'Waiting for at least {readers} matching subscription(s)...')
    print('publisher: beginning loop')
    count, due = 0, time.monotonic()
    while True:
        count += 1
        if print_each and count % print_each == 0:
            print(f'publishing #{count}: {message!r}\n')
        publisher.publish(message)
        if count == times:
            break
        due += 1.0 / frequency
        client.until(lambda: False, due - time.monotonic())
    publisher.wait_for_all_acked(Duration(seconds=SENT_TIMEOUT))


def _heard_by(client: Client, topic: str, kind: str, publisher: Any, readers: int) -> bool:
    """Return whether enough nodes listen; raise if they listen to something else."""
    _refuse_other(topic, kind, client.types_of(topic))
    return bool(publisher.get_subscription_count() >= readers)


def _kind_of(client: Client, topic: str, wanted: str | None, kind: Any) -> Any:
    """Return the class of the messages of a topic, once it is there."""
    found = client.until(lambda: client.types_of(topic), client.patience)
    if kind is not None:
        _refuse_other(topic, full_name(kind), found)
    elif not found:
        raise GraphError(
            f'Could not determine the type for the passed topic: nobody publishes {topic} or '
            f'listens to it'
        )
    elif len(found) > 1:
        raise GraphError(
            f"Cannot echo topic '{topic}', as it contains more than one type: [{', '.join(found)}]"
        )
    else:
        kind = interface(found[0], 'msg')
    # A topic may be known by its readers before those who publish are found.
    client.until(lambda: client.node.count_publishers(topic), QUIET)
    return kind


def _refuse_other(topic: str, kind: str, found: list[str]) -> None:
    others = [name for name in found if name != kind]
    if others:
        raise GraphError(f'{topic} is of type {", ".join(others)}, not {kind}')


def full_name(kind: Any) -> str:
    """Return the name ``package/msg/Name`` of a class of messages or services."""
    package, middle, *_ = kind.__module__.split('.')
    return f'{package}/{middle}/{kind.__name__}'


def _offered(client: Client, topic: str) -> QoSProfile:
    """Return a profile that fits all who publish, reliable and latched where all are."""
    offers = [info.qos_profile for info in client.node.get_publishers_info_by_topic(topic)]
    reliable = [offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers]
    latched = [offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers]
    profile = QoSProfile(depth=qos_profile_sensor_data.depth)
    for name, some in (('RELIABLE', reliable), ('TRANSIENT_LOCAL', latched)):
        if any(some) and not all(some):
            print(f'Some, but not all, publishers are offering {name}: doing without it')
    everywhere = bool(offers)
    profile.reliability = (
        ReliabilityPolicy.RELIABLE
        if everywhere and all(reliable)
        else ReliabilityPolicy.BEST_EFFORT
    )
    profile.durability = (
        DurabilityPolicy.TRANSIENT_LOCAL
        if everywhere and all(latched)
        else DurabilityPolicy.VOLATILE
    )
    return profile


def _checked(topic: str) -> str:
    """Return the full name of a topic; raise if it can be none."""
    try:
        validate_full_topic_name(absolute(topic))
    except InvalidTopicNameException as error:
        raise GraphError(' '.join(str(error).split())) from None
    return absolute(topic)
