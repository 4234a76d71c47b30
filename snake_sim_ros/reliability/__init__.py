"""How the program is attacked: random files, messages and physics, faults, and very long runs."""
