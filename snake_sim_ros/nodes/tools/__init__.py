"""Programs that use the nodes over ROS 2: the demo, the live view, the recorder, the pacing."""
