"""The ROS 2 side: only this package names rclpy or a message package."""
