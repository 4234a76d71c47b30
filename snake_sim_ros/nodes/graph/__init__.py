"""What the commands topic, param and service do, in the words of the `ros2` command line."""
