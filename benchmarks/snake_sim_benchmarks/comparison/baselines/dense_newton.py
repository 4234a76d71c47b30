# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method on the Delassus operator of all contacts, which is formed and solved as a matrix.

The product condenses few contacts only and solves others on the chain of links: the same laws and
the same iteration, at a cost that grows with the number of contacts instead of its cube.
"""

from snake_sim_ros import Scene
from snake_sim_ros.contact.newton import make_operator, Newton, Operator
from snake_sim_ros.dynamics.records import Loop
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.stepping import moreau
from snake_sim_ros.stepping.base import Method
from snake_sim_ros.stepping.methods import METHODS
from snake_sim_ros.stepping.spatial import SpatialStepper


def whole_operator(scene: Scene) -> Operator:
    """
    Return the operator for all contacts of a scene.

    No sweeps begin a step. Where more contacts stick than hold a robot, they would leave impulses
    of friction that press its links against each other.
    """
    width = 5 if scene.friction.rolling > 0.0 else 3
    operator = make_operator(contact_count(scene), width, scene.robot.link_count)
    return operator._replace(swept=0)


METHODS['newton_dense'] = Method(
    spatial=lambda scene: SpatialStepper(
        scene, Loop(moreau.advance_moreau, Newton(whole_operator(scene)))
    ),
    planar=None,
    where_impulses_acted=moreau.where_impulses_acted,
)
