"""The planar model level: the same steps for a robot that lies flat."""
