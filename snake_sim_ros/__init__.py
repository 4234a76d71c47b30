"""A virtual Aiko: exact nonsmooth simulation of a wheel-less snake robot."""

__version__ = '0.1.0'
