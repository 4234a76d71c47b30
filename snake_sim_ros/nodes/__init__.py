"""The ROS 2 shell: the only place that names rclpy or a message package."""
