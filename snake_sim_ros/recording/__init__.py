"""Recorded runs in files and what messages say of a robot, read without ROS."""
