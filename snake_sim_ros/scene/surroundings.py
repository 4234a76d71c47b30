# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What surrounds the robot, as records of a scene: friction, pegs and the ground."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity

Numbers = tuple[float, ...]
PerLink = float | Numbers

STICKY = 1e6  # largest friction: with it everything sticks whose load is more than rounding


@dataclass(frozen=True, kw_only=True)
class Friction(CheckedRecord):
    """
    Coefficients of spatial Coulomb friction and of rolling friction.

    A link slides forward along e_z of its frame, from link 1 to link n. What resists that is
    `longitudinal`; `backward` resists sliding the other way, and is equal if it is not given. The
    admissible forces are then two halves of ellipses, which share the half axis `transversal`.
    """

    longitudinal: float = quantity(
        0.1, '1', 'Coulomb mu_Tx along the link', minimum=0, maximum=STICKY
    )
    backward: float | None = quantity(
        None,
        '1',
        'Coulomb mu_Tx of a link that slides backward; default: longitudinal',
        minimum=0,
        maximum=STICKY,
    )
    transversal: float = quantity(
        0.5, '1', 'Coulomb mu_Ty across the link', minimum=0, maximum=STICKY
    )
    rolling: float = quantity(
        0.0, '1', 'rolling friction mu_V (assumption: none)', minimum=0, maximum=STICKY
    )

    @property
    def against_backward(self) -> float:
        """Coefficient along a link that slides backward."""
        return self.longitudinal if self.backward is None else self.backward

    @property
    def has_direction(self) -> bool:
        """Whether forward and backward sliding differ."""
        return self.against_backward != self.longitudinal


@dataclass(frozen=True, kw_only=True)
class Pegs(CheckedRecord):
    """Round vertical posts of any height, fixed to the ground, one entry for each."""

    x: Numbers = quantity((), 'm', 'x of the peg axes')
    y: Numbers = quantity((), 'm', 'y of the peg axes')
    radius: PerLink = quantity(0.05, 'm', 'radius of all pegs or of each', above=0, minimum=1e-6)
    friction: float = quantity(
        0.2, '1', 'Coulomb friction in all directions', minimum=0, maximum=STICKY
    )

    def __post_init__(self) -> None:
        """Check every field, and that there are as many x as y and radii."""
        super().__post_init__()
        if len(self.x) != len(self.y):
            raise ParameterError(
                f'x and y must be of one length, got {len(self.x)} and {len(self.y)} numbers'
            )
        if isinstance(self.radius, tuple) and len(self.radius) != len(self.x):
            raise ParameterError(
                f'radius must be one number or one for each of the {len(self.x)} pegs, '
                f'got {len(self.radius)} numbers'
            )

    @property
    def axes(self) -> NDArray[Any]:
        """x, y and radius of every peg, shape (pegs, 3) [m]."""
        radius = np.broadcast_to(np.asarray(self.radius, dtype=float), (len(self.x),))
        return np.column_stack([self.x, self.y, radius]).reshape(-1, 3)


@dataclass(frozen=True, kw_only=True)
class Ground(CheckedRecord):
    """The ground as square cells of constant height; everywhere else it is z = 0."""

    heights: tuple[Numbers, ...] = quantity(
        (), 'm', 'heights of the cells: along x in a row, the rows along y'
    )
    cell: float = quantity(0.2, 'm', 'side of a cell', above=0, minimum=1e-6)
    origin: Numbers = quantity((0.0, 0.0), 'm', 'corner of the cells with the least x and y')

    def __post_init__(self) -> None:
        """Check every field, that rows have one length, and that the origin is a point."""
        super().__post_init__()
        _check_cells('heights', self.heights, self.origin)


@dataclass(frozen=True, kw_only=True)
class Patches(CheckedRecord):
    """
    Square patches of the ground with another friction; everywhere else the factor is 1.

    A factor multiplies all coefficients of `Friction` for the spheres whose centers are above the
    cell. Walls belong to the cell that the sphere is above.
    """

    factors: tuple[Numbers, ...] = quantity(
        (),
        '1',
        'factors of friction of the cells: along x in a row, the rows along y',
        minimum=0,
        maximum=STICKY,
    )
    cell: float = quantity(0.2, 'm', 'side of a cell', above=0, minimum=1e-6)
    origin: Numbers = quantity((0.0, 0.0), 'm', 'corner of the cells with the least x and y')

    def __post_init__(self) -> None:
        """Check every field, that rows have one length, and that the origin is a point."""
        super().__post_init__()
        _check_cells('factors', self.factors, self.origin)


def _check_cells(name: str, rows: tuple[Numbers, ...], origin: Numbers) -> None:
    """Raise an error if rows of cells differ in length, or if their origin is not a point."""
    lengths = sorted({len(row) for row in rows})
    if len(lengths) > 1:
        raise ParameterError(
            f'{name} must be rows of one length, got rows of {lengths[0]} and of '
            f'{lengths[-1]} numbers'
        )
    if len(origin) != 2:
        raise ParameterError(f'origin must have 2 components, got {len(origin)}')
