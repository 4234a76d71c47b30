# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Size and colors of the figures of the paper, and the empty page on which each is drawn."""

from matplotlib.figure import Figure

WIDTH = 9.0  # inch, as wide as a page on GitHub
GRAY = '#666666'
LOADED_COLOR = '#d55e00'  # of spheres that carry load


def page(height: float, title: str, assumed: str) -> Figure:
    """Return a figure with a title at its top and the assumptions at its foot."""
    figure = Figure(figsize=(WIDTH, height), layout='constrained')
    figure.suptitle(title, x=0.01, ha='left', fontsize=10, fontweight='bold')
    figure.supxlabel(assumed, x=0.01, ha='left', fontsize=7.5, color=GRAY)
    return figure
