"""The values of a scene that explain a recorded motion, and how well it tells them."""
