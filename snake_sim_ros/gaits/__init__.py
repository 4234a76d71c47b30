"""References of the joints over time: blending of gaits, steering, commands, trajectories."""
