"""
Lines of the `ros2` command line, done by its own means: rclpy, and YAML as it takes it.

The packages of ROS 2 on PyPI have no command line. A line is taken apart as that one does it, and
has the same effect on the graph; everything it does is done to real nodes.
"""

import importlib
import shlex

from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import SetParameters
from rclpy.duration import Duration
from rclpy.parameter import get_parameter_value
import yaml


def run_line(graph, line):
    """
    Do what a line says.

    Returns
    -------
    object
        The message of `topic echo --once`, the response of `service call`, the result of `param
        set`; nothing for `topic pub --once`.

    """
    words = [word for word in shlex.split(line)[1:] if word != '--once']
    function = {
        ('topic', 'echo'): _echo,
        ('topic', 'pub'): _publish,
        ('service', 'call'): _call,
        ('param', 'set'): _set,
    }[tuple(words[:2])]
    return function(graph, *words[2:])


def interface(name):
    """Return the class of ``package/msg/Name`` or ``package/srv/Name``."""
    package, kind, name = name.split('/')
    return getattr(importlib.import_module(f'{package}.{kind}'), name)


def _fill(message, values):
    """Set fields of a message from nested mappings, as numbers of the types that they have."""
    kinds = message.get_fields_and_field_types()
    for name, value in values.items():
        if isinstance(value, dict):
            _fill(getattr(message, name), value)
        else:
            setattr(message, name, float(value) if kinds[name] == 'double' else value)
    return message


def _echo(graph, topic):
    graph.until(lambda: graph.node.get_publishers_info_by_topic(topic), f'a publisher of {topic}')
    kind = graph.node.get_publishers_info_by_topic(topic)[0].topic_type
    messages = []
    subscription = graph.node.create_subscription(interface(kind), topic, messages.append, 10)
    graph.until(lambda: messages, topic)
    graph.node.destroy_subscription(subscription)
    return messages[0]


def _publish(graph, topic, kind, values):
    publisher = graph.node.create_publisher(interface(kind), topic, 1)
    graph.until(publisher.get_subscription_count, f'a reader of {topic}')
    publisher.publish(_fill(interface(kind)(), yaml.safe_load(values)))
    assert publisher.wait_for_all_acked(Duration(seconds=10))
    graph.node.destroy_publisher(publisher)


def _call(graph, service, kind, values='{}'):
    request = _fill(interface(kind).Request(), yaml.safe_load(values))
    return graph.call(interface(kind), service, request)


def _set(graph, node, name, value):
    parameter = Parameter(name=name, value=get_parameter_value(string_value=value))
    request = SetParameters.Request(parameters=[parameter])
    return graph.call(SetParameters, f'{node}/set_parameters', request).results[0]
