# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A wall clock that is set for some processes only, by the library of the program `faketime`."""

import os
from pathlib import Path

LIBRARIES = ('/usr/lib/*/faketime/libfaketimeMT.so.1', '/usr/lib/faketime/libfaketimeMT.so.1')
STEPS = (3600.0, -3600.0, 0.1, -0.1, 0.0)  # s by which the clock is off, one after the other


def faketime() -> str:
    """Return the path of the library, empty if it is not installed."""
    root = Path('/')
    found = [str(path) for name in LIBRARIES for path in root.glob(name.lstrip('/'))]
    return found[0] if found else ''


class WallClock:
    """
    The wall clock of processes that are started with its environment; monotonic clocks go on.

    Parameters
    ----------
    folder : Path
        For the file that these processes read at every look at their clock.

    Attributes
    ----------
    environment : dict

    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / 'offset'
        self.environment = {
            'LD_PRELOAD': faketime(),
            'FAKETIME_TIMESTAMP_FILE': str(self._path),
            'FAKETIME_NO_CACHE': '1',
            'FAKETIME_DONT_FAKE_MONOTONIC': '1',
        }
        self.step(0.0)

    def step(self, seconds: float) -> None:
        """Set it so that it is off by some time [s]."""
        new = self._path.with_suffix('.new')
        new.write_text(f'{seconds:+g}s\n', encoding='ascii')
        os.replace(new, self._path)  # No process may read a part of it.
