# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""How a scene starts, and what pushes the robot in it, as records of a scene."""

from dataclasses import dataclass
import math

from snake_sim_ros.scene.checked_records import CheckedRecord, ParameterError, quantity

Numbers = tuple[float, ...]
PerJoint = float | Numbers

NOTHING = (0.0, 0.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class Start(CheckedRecord):
    """
    Posture and place of the robot at the start, where it is at rest.

    Angles are one number for all joints or one for each. The centroid of the links is at
    `position`. Their principal axis, with link 1 at its end with the smaller x, has the direction
    `heading`. The lowest contact sphere is `height` above the ground.
    """

    yaw: PerJoint | None = quantity(
        None, 'rad', 'yaw angles of the joints; default: those of the gait at t = 0'
    )
    pitch: PerJoint | None = quantity(
        None, 'rad', 'pitch angles of the joints; default: those of the gait at t = 0'
    )
    position: Numbers = quantity((0.0, 0.0), 'm', 'x and y of the centroid of the links')
    heading: float = quantity(
        0.0, 'rad', 'angle from the x axis to the robot, counterclockwise from above'
    )
    height: float = quantity(
        0.0, 'm', 'gap between the lowest contact sphere and the ground', minimum=0
    )

    def __post_init__(self) -> None:
        """Check every field, and that the position is a point."""
        super().__post_init__()
        if len(self.position) != 2:
            raise ParameterError(f'position must have 2 components, got {len(self.position)}')

    def check(self, joint_count: int, joint_limit: float) -> None:
        """
        Check that the joints of a robot can have the angles.

        Raises
        ------
        ParameterError
            If they are not one number or one for each joint, or beyond the joint limit [rad].

        """
        for name, angle in (('yaw', self.yaw), ('pitch', self.pitch)):
            if isinstance(angle, tuple) and len(angle) != joint_count:
                raise ParameterError(
                    f'start.{name} must be one number or one for each of the {joint_count} '
                    f'joints, got {len(angle)} numbers'
                )
            angles = angle if isinstance(angle, tuple) else (angle or 0.0,)
            largest = max(angles, key=abs, default=0.0)
            if abs(largest) > joint_limit:
                degrees = f'; for degrees say start.{name}_deg' if abs(largest) > math.pi else ''
                raise ParameterError(
                    f'start.{name} must be within the joint limit, +-{joint_limit:.4g} rad, got '
                    f'{largest:.4g} rad{degrees}'
                )


@dataclass(frozen=True, kw_only=True)
class Push(CheckedRecord):
    """A force and a torque at the center of a link for some time, in axes of the world."""

    link: int | None = quantity(
        None, '1', 'number of the link, from 1 as in link_1; default: the middle one', minimum=1
    )
    force: Numbers = quantity(NOTHING, 'N', 'force at the center of the link')
    torque: Numbers = quantity(NOTHING, 'N m', 'torque about the center of the link')
    start: float = quantity(0.0, 's', 'simulated time at which it begins', minimum=0)
    duration: float = quantity(0.1, 's', 'how long it lasts', above=0)

    def __post_init__(self) -> None:
        """Check every field, and that it pushes."""
        super().__post_init__()
        for name, vector in (('force', self.force), ('torque', self.torque)):
            if len(vector) != 3:
                raise ParameterError(f'{name} must have 3 components, got {len(vector)}')
        if not any(self.force + self.torque):
            raise ParameterError('a push must have a force or a torque that is not 0')
