"""What is simulated: records of robot, friction, gait and obstacles, and their geometry."""
