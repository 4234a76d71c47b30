"""Time stepping: the methods, the model levels, and a scene that runs."""
