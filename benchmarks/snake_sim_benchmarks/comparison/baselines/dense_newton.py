# Copyright 2026 snake_sim_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Newton's method on the Delassus operator of all contacts, which is formed and solved as a matrix.

The product condenses few contacts only and solves others on the chain of links: the same laws and
the same iteration, at a cost that grows with the number of contacts instead of its cube.
"""

from snake_sim_ros import Scene
from snake_sim_ros.contact.linear_problem import Operator
from snake_sim_ros.contact.newton import make_operator, Newton
from snake_sim_ros.scene.obstacles import contact_count
from snake_sim_ros.stepping.methods import METHODS, paper_method


def whole_operator(scene: Scene) -> Operator:
    """
    Return the operator for all contacts of a scene.

    No sweeps begin a step. Where more contacts stick than hold a robot, they would leave impulses
    of friction that press its links against each other.
    """
    return make_operator(contact_count(scene), scene)._replace(swept=0)


METHODS['newton_dense'] = paper_method(lambda scene: Newton(whole_operator(scene)))
