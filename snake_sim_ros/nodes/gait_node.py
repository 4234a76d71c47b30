"""
The `gait` node: generates joint references and publishes them as commands.

It knows joint names and a clock, nothing of the simulator: any robot that takes `joint_command`
can follow it.
"""

from dataclasses import dataclass
import sys
from threading import Event

from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from snake_sim_ros import gait
from snake_sim_ros.nodes.messages import command_message
from snake_sim_ros.nodes.messages import joint_names
from snake_sim_ros.nodes.node_parameters import settle
from snake_sim_ros.nodes.running import run_node
from snake_sim_ros.records import quantity
from snake_sim_ros.records import Record

OF_SCENE = ('gait.', 'robot.link_count')  # what the node takes of a scene


@dataclass(frozen=True, kw_only=True)
class Settings(Record):
    """Parameters of the node besides those of the gait."""

    scene: str = quantity(
        'lateral_undulation', '', 'where gait and number of links come from: a YAML file or a name'
    )
    publish_rate: float = quantity(200.0, 'Hz', 'commands a second', minimum=1, maximum=1000)


class GaitNode(Node):
    """Commands of a gait that begins when the first robot listens."""

    def __init__(self) -> None:
        super().__init__('gait', automatically_declare_parameters_from_overrides=True)
        settings, scene = settle(self, Settings, OF_SCENE)
        self.gait = scene.gait
        self.names = joint_names(scene.robot.link_count)
        self.begin: int | None = None
        self.commands = self.create_publisher(JointState, 'joint_command', QoSProfile(depth=1))
        self.create_service(Trigger, '~/restart', self._on_restart)
        self.create_timer(1.0 / settings.publish_rate, self.publish)
        self.get_logger().info('waiting for a robot that listens to joint_command')

    def publish(self) -> None:
        """Publish the command of now, once there is a clock and someone who listens."""
        now = self.get_clock().now()
        if now.nanoseconds == 0:
            return
        if self.begin is None and self.commands.get_subscription_count() == 0:
            return
        if self.begin is None or now.nanoseconds < self.begin:
            self.begin = now.nanoseconds
            self.get_logger().info(f'the gait begins at t = {1e-9 * self.begin:.9f} s')
        seconds = 1e-9 * (now.nanoseconds - self.begin)
        angle, rate = gait.reference(self.gait, seconds, len(self.names) // 2)
        self.commands.publish(command_message(self.names, now.to_msg(), angle, rate))

    def _on_restart(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self.begin = None
        response.success = True
        response.message = 'the gait begins again'
        return response


def run(node: GaitNode, stop: Event) -> None:
    """Serve clock, timer and services."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    while not stop.is_set():
        executor.spin_once(timeout_sec=0.1)


def main(args: list[str] | None = None) -> int:
    """Run the node until it is told to stop."""
    return run_node(GaitNode, run, args)


if __name__ == '__main__':
    sys.exit(main())
