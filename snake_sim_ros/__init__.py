"""A virtual Aiko: exact nonsmooth simulation of a wheel-less snake robot."""

from pathlib import Path

__version__ = '0.1.0'
PACKAGE = Path(__file__).resolve().parent  # folder of the sources
