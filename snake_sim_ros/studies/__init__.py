"""Studies: many runs of a scene whose values vary, what is measured in each, and the workers."""
