"""Optimization: the values of a scene for which an expression of metrics is largest or least."""
