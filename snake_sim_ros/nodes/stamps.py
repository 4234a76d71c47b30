# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Times as messages carry them."""

from builtin_interfaces.msg import Time

EPOCH = 1e8  # s; a later stamp is that of a wall clock: simulated time begins at zero


def stamp_from(nanoseconds: int) -> Time:
    """Return a time [ns] as a stamp."""
    sec, nanosec = divmod(nanoseconds, 1_000_000_000)
    return Time(sec=sec, nanosec=nanosec)


def seconds_from(stamp: Time) -> float:
    """Return a stamp as a time [s]."""
    return float(stamp.sec + 1e-9 * stamp.nanosec)
