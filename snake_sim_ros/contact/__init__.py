"""Contact: detection, set-valued laws, their residual, and the solvers of a step."""
