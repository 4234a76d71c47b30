"""What is simulated: robot, friction, gait and obstacles, and their geometry."""
