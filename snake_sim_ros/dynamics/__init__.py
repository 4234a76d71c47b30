"""The mechanism without contact: kinematics, the chain of links, joint control and energy."""
