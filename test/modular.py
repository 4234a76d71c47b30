# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Robots whose links are given one by one: Aiko, and modules with single axes that alternate."""

from snake_sim_ros import Joint, Link, Robot, Shape


def aiko_link_by_link(links: int, *, two_axes: bool = True, **values: object) -> Robot:
    """Return Aiko as a list of links, whose frames are at their rear joints, x along them."""
    aiko = Robot()
    half, offset = aiko.link_length / 2, aiko.contact_offset
    across, axial = aiko.inertia_transversal, aiko.inertia_axial
    shape = Shape(
        radius=aiko.contact_radius, start=(half + offset, 0.0, 0.0), end=(half - offset, 0.0, 0.0)
    )
    return Robot(
        links=tuple(
            Link(
                name=f'link_{i + 1}',
                mass=aiko.link_mass,
                center_of_mass=(half, 0.0, 0.0),
                inertia=(axial, across, across, 0.0, 0.0, 0.0),
                shapes=(shape,),
            )
            for i in range(links)
        ),
        joints=tuple(
            Joint(
                name=f'joint_{j + 1}_yaw',
                origin=(aiko.link_length, 0.0, 0.0),
                axis=(0.0, 0.0, 1.0),
                second_axis=(0.0, 1.0, 0.0) if two_axes else None,
                second_name=f'joint_{j + 1}_pitch' if two_axes else '',
            )
            for j in range(links - 1)
        ),
        **values,
    )


def modular_robot(links: int = 5, **values: object) -> Robot:
    """
    Return modules of 6 cm and 0.16 kg, whose servos turn about z and y in turn.

    Every third servo is mounted upside down, so that its axis points down or to the right.
    """
    gains = {'yaw_stiffness': 20.0, 'pitch_stiffness': 20.0} | values
    shape = Shape(radius=0.026, start=(0.01, 0.0, 0.0), end=(0.05, 0.0, 0.0))
    return Robot(
        links=tuple(
            Link(
                name=f'module_{i}',
                mass=0.16,
                center_of_mass=(0.03, 0.002, -0.001),
                inertia=(4e-5, 7e-5, 6e-5, 1e-6, 0.0, -2e-6),
                shapes=(shape,),
            )
            for i in range(links)
        ),
        joints=tuple(
            Joint(
                name=f'servo_{j}',
                origin=(0.06, 0.0, 0.0),
                axis=tuple(
                    -x if j % 3 == 2 else x
                    for x in ((0.0, 0.0, 1.0) if j % 2 == 0 else (0.0, 1.0, 0.0))
                ),
            )
            for j in range(links - 1)
        ),
        **gains,
    )
